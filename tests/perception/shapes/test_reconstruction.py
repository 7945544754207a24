from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.perception.shapes.colliders import Hull, fit_colliders
from grs_agents.perception.shapes.object_crop import crop_object
from grs_agents.perception.shapes.reconstruction import reconstruct_shape
from grs_agents.perception.shapes.texture import paint_mesh
from tests.perception.shapes.photo import CAMERA, cup, depth_of, depth_of_table, on_table, photograph


def solid_of(shape):
    return trimesh.Trimesh(shape.mesh.vertices, shape.mesh.faces, process=False)


@settings(max_examples=8, deadline=None)
@given(width=st.floats(0.04, 0.1), height=st.floats(0.04, 0.1), more=st.floats(0.0, 0.012), seed=st.integers(0, 99))
def test_the_seen_sides_of_a_box_are_where_their_surfaces_were_measured(width, height, more, seed):
    box = on_table(trimesh.creation.box((width, 0.07, height)))
    view = photograph(box, noise=0.0015, rng=np.random.default_rng(seed))

    shape = reconstruct_shape(replace(view, size=(width + more, 0.07, height + more)))

    assert shape is not None and shape.method == "box"
    near, top = shape.mesh.vertices[:, 0].min(), shape.mesh.vertices[:, 2].max()
    assert (near, top) == pytest.approx((-width / 2, height), abs=0.002)


def heights_of(view):
    """(H, W) how high above the table lies what the pixels show, m."""
    rows, columns = np.indices(view.depth.shape)
    rays = np.stack([(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy, np.ones(rows.shape)], axis=-1)
    return (view.depth[..., None] * rays) @ view.T_object_cam[2, :3] + view.T_object_cam[2, 3]


def open_box(length=0.16, width=0.1, height=0.07, wall=0.005):
    parts = [((length, width, wall), (0, 0, wall / 2))]
    parts += [((wall, width, height), (side * (length - wall) / 2, 0, height / 2)) for side in (1, -1)]
    parts += [((length, wall, height), (0, side * (width - wall) / 2, height / 2)) for side in (1, -1)]
    return trimesh.util.concatenate([trimesh.creation.box(size).apply_translation(at) for size, at in parts])


@pytest.mark.parametrize(("thing", "method"), [(cup(), "lathe"), (open_box(), "box")])
def test_what_is_open_at_the_top_is_so_where_little_but_its_floor_was_measured(thing, method):
    view = photograph(thing, 1.1, noise=0.001, rng=np.random.default_rng(0))
    view.depth[~view.mask] = depth_of_table(view.T_object_cam)[~view.mask]
    true, heights, top = view.depth.copy(), heights_of(view), thing.bounds[1][2]
    view.depth[view.mask & (heights > 0.02) & (heights < top - 0.003)] = 0
    x, y, z = view.size  # of a box around what was measured, which is not all

    shape = reconstruct_shape(replace(view, size=(0.9 * x, 0.9 * y, 1.1 * z), hollow=True))

    assert shape is not None and (shape.method, shape.hollow) == (method, True)
    drawn = depth_of(solid_of(shape), view.T_object_cam)
    assert (np.isfinite(drawn) & view.mask).sum() > 0.95 * (np.isfinite(drawn) | view.mask).sum()
    both = view.mask & np.isfinite(drawn)
    assert np.percentile(np.abs(drawn - true)[both], 90) < 0.006
    assert shape.mesh.vertices[:, 2].max() == pytest.approx(top, abs=0.004)
    middle = np.abs(shape.mesh.vertices[:, :2]).max(axis=1) < 0.02
    assert shape.mesh.vertices[middle, 2].max() < 0.01  # one can put something into it
    colliders = fit_colliders(shape, "cylinder", hollow=True)  # the footprint may look round
    boxes = [one for one in colliders if not isinstance(one, Hull) and one.kind == "box"]
    assert len(boxes) == (5 if method == "box" else 0)
    plain = reconstruct_shape(view)
    assert plain is None or not plain.hollow  # that was not told


def agreement_from_above(thing, tilt, noise):
    """Intersection over union of the pixels of a thing on a table and of the shape that is made of it."""
    view = photograph(on_table(thing), tilt, noise=noise, rng=np.random.default_rng(0))
    view.depth[~view.mask] = depth_of_table(view.T_object_cam)[~view.mask]
    shown = np.isfinite(depth_of(solid_of(reconstruct_shape(view)), view.T_object_cam))
    return (shown & view.mask).sum() / (shown | view.mask).sum()


@pytest.mark.parametrize("tilt", [1.1, 1.35])
@pytest.mark.parametrize("height", [0.05, 0.08])
def test_a_cone_reaches_to_its_foot(height, tilt):
    assert agreement_from_above(trimesh.creation.cone(0.04, height), tilt, 0.001) > 0.95


@pytest.mark.parametrize("length", [0.17, 0.1775, 0.185])
def test_a_floor_that_is_thinner_than_a_cell_has_no_holes(length):
    assert agreement_from_above(open_box(length, 0.1, 0.05, 0.0025), 1.3, 0.0005) > 0.9


@pytest.mark.parametrize("tilt", [0.5, 0.9])
def test_a_closed_box_stays_closed_though_noise_made_its_top_look_hollow(tilt):
    box = on_table(trimesh.creation.box((0.04, 0.12, 0.17)))
    view = photograph(box, tilt=tilt, noise=0.003, rng=np.random.default_rng(0))

    shape = reconstruct_shape(replace(view, hollow=True))

    assert shape is not None
    assert not shape.hollow


@pytest.mark.parametrize("yaw", [0.3, 0.8, 1.2])
@pytest.mark.parametrize(("mixed", "most"), [(False, 0.004), (True, 0.016)])
def test_steep_walls_without_sound_depth_stand_on_their_foot(yaw, mixed, most):
    """A sensor shows the near walls not at all, or mixed with the table beside them."""
    box = trimesh.creation.box((0.09, 0.06, 0.08))
    box.apply_transform(trimesh.transformations.rotation_matrix(yaw, (0, 0, 1)))
    view = photograph(on_table(box), 0.9, noise=0.001, rng=np.random.default_rng(0))
    view.depth[~view.mask] = depth_of_table(view.T_object_cam)[~view.mask]
    true, heights = view.depth.copy(), heights_of(view)
    wall = view.mask & (heights < 0.076)
    behind = np.random.default_rng(1).uniform(0, 0.06, wall.sum())
    view.depth[wall] = true[wall] + behind if mixed else 0

    shape = reconstruct_shape(view)

    assert shape is not None
    drawn = depth_of(solid_of(shape), view.T_object_cam)
    both = view.mask & np.isfinite(drawn)
    assert np.percentile(np.abs(drawn - true)[both], 90) < most


def test_a_cup_is_one_though_most_depth_is_missing():
    view = photograph(cup())
    view.depth[:, ::2] = 0
    view.depth[::2] = 0

    shape = reconstruct_shape(view)

    assert shape is not None
    assert (shape.method, shape.hollow) == ("lathe", True)
    assert shape.silhouette_iou > 0.95


def test_no_shape_where_hardly_any_depth_was_measured():
    view = photograph(cup())
    rows, columns = np.nonzero(view.mask)
    view.depth[rows[50:], columns[50:]] = 0

    assert reconstruct_shape(view) is None


def test_a_side_that_was_not_measured_belongs_to_the_shape():
    view = photograph(cup(), 1.35, noise=0.001, rng=np.random.default_rng(0))
    columns = np.flatnonzero(view.mask.any(axis=0))
    view.depth[:, columns[int(0.55 * len(columns))] :] = 0

    shape = reconstruct_shape(view)

    assert shape is not None
    assert shape.silhouette_iou > 0.9


def test_a_cup_of_which_little_was_measured_is_still_round():
    view = photograph(cup(), noise=0.001, rng=np.random.default_rng(0))
    rows, columns = np.nonzero(view.mask)
    left = columns < np.percentile(columns, 35)
    view.depth[rows[left], columns[left]] = 0

    shape = reconstruct_shape(view)

    assert shape is not None
    assert shape.method == "lathe"
    assert shape.hollow


def l_shape():
    low, high = trimesh.creation.box((0.05, 0.16, 0.03)), trimesh.creation.box((0.05, 0.04, 0.14))
    low.apply_translation((0, 0, 0.015))
    high.apply_translation((0, 0.06, 0.07))
    return trimesh.util.concatenate([low, high])


def test_no_box_stands_for_what_is_no_box_where_little_was_measured():
    view = photograph(l_shape())
    rows, columns = np.nonzero(view.mask)
    left = columns < np.percentile(columns, 35)
    view.depth[rows[left], columns[left]] = 0

    shape = reconstruct_shape(view)

    assert shape is not None
    assert shape.silhouette_iou > 0.75


def test_a_mesh_stands_for_what_is_no_box_where_most_depth_is_missing_all_over():
    view = photograph(l_shape())
    view.depth[np.random.default_rng(0).random(view.depth.shape) < 0.55] = 0

    shape = reconstruct_shape(view)

    assert shape is not None
    assert shape.silhouette_iou > 0.9


@settings(max_examples=4, deadline=None)
@given(radius=st.floats(0.03, 0.05), height=st.floats(0.07, 0.12), seed=st.integers(0, 99))
def test_one_can_put_something_into_a_cup(radius, height, seed):
    view = photograph(cup(radius, height), noise=0.001, rng=np.random.default_rng(seed))

    shape = reconstruct_shape(view)

    assert shape is not None
    assert shape.method == "lathe"
    assert shape.hollow
    assert shape.walls is not None
    inner, outer, heights = shape.walls.T
    assert np.abs(outer - radius).max() < 0.005
    assert (inner < outer - 0.002).all()
    assert abs(heights[-1] - height) < 0.005
    solid = solid_of(shape)
    assert solid.is_watertight
    assert solid.volume < 0.45 * np.pi * radius**2 * height


def test_mirror_image_closes_the_back_of_a_lying_cylinder():
    lying = trimesh.creation.cylinder(0.03, 0.14)
    lying.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    lying = on_table(lying)

    shape = reconstruct_shape(photograph(lying, tilt=0.6))

    assert shape is not None
    solid = solid_of(shape)
    assert solid.is_watertight
    assert len(solid.faces) <= 2000
    assert solid.volume == pytest.approx(lying.volume, rel=0.2)
    assert shape.silhouette_iou > 0.9
    assert shape.depth_error < 0.005


def test_thin_walls_of_an_open_box_stay():
    boards = [((0.2, 0.15, 0.004), (0, 0, 0.002))]
    boards += [((0.004, 0.15, 0.06), (x, 0, 0.03)) for x in (-0.098, 0.098)]
    boards += [((0.2, 0.004, 0.06), (0, y, 0.03)) for y in (-0.073, 0.073)]
    solids = [trimesh.creation.box(size).apply_translation(place) for size, place in boards]
    tray = trimesh.util.concatenate(solids)

    shape = reconstruct_shape(photograph(tray, tilt=0.9, distance=0.8))

    assert shape is not None
    assert shape.silhouette_iou > 0.9
    assert solid_of(shape).volume < 0.6 * 0.2 * 0.15 * 0.06


def test_back_of_a_flattened_bottle_is_told_by_its_neck():
    radii = np.array([[0, 0], [1, 0], [1, 0.09], [0.7, 0.12], [0.35, 0.13], [0.3, 0.16], [0, 0.16]])
    bottle = trimesh.creation.revolve(radii)
    bottle.apply_scale((0.022, 0.035, 1.0))

    shape = reconstruct_shape(photograph(bottle, tilt=0.6))

    assert shape is not None
    assert shape.method == "mirror"
    assert 0.014 < shape.mesh.vertices[:, 0].max() < 0.026


def carton(side=0.07, wall=0.13, ridge=0.17):
    """A box with a gabled roof, its front towards the camera."""
    x = side / 2
    outline = [(-x, 0.0), (x, 0.0), (x, wall), (0.0, ridge), (-x, wall)]
    corners = [(end, *corner) for end in (-x, x) for corner in outline]
    sides = [(k, (k + 1) % 5) for k in range(5)]
    faces = [face for a, b in sides for face in ((a, a + 5, b + 5), (a, b + 5, b))]
    faces += [(0, k, k + 1) for k in (1, 2, 3)] + [(5, k + 6, k + 5) for k in (1, 2, 3)]
    return trimesh.Trimesh(corners, faces)


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_a_front_that_is_seen_head_on_is_not_the_whole_of_a_carton(seed):
    view = photograph(carton(), tilt=0.6, distance=0.8, noise=0.0015, rng=np.random.default_rng(seed))

    shape = reconstruct_shape(replace(view, noise=0.0015))

    assert shape is not None
    assert solid_of(shape).volume > 0.6 * abs(carton().volume)


def test_texture_shows_no_table():
    shape = reconstruct_shape(photograph(on_table(trimesh.creation.icosphere(radius=0.05))))

    assert shape is not None
    assert (shape.mesh.texture.reshape(-1, 3) == (30, 60, 200)).all()
    assert shape.mesh.uvs.min() >= 0
    assert shape.mesh.uvs.max() <= 1


def test_texture_shows_no_table_where_depth_reached_beyond_the_object():
    view = photograph(on_table(trimesh.creation.icosphere(radius=0.05)))
    wide = cv2.dilate(view.mask.astype(np.uint8), np.ones((13, 13), np.uint8)) > 0
    beyond = np.where(wide, np.median(view.depth[view.mask]), depth_of_table(view.T_object_cam))

    shape = reconstruct_shape(
        replace(view, mask=wide, depth=np.where(view.mask, view.depth, beyond).astype(np.float32))
    )

    assert shape is not None
    assert shape.mesh.vertices[:, 1].max() > 0.053
    assert (shape.mesh.texture.reshape(-1, 3) == (30, 60, 200)).all()


def test_texture_keeps_what_has_the_colour_of_the_table():
    view = photograph(on_table(trimesh.creation.icosphere(radius=0.05)))
    rows, columns = np.nonzero(view.mask)
    upper = rows < np.percentile(rows, 60)
    view.rgb[rows[upper], columns[upper]] = (140, 90, 60)
    depth = np.where(view.mask, view.depth, depth_of_table(view.T_object_cam)).astype(np.float32)

    shape = reconstruct_shape(replace(view, depth=depth))

    assert shape is not None
    assert (shape.mesh.texture == (140, 90, 60)).all(axis=2).mean() > 0.4


def test_what_something_nearer_hides_is_not_cut_away():
    ball = on_table(trimesh.creation.icosphere(radius=0.05))
    post = trimesh.creation.box((0.02, 0.03, 0.06))
    post.apply_translation((-0.12, 0.0, 0.03))

    shape = reconstruct_shape(photograph(ball, tilt=0.5, before=post))

    assert shape is not None
    assert solid_of(shape).volume > 0.8 * ball.volume


def test_mug_has_a_handle():
    body = cup(0.04, 0.1)
    ring = trimesh.creation.torus(0.025, 0.006)
    ring.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0)))
    ring.apply_translation((0.0, 0.058, 0.05))
    ring.update_faces((ring.vertices[ring.faces][:, :, 1] > 0.037).all(axis=1))  # outside the cavity
    mug = trimesh.util.concatenate([body, ring])

    shape = reconstruct_shape(photograph(mug, tilt=0.6))

    assert shape is not None
    assert shape.method == "lathe"
    assert shape.hollow
    assert solid_of(shape).is_watertight
    assert shape.mesh.vertices[:, 1].max() == pytest.approx(0.089, abs=0.006)
    assert -shape.mesh.vertices[:, 1].min() == pytest.approx(0.04, abs=0.004)
    beside = shape.mesh.vertices[shape.mesh.vertices[:, 1] > 0.06]
    assert np.abs(beside[:, 0]).max() < 0.015


def test_hidden_vertices_take_the_texture_of_their_neighbours_and_hidden_pieces_that_of_the_middle():
    ball = on_table(trimesh.creation.icosphere(subdivisions=3, radius=0.05))
    crop = crop_object(photograph(ball))
    assert crop is not None
    count, below = len(ball.vertices), ball.vertices - (0, 0, 1)

    mesh = paint_mesh(crop, np.vstack([ball.vertices, below]), np.vstack([ball.faces, ball.faces + count]))

    seen, hidden = mesh.uvs[:count], mesh.uvs[count:]
    assert np.ptp(hidden, axis=0).max() < 0.01
    assert np.abs(hidden - 0.5).max() < 0.2
    edges = ball.edges_unique
    sums, degrees = np.zeros((count, 2)), np.zeros(count)
    for start, end in (edges.T, edges.T[::-1]):
        np.add.at(sums, start, seen[end])
        np.add.at(degrees, start, 1)
    behind = (ball.vertices - ball.centroid) @ (crop.eye - ball.centroid) < 0
    assert behind.sum() > 200
    assert np.abs(sums / degrees[:, None] - seen)[behind].max() < 1e-4
