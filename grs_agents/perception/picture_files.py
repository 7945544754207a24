"""Pictures of a scene: the frame, masks and crops as files, and an annotated photo for people."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base.files import write_bytes
from grs_agents.base.foreign.pictures import read_picture
from grs_agents.perception.image_geometry import depth_in_metres, mask_bounding_slices
from grs_agents.perception.types import Camera, Candidate, CandidateRecord, Image, Mask, RGBDFrame

ANNOTATED_SIDE = 1280
"""Pixels of the longer side of the annotated photo at most: on a larger one its lines and numbers could not be seen."""
COLORS = ((230, 60, 60), (60, 180, 75), (60, 110, 230), (245, 160, 40), (150, 60, 190), (60, 200, 220), (230, 80, 200))


def save_frame(frame: RGBDFrame, run: Path) -> dict[str, str]:
    """Write ``scene/rgb.png`` and ``scene/depth.png`` (uint16, in the camera's unit); returns these names."""
    write_png(run / "scene/rgb.png", cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR))
    write_png(run / "scene/depth.png", _to_depth_units(frame))
    return {"rgb": "scene/rgb.png", "depth": "scene/depth.png"}


def round_depth_as_saved(frame: RGBDFrame, source: str) -> RGBDFrame:
    """The frame that `load_frame` would read of what `save_frame` wrote: its depth is in whole units."""
    metres = depth_in_metres(_to_depth_units(frame), frame.camera.depth_scale)
    return RGBDFrame(frame.rgb, metres, frame.camera, Path(source))


def _to_depth_units(frame: RGBDFrame) -> npt.NDArray[np.uint16]:
    return np.rint(frame.depth / frame.camera.depth_scale).astype(np.uint16)


def load_frame(run: Path, camera: Camera, source: str) -> RGBDFrame:
    """Read again what `save_frame` wrote; raises InputError if the pictures are gone."""
    color, depth = (read_picture(run / name, cv2.IMREAD_UNCHANGED) for name in ("scene/rgb.png", "scene/depth.png"))
    metres = depth_in_metres(depth, camera.depth_scale)
    return RGBDFrame(np.asarray(cv2.cvtColor(color, cv2.COLOR_BGR2RGB), np.uint8), metres, camera, Path(source))


def load_mask(file: Path) -> Mask:
    """Read a mask that `save_candidates` wrote, (H, W) bool; raises InputError if it is gone."""
    return read_picture(file, cv2.IMREAD_UNCHANGED) > 0


def save_candidates(frame: RGBDFrame, candidates: Sequence[Candidate], run: Path) -> tuple[CandidateRecord, ...]:
    """Write each candidate's mask and crop, the label image ``scene/masks.png`` and the annotated photo."""
    return save_candidates_after_earlier(frame, candidates, (), run)


def save_candidates_after_earlier(
    frame: RGBDFrame, candidates: Sequence[Candidate], earlier: Sequence[CandidateRecord], run: Path
) -> tuple[CandidateRecord, ...]:
    """Write candidates like `save_candidates`; label image and annotated photo show the ``earlier`` ones below them."""
    records = tuple(_save_mask_and_crop(one, run) for one in candidates)
    masks = {one.id: load_mask(run / one.mask) for one in earlier} | {one.id: one.mask for one in candidates}
    labels = np.zeros(frame.depth.shape, np.uint8)
    for number, mask in masks.items():
        labels[mask] = number
    write_png(run / "scene/masks.png", labels)
    write_png(run / "scene/annotated.png", cv2.cvtColor(draw_candidate_overlay(frame, masks), cv2.COLOR_RGB2BGR))
    return records


def _save_mask_and_crop(one: Candidate, run: Path) -> CandidateRecord:
    mask, crop = f"scene/mask_{one.id:02d}.png", f"scene/crop_{one.id:02d}.png"
    write_png(run / mask, one.mask.view(np.uint8), cv2.IMWRITE_PNG_BILEVEL, 1)  # three times as fast to read
    write_png(run / crop, cv2.cvtColor(one.crop, cv2.COLOR_RGB2BGR))
    return CandidateRecord.model_validate({**vars(one), "mask": mask, "crop": crop})


def draw_candidate_overlay(frame: RGBDFrame, masks: Mapping[int, Mask]) -> Image:
    """The photo, at most `ANNOTATED_SIDE` large, with the mask, outline and number of each candidate."""
    picture = frame.rgb.copy()
    if (scale := ANNOTATED_SIDE / max(frame.depth.shape)) < 1:
        picture = np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
        masks = {number: _resize_mask(mask, picture.shape) for number, mask in masks.items()}
        masks = {number: mask for number, mask in masks.items() if mask.any()}
    for number, mask in masks.items():
        color = COLORS[number % len(COLORS)]
        window = mask_bounding_slices(mask)
        part, own = picture[window], mask[window]
        part[own] = (0.6 * part[own] + 0.4 * np.array(color)).astype(np.uint8)
        top_left = (window[1].start, window[0].start)
        outlines, _ = cv2.findContours(
            own.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE, offset=top_left
        )
        cv2.drawContours(picture, outlines, -1, color, 2)
    for number, mask in masks.items():
        window = mask_bounding_slices(mask)
        rows, columns = np.nonzero(mask[window])
        place = (window[1].start + int(columns.mean()) - 6, window[0].start + int(rows.mean()) + 6)
        for thickness, color in ((4, (0, 0, 0)), (1, (255, 255, 255))):
            cv2.putText(picture, str(number), place, cv2.FONT_HERSHEY_SIMPLEX, 0.6, color, thickness, cv2.LINE_AA)
    return picture


def _resize_mask(mask: Mask, shape: tuple[int, ...]) -> Mask:
    """A mask at the size of a picture of ``shape`` (h, w, ...)."""
    resized = cv2.resize(mask.view(np.uint8), shape[1::-1], interpolation=cv2.INTER_NEAREST)
    return np.asarray(resized, np.bool_)


def write_png(file: Path, image: "npt.NDArray[np.integer[Any] | np.floating[Any]]", *flags: int) -> None:
    """Write a picture, blue first; ``flags`` are those of ``cv2.imencode``."""
    write_bytes(file, cv2.imencode(".png", image, flags)[1].tobytes())
