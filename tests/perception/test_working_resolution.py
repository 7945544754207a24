"""Large photos are reduced without mixing surfaces, and answered at their own size."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import RGBDFrame
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask, repeat_cells, upscale_labels
from tests.perception.conftest import Rendered


def _enlarged(frame: RGBDFrame, factor: int) -> RGBDFrame:
    """Each pixel repeated, depth without interpolation."""
    camera = frame.camera
    large = camera.model_copy(
        update={
            "fx": camera.fx * factor,
            "fy": camera.fy * factor,
            "cx": (camera.cx + 0.5) * factor - 0.5,
            "cy": (camera.cy + 0.5) * factor - 0.5,
            "width": camera.width * factor,
            "height": camera.height * factor,
        }
    )
    rgb = cv2.resize(frame.rgb, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST).astype(np.uint8)
    return replace(frame, rgb=rgb, depth=np.kron(frame.depth, np.ones((factor, factor), np.float32)), camera=large)


def test_a_small_photo_is_left_as_it_is(rendered: Rendered) -> None:
    frame, factor = downscale_frame(rendered.frame)
    assert frame is rendered.frame
    assert factor == 1


def test_a_large_photo_is_reduced_to_where_it_came_from(rendered: Rendered) -> None:
    frame, factor = downscale_frame(_enlarged(rendered.frame, 4))
    assert factor == 3
    assert frame.depth.shape == (480, 640)
    back, factor = downscale_frame(_enlarged(rendered.frame, 5))
    assert factor == 4
    assert set(np.unique(back.depth)) <= set(np.unique(rendered.frame.depth))


def test_a_cell_without_enough_depth_has_none(rendered: Rendered) -> None:
    frame = _enlarged(rendered.frame, 4)
    frame.depth[:12, :12] = 0
    frame.depth[0, 0] = 1.0
    assert downscale_frame(frame)[0].depth[0, 0] == 0


def test_masks_are_reduced_and_enlarged_cell_by_cell(rendered: Rendered) -> None:
    large = _enlarged(rendered.frame, 4)
    small, factor = downscale_frame(large)
    mask = np.kron(rendered.labels > 0, np.ones((4, 4), np.bool_))
    reduced = downscale_mask(mask, factor)
    assert reduced.shape == small.depth.shape
    cells = np.zeros(small.depth.shape, np.bool_)
    cells[7, 11] = True
    full = repeat_cells(cells, large, factor)
    assert full.shape == mask.shape
    assert full[7 * factor : 8 * factor, 11 * factor : 12 * factor].all()
    assert full.sum() == factor**2
    assert (repeat_cells(reduced, large, factor) != mask).mean() < 0.02


@pytest.mark.parametrize("factor", [3, 4])
def test_the_full_size_gets_masks_of_its_own(rendered: Rendered, factor: int) -> None:
    large = _enlarged(rendered.frame, factor)
    labels = segment_objects_on_table(large, find_table(large, np.random.default_rng(0)))
    truth = np.kron(rendered.labels, np.ones((factor, factor), np.int32))
    assert labels.shape == truth.shape
    assert labels.max() == 4
    for thing in range(1, 5):
        mask = labels == np.bincount(labels[truth == thing]).argmax()
        assert (mask & (truth == thing)).sum() > 0.85 * (mask | (truth == thing)).sum()


def test_borders_follow_depth_and_colour_not_cells(rendered: Rendered) -> None:
    large = _enlarged(rendered.frame, 3)
    small, factor = downscale_frame(large)
    truth = np.kron(rendered.labels, np.ones((3, 3), np.int32))
    coarse = truth[::factor, ::factor][: small.depth.shape[0], : small.depth.shape[1]]
    sharp = upscale_labels(coarse, small, large, factor)
    blocky = np.kron(coarse, np.ones((factor, factor), np.int32))[: truth.shape[0], : truth.shape[1]]
    wrong = (sharp != truth).sum()
    assert wrong < 0.5 * (blocky != truth[: blocky.shape[0], : blocky.shape[1]]).sum()
