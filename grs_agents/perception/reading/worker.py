"""The worker's part of reading a scene that somebody else made; ``foreign_scene`` is the host's."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from grs_agents.perception.reading.frame_assembly import assemble_frame
from grs_agents.perception.reading.masks import read_masks
from grs_agents.perception.reading.scene_source import read_recording
from grs_agents.sandbox.harness.answers import answer_or_refuse, send_blob


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """The scene ``source``, or, where the request has a ``shape`` (rows, columns), its masks at that size."""
    source = Path(request["source"])
    return answer_or_refuse(
        partial(_read_masks, source, request["shape"]) if "shape" in request else partial(_read, source)
    )


def _read_masks(source: Path, shape: list[int]) -> dict[str, Any]:
    labels = read_masks(source, (shape[0], shape[1]))
    send_blob("labels", np.ascontiguousarray(labels, np.int32).data)
    return {}


def _read(source: Path) -> dict[str, Any]:
    """The frame; without depth, for which the host has a tool, the photo."""
    recording = read_recording(source)
    picture, camera = recording.picture, recording.camera
    if recording.measured is not None and camera is not None:
        frame = assemble_frame(recording, camera, recording.measured)
        del recording, picture
        send_blob("depth", np.ascontiguousarray(frame.depth, np.float32).data)
        rgb, camera, notes, photo = frame.rgb, frame.camera, frame.notes, None
    else:
        photo = {
            "file": str(picture.file),
            "orientation": picture.orientation,
            "focal_35mm": picture.focal_35mm,
        }
        rgb, notes = picture.rgb, recording.notes
    send_blob("rgb", np.ascontiguousarray(rgb, np.uint8).data)
    return {
        "rows": rgb.shape[0],
        "columns": rgb.shape[1],
        "camera": None if camera is None else camera.model_dump(mode="json"),
        "notes": list(notes),
        "photo": photo,
    }
