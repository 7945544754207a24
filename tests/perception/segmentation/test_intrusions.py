"""Arms are no objects; objects that the picture cuts are, and whatever it cuts where the arm is known."""

from dataclasses import replace

import numpy as np

from grs_agents.perception.object_finding import find_objects
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import Candidate, RGBDFrame
from tests.perception.conftest import THINGS, Rendered, Thing, render


def _segment(frame: RGBDFrame) -> np.ndarray:
    """(H, W) numbers of the objects."""
    table, labels = find_table(frame, np.random.default_rng(0)), np.zeros(frame.depth.shape, np.int32)

    def segment(photo: RGBDFrame) -> tuple[Candidate, ...]:
        return measure_candidates(photo, table, segment_objects_on_table(photo, table))

    for item in find_objects(frame, table, labels > 0, segment).objects:
        labels[item.mask] = item.id
    return labels


def _with_bar(scene: Rendered, rows: slice, columns: slice, near: float, far: float) -> RGBDFrame:
    """A round bar, from ``far`` to ``near`` metres from the camera down the picture."""
    depth = scene.frame.depth.copy()
    across = np.linspace(-1, 1, columns.stop - columns.start)
    axis = np.linspace(far, near, rows.stop - rows.start)[:, None]
    depth[rows, columns] = axis - 0.04 * np.sqrt(1 - 0.9 * across**2)
    return replace(scene.frame, depth=depth)


def test_an_arm_from_the_near_side_is_no_object(rendered: Rendered) -> None:
    labels = _segment(_with_bar(rendered, slice(200, 360), slice(220, 280), 0.35, 0.6))
    assert labels.max() == len(THINGS)
    assert not labels[210:, 235:265].any()


def test_an_arm_from_above_is_no_object(rendered: Rendered) -> None:
    labels = _segment(_with_bar(rendered, slice(0, 100), slice(210, 250), 0.7, 0.7))
    assert labels.max() == len(THINGS)
    assert not labels[10:90, 220:240].any()


def test_an_arm_from_above_is_no_object_where_the_depth_ends_before_the_picture(rendered: Rendered) -> None:
    frame = _with_bar(rendered, slice(0, 100), slice(210, 250), 0.7, 0.7)
    depth = frame.depth.copy()
    depth[:8], depth[:, :8] = 0, 0
    labels = _segment(replace(frame, depth=depth))
    assert labels.max() == len(THINGS)
    assert not labels[10:90, 220:240].any()


def test_a_box_that_the_picture_cuts_is_an_object() -> None:
    scene = render([Thing("box", (0.03, 0.0), (0.16, 0.15, 0.1)), *THINGS])
    cut = scene.labels == 1
    assert cut[-1].any()
    labels = _segment(scene.frame)
    assert labels.max() == len(THINGS) + 1
    assert np.unique(labels[cut & (labels > 0)]).size == 1


def test_where_the_arm_is_known_what_hides_its_foot_at_the_border_is_a_thing(rendered: Rendered) -> None:
    frame = _with_bar(rendered, slice(0, 60), slice(210, 250), 1.05, 1.05)
    told = replace(frame, camera=frame.camera.model_copy(update={"joints": (0.0,) * 6}))
    assert [_segment(one).max() - len(THINGS) for one in (frame, told)] == [0, 1]


def test_where_the_arm_is_known_what_reaches_down_to_the_table_from_the_border_is_a_thing(rendered: Rendered) -> None:
    frame = _with_bar(rendered, slice(200, 360), slice(220, 280), 0.5, 1.0)
    told = replace(frame, camera=frame.camera.model_copy(update={"joints": (0.0,) * 6}))
    assert [_segment(one)[300, 250] > 0 for one in (frame, told)] == [False, True]
