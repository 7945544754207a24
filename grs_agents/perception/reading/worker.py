"""Worker that reads an untrusted scene; the host's side is ``foreign_scene``."""

from pathlib import Path
from typing import Any

import numpy as np

from grs_agents.base.config.schema import CameraConfig
from grs_agents.perception.reading.frame_assembly import assemble_frame
from grs_agents.perception.reading.masks import read_masks
from grs_agents.perception.reading.scene_source import read_recording
from grs_agents.sandbox.harness.answers import answer_or_refuse, send_blob


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """Read the scene ``source``, or, if the request has a ``shape`` (rows, columns), its masks at that size."""
    source = Path(request["source"])

    def read_scene_masks() -> dict[str, Any]:
        rows, columns = request["shape"]
        masks = read_masks(source, (rows, columns))
        send_blob("labels", np.ascontiguousarray(masks.labels, np.int32).data)
        return {"names": list(masks.names)}

    def read_frame_or_photo() -> dict[str, Any]:
        """The frame; or the photo if it has no depth, which the host's depth tool estimates."""
        recording = read_recording(source, CameraConfig.model_validate(request.get("camera", {})))
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

    return answer_or_refuse(read_scene_masks if "shape" in request else read_frame_or_photo)
