"""Picture files of a scene: frame, masks, crops, and an annotated photo for people."""

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
"""Largest side of the annotated photo, pixels: on a larger photo lines and numbers would be invisible."""
COLORS = ((230, 60, 60), (60, 180, 75), (60, 110, 230), (245, 160, 40), (150, 60, 190), (60, 200, 220), (230, 80, 200))


def save_frame(frame: RGBDFrame, run: Path) -> dict[str, str]:
    """Write ``scene/rgb.png`` and ``scene/depth.png`` (uint16, in the camera's unit); returns these names."""
    write_png(run / "scene/rgb.png", cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR))
    write_png(run / "scene/depth.png", _to_depth_units(frame))
    return {"rgb": "scene/rgb.png", "depth": "scene/depth.png"}


def round_depth_as_saved(frame: RGBDFrame, source: str) -> RGBDFrame:
    """The frame with its depth in whole units, as `load_frame` reads it after `save_frame`."""
    metres = depth_in_metres(_to_depth_units(frame), frame.camera.depth_scale)
    return RGBDFrame(frame.rgb, metres, frame.camera, Path(source))


def _to_depth_units(frame: RGBDFrame) -> npt.NDArray[np.uint16]:
    return np.rint(frame.depth / frame.camera.depth_scale).astype(np.uint16)


def load_frame(run: Path, camera: Camera, source: str) -> RGBDFrame:
    """Read the pictures of `save_frame`; raises InputError if they are gone."""
    color, depth = (read_picture(run / name, cv2.IMREAD_UNCHANGED) for name in ("scene/rgb.png", "scene/depth.png"))
    metres = depth_in_metres(depth, camera.depth_scale)
    return RGBDFrame(np.asarray(cv2.cvtColor(color, cv2.COLOR_BGR2RGB), np.uint8), metres, camera, Path(source))


def load_mask(file: Path) -> Mask:
    """Read a mask (H, W) of `save_candidates`; raises InputError if it is gone."""
    return read_picture(file, cv2.IMREAD_UNCHANGED) > 0


def save_candidates(frame: RGBDFrame, candidates: Sequence[Candidate], run: Path) -> tuple[CandidateRecord, ...]:
    """Write each candidate's mask and crop, the label image ``scene/masks.png`` and the annotated photo."""
    return save_candidates_after_earlier(frame, candidates, (), run)


def save_candidates_after_earlier(
    frame: RGBDFrame, candidates: Sequence[Candidate], earlier: Sequence[CandidateRecord], run: Path
) -> tuple[CandidateRecord, ...]:
    """As `save_candidates`; label image and annotated photo show the ``earlier`` candidates below the new."""
    records = tuple(save_candidate(candidate, run) for candidate in candidates)
    masks = {record.id: load_mask(run / record.mask) for record in earlier}
    save_label_pictures(frame, masks | {candidate.id: candidate.mask for candidate in candidates}, run)
    return records


def save_candidate(candidate: Candidate, run: Path) -> CandidateRecord:
    """Write the mask and the crop of a candidate."""
    mask, crop = f"scene/mask_{candidate.id:02d}.png", f"scene/crop_{candidate.id:02d}.png"
    flags = (cv2.IMWRITE_PNG_BILEVEL, 1)  # three times as fast to read
    write_png(run / mask, candidate.mask.view(np.uint8), *flags)
    write_png(run / crop, cv2.cvtColor(candidate.crop, cv2.COLOR_RGB2BGR))
    return CandidateRecord.model_validate({**vars(candidate), "mask": mask, "crop": crop})


def save_label_pictures(frame: RGBDFrame, masks: Mapping[int, Mask], run: Path) -> None:
    """Write the label image ``scene/masks.png`` and the annotated photo of masks (H, W) by number."""
    labels = np.zeros(frame.depth.shape, np.uint8)
    for number, mask in masks.items():
        labels[mask] = number
    write_png(run / "scene/masks.png", labels)
    write_png(run / "scene/annotated.png", cv2.cvtColor(draw_candidate_overlay(frame, masks), cv2.COLOR_RGB2BGR))


def load_candidates(records: Sequence[CandidateRecord], run: Path) -> tuple[Candidate, ...]:
    """Read candidates that `save_candidates` wrote; raises InputError if their pictures are gone."""
    return tuple(
        Candidate(
            mask=load_mask(run / record.mask),
            crop=np.asarray(
                cv2.cvtColor(read_picture(run / record.crop, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB), np.uint8
            ),
            **{name: getattr(record, name) for name in CandidateRecord.model_fields if name not in ("mask", "crop")},
        )
        for record in records
    )


def draw_candidate_overlay(frame: RGBDFrame, masks: Mapping[int, Mask]) -> Image:
    """The photo, at most `ANNOTATED_SIDE` large, with the mask, outline and number of each candidate."""
    picture = frame.rgb.copy()
    if (scale := ANNOTATED_SIDE / max(frame.depth.shape)) < 1:
        picture = np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
        size = picture.shape[1::-1]
        resized = {
            number: np.asarray(cv2.resize(mask.view(np.uint8), size, interpolation=cv2.INTER_NEAREST), np.bool_)
            for number, mask in masks.items()
        }
        masks = {number: mask for number, mask in resized.items() if mask.any()}
    for number, mask in masks.items():
        color = COLORS[number % len(COLORS)]
        window = mask_bounding_slices(mask)
        part, pixels = picture[window], mask[window]
        part[pixels] = (0.6 * part[pixels] + 0.4 * np.array(color)).astype(np.uint8)
        top_left = (window[1].start, window[0].start)
        outlines, _ = cv2.findContours(
            pixels.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE, offset=top_left
        )
        cv2.drawContours(picture, outlines, -1, color, 2)
    for number, mask in masks.items():
        window = mask_bounding_slices(mask)
        rows, columns = np.nonzero(mask[window])
        place = (window[1].start + int(columns.mean()) - 6, window[0].start + int(rows.mean()) + 6)
        for thickness, color in ((4, (0, 0, 0)), (1, (255, 255, 255))):
            cv2.putText(picture, str(number), place, cv2.FONT_HERSHEY_SIMPLEX, 0.6, color, thickness, cv2.LINE_AA)
    return picture


def write_png(file: Path, image: "npt.NDArray[np.integer[Any] | np.floating[Any]]", *flags: int) -> None:
    """Write a picture, blue first; ``flags`` are those of ``cv2.imencode``."""
    write_bytes(file, cv2.imencode(".png", image, flags)[1].tobytes())
