"""What a pixel shows where depth does not tell is told by its colour."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from grs_agents.perception.object_finding import FoundObjects, find_objects
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.segmentation.color_borders import fit_masks_to_color
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import Candidate, Mask, RGBDFrame
from tests.perception import room


def shadowed_photo(width: int) -> tuple[RGBDFrame, Mask, Mask]:
    """The room without the depth of a notch in the nearer thing and of the table in the shadow that a second lens does
    not see into, with noisy colours; where notch and shadow are."""
    frame, _, owner = room.photo(room.camera(width=width, height=width * 3 // 4))
    nearer = owner == room.THINGS[0]
    rows, columns = np.nonzero(nearer)
    across, down = np.meshgrid(np.arange(owner.shape[1]), np.arange(owner.shape[0]))
    low, high = np.percentile(rows, (35, 65))
    notch = nearer & (down > low) & (down < high) & (across > np.median(columns))
    shadow = (np.roll(nearer, -width // 16, axis=1) | np.roll(nearer, -width // 32, axis=1)) & (owner == room.TABLE[0])
    noise = np.random.default_rng(1).normal(scale=4.0, size=frame.rgb.shape)
    rgb = np.clip(frame.rgb + noise, 0, 255).astype(np.uint8)
    return replace(frame, rgb=rgb, depth=np.where(notch | shadow, np.float32(0), frame.depth)), notch, shadow


def objects_in(frame: RGBDFrame, given: bool, robot: Mask) -> FoundObjects:
    table = find_table(frame, np.random.default_rng(0))

    def segment(photo: RGBDFrame) -> tuple[Candidate, ...]:
        return measure_candidates(photo, table, segment_objects_on_table(photo, table), given)

    return find_objects(frame, table, robot, segment)


def owned_pixels(found: FoundObjects) -> Mask:
    return np.logical_or.reduce([one.mask for one in found.objects])


@pytest.mark.parametrize("width", [640, 1600])  # at 1600 the photo is segmented at a smaller size
def test_an_object_owns_the_pixels_without_depth_that_show_it(width: int) -> None:
    frame, notch, shadow = shadowed_photo(width)
    found = objects_in(frame, given=False, robot=np.zeros_like(notch))
    owned = owned_pixels(found)
    assert owned[notch].mean() > 0.9
    assert owned[shadow].mean() < 0.15
    (nearer,) = (one for one in found.objects if one.mask[notch].any())
    assert nearer.mask[notch].mean() > 0.9
    assert (nearer.crop > 100).any(axis=-1).sum() > 0.9 * nearer.mask.sum()  # what is not the object's is dimmed


def test_masks_of_the_user_and_the_robot_stay_as_they_are() -> None:
    frame, notch, _ = shadowed_photo(640)
    nothing = np.zeros_like(notch)
    assert owned_pixels(objects_in(frame, given=False, robot=nothing))[notch].mean() > 0.9
    assert owned_pixels(objects_in(frame, given=True, robot=nothing))[notch].mean() < 0.5
    assert owned_pixels(objects_in(frame, given=False, robot=notch))[notch].mean() < 0.5


@pytest.mark.parametrize("grown", [2, -2])
def test_noise_of_the_photo_does_not_move_a_border(grown: int) -> None:
    """Neighbouring pixels of one surface differ by a third of what the surfaces do."""
    frame, _, owner = room.photo(room.camera(width=640, height=480))
    shown = owner == room.THINGS[0]
    seen = (cv2.dilate if grown > 0 else cv2.erode)(shown.astype(np.uint8), np.ones((2 * abs(grown) + 1,) * 2)) > 0
    surfaces = frame.rgb[shown].mean(axis=0), frame.rgb[seen & ~shown if grown > 0 else ~shown].mean(axis=0)
    noise = np.random.default_rng(3).normal(scale=np.abs(np.subtract(*surfaces)).max() / 3, size=frame.rgb.shape)
    noisy = replace(frame, rgb=np.clip(frame.rgb + noise, 0, 255).astype(np.uint8))
    table = find_table(noisy, np.random.default_rng(0))
    (one,) = fit_masks_to_color(
        measure_candidates(noisy, table, seen.astype(np.int32)), noisy, left_out=np.zeros_like(shown)
    )
    assert (one.mask ^ shown).sum() <= 0.15 * (seen ^ shown).sum()


@pytest.mark.parametrize("grown", [2, 0, -2])
def test_the_border_of_an_object_moves_to_where_the_color_changes(grown: int) -> None:
    """Depth reaches ``grown`` pixels over the object's border onto the table, as a sensor's does."""
    frame, _, owner = room.photo(room.camera(width=640, height=480))
    shown = owner == room.THINGS[0]
    square = np.ones((2 * abs(grown) + 1,) * 2, np.uint8)
    change = cv2.dilate if grown > 0 else cv2.erode
    seen = change(shown.astype(np.uint8), square) > 0
    table = find_table(frame, np.random.default_rng(0))

    def segment(photo: RGBDFrame, given: bool = False) -> tuple[Candidate, ...]:
        return measure_candidates(photo, table, seen.astype(np.int32), given)

    found = find_objects(frame, table, np.zeros_like(shown), segment)
    (one,) = found.objects
    assert (one.mask ^ shown).sum() <= 0.6 * (seen ^ shown).sum() + 5  # the watershed's own line is a pixel wide
    assert (found.blur == seen & ~one.mask).all()
    assert (found.blur.sum() > 50) == (grown > 0)
    (given,) = find_objects(frame, table, np.zeros_like(shown), lambda photo: segment(photo, True)).objects
    assert (given.mask == seen).all()
