import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from grs_agents.library.library import Library
from grs_agents.sim.world import footprints

LIBRARY = Library()
points = st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=3, max_size=20)


@given(points)
def test_a_hull_holds_all_its_points(cloud) -> None:
    hull = footprints.convex_hull(np.array(cloud))
    edges = np.roll(hull, -1, axis=0) - hull
    area = 0.5 * float(np.sum(hull[:, 0] * np.roll(hull[:, 1], -1) - hull[:, 1] * np.roll(hull[:, 0], -1)))
    if len(hull) < 3 or area < 1e-4 or np.linalg.norm(edges, axis=1).min() < 1e-3:
        return
    assert footprints.margins_inside_outline(np.zeros((1, 2)), hull, np.array(cloud)).min() > -1e-5


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-3, 3))
def test_gaps_are_the_distance_along_the_axis_between_squares(x, y, yaw) -> None:
    square = footprints.rectangle_outline((0, 0), (0.2, 0.2), 0)
    other = footprints.rectangle_outline((x, y), (0.001, 0.001), yaw)
    gap = float(footprints.signed_outline_gaps(other, square, np.zeros((1, 2)))[0])
    expected = max(abs(x), abs(y)) - 0.1
    assert abs(gap - expected) < 0.002 or gap >= expected


@given(st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-3, 3)), min_size=1, max_size=5))
def test_the_least_gap_to_several_outlines_is_that_to_the_nearest(places) -> None:
    square = footprints.rectangle_outline((0, 0), (0.2, 0.1), 0.4)
    outlines = [footprints.rectangle_outline((x, y), (0.1, 0.3), yaw) for x, y, yaw in places]
    offsets = np.array([[0.0, 0.0], [0.3, -0.1], [-0.4, 0.2]])
    others = [footprints.Prism(outline, 0, 0.1) for outline in outlines]
    single = [footprints.signed_outline_gaps(square, outline, offsets) for outline in outlines]
    np.testing.assert_allclose(
        footprints.least_outline_gaps(square, others, offsets), np.min(single, axis=0), atol=1e-12
    )


def test_the_outline_of_a_can_on_the_table_reaches_from_the_table_to_its_top() -> None:
    height = LIBRARY.asset("HOPE/Corn.urdf").size[2]
    outline = footprints.object_prism_at_pose(
        LIBRARY.load_object_model("HOPE/Corn.urdf"), ((0.5, 0.0, height / 2), (0, 0, 0, 1))
    )
    assert abs(outline.low) < 1e-6
    assert abs(outline.high - height) < 1e-6


@given(st.lists(st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-3, 3)), min_size=1, max_size=5))
def test_a_body_rests_on_the_highest_of_what_is_nearer_than_the_gap(places) -> None:
    body = footprints.Prism(footprints.rectangle_outline((0, 0), (0.2, 0.1), 0.4), 0, 0.1)
    others = [
        footprints.Prism(footprints.rectangle_outline((x, y), (0.1, 0.3), yaw), 0, 0.1 + index)
        for index, (x, y, yaw) in enumerate(places)
    ]
    offsets, gaps = np.array([[0.0, 0.0], [0.3, -0.1], [-0.4, 0.2]]), (0.0211, -0.0019)
    apart = np.array([footprints.signed_outline_gaps(body.outline, other.outline, offsets) for other in others])
    assume(np.abs(apart[..., None] - gaps).min() > 1e-9)
    heights = np.array([other.high for other in others])[:, None]
    expected = [np.where(apart < gap, heights, 0.0).max(axis=0) for gap in gaps]
    np.testing.assert_array_equal(footprints.rest_heights_for_gaps(body, others, offsets, gaps), expected)


def test_a_body_rests_on_what_lies_below_it_and_on_the_table_elsewhere() -> None:
    body = footprints.Prism(footprints.rectangle_outline((0, 0), (0.1, 0.1), 0), 0, 0.1)
    table = [footprints.Prism(footprints.rectangle_outline((0.5, 0), (0.1, 0.1), 0.3), 0, 0.2)]
    assert footprints.rest_heights_at_offsets(body, table, np.array([[0.5, 0.0], [0.3, 0.0]]), 0.0).tolist() == [
        0.2,
        0.0,
    ]


def test_the_outline_of_a_ball_does_not_turn_with_it() -> None:
    turn = (0.5, 0.5, 0.5, 0.5)
    asked = footprints.object_prism_at_pose(
        LIBRARY.load_object_model("ball/ball.urdf"), ((0.5, 0.0, 0.1), (0, 0, 0, 1))
    )
    turned = footprints.object_prism_at_pose(LIBRARY.load_object_model("ball/ball.urdf"), ((0.5, 0.0, 0.1), turn))
    tilted = footprints.object_prism_at_pose(
        LIBRARY.load_object_model("ball/ball.urdf"), ((0.5, 0.0, 0.1), (0.38268343, 0, 0, 0.92387953))
    )
    for other in (turned, tilted):
        np.testing.assert_allclose(
            [other.low, other.high, *other.bounding_box_xy], [asked.low, asked.high, *asked.bounding_box_xy], atol=1e-6
        )


@given(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-3, 3))
def test_an_overlap_lies_in_both_outlines_and_is_there_if_they_meet(x, y, yaw) -> None:
    first, second = (
        footprints.rectangle_outline((0, 0), (0.2, 0.1), 0),
        footprints.rectangle_outline((x, y), (0.15, 0.05), yaw),
    )
    common = footprints.intersect_outlines(first, second)
    gap = footprints.signed_outline_gaps(first, second, np.zeros((1, 2)))[0]
    if gap < -1e-6:
        assert len(common) > 2
        for outline in (first, second):
            assert footprints.margins_inside_outline(np.zeros((1, 2)), outline, common).min() > -1e-9
    elif gap > 1e-6:
        assert len(common) == 0


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-3, 3))
def test_no_corner_is_nearer_than_the_nearest_point_of_an_outline(x, y, yaw) -> None:
    outline, point = footprints.rectangle_outline((0, 0), (0.2, 0.1), yaw), np.array([x, y])
    nearest = footprints.nearest_point_of_outline(outline, point)
    away = np.linalg.norm(nearest - point)
    assert footprints.margins_inside_outline(np.zeros((1, 2)), outline, nearest[None])[0] > -1e-9
    assert (np.linalg.norm(outline - point, axis=1) >= away - 1e-9).all()
