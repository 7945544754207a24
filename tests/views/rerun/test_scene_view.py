"""The photo in the recording."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from rerun.chunk import RrdReader

from grs_agents.base.errors import InputError
from grs_agents.base.trace.events import SceneStage
from grs_agents.library.library import Library
from grs_agents.views.rerun.recording import Paths, RerunRecording
from grs_agents.views.rerun.scene_view import SceneStageView

CAMERA = {"fx": 50.0, "fy": 50.0, "cx": 16.0, "cy": 12.0, "width": 32, "height": 24, "depth_scale": 0.001}


def test_the_cloud_lies_where_the_camera_says(recording: RerunRecording, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "rgb.png"), np.full((24, 32, 3), 200, np.uint8))
    depth = np.zeros((24, 32), np.uint16)
    depth[12, 16] = 800
    cv2.imwrite(str(tmp_path / "depth.png"), depth)
    pose = [[0, -1, 0, 0.5], [-1, 0, 0, 0.1], [0, 0, -1, 0.8], [0, 0, 0, 1]]
    view = SceneStageView(tmp_path, Library())
    files = {"rgb": "rgb.png", "depth": "depth.png"}
    view.show_scene_stage(recording, SceneStage(stage="frame", summary={"camera": CAMERA}, files=files))
    view.show_scene_stage(recording, SceneStage(stage="segmented", summary={"camera": {**CAMERA, "T_robot_cam": pose}}))
    recording.close()
    chunks = RrdReader(tmp_path / "a.rrd").stream().filter(content=f"{Paths.SCENE}/points").to_chunks()
    points = [row for chunk in chunks for row in chunk.to_record_batch().column("Points3D:positions").to_pylist()]
    assert np.allclose(points, [[[0.5, 0.1, 0.0]]], atol=1e-6)


def test_a_missing_picture_is_an_input_error(recording: RerunRecording, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot read .*lost\.png"):
        SceneStageView(tmp_path, Library()).show_scene_stage(
            recording, SceneStage(stage="frame", files={"rgb": "lost.png"})
        )


def test_objects_without_boxes_or_masks_are_still_listed(recording: RerunRecording, tmp_path: Path) -> None:
    objects = [{"name": "milk_1", "asset": "HOPE/Milk.urdf"}, {"id": 7, "description": "a box"}]
    SceneStageView(tmp_path, Library()).show_scene_stage(
        recording, SceneStage(stage="described", summary={"objects": objects})
    )
    recording.close()
    chunks = RrdReader(tmp_path / "a.rrd").stream().filter(content=Paths.OBJECTS).to_chunks()
    text = chunks[0].to_record_batch().column("TextDocument:text").to_pylist()[0][0]
    assert "| 1 | milk_1 | ? | HOPE/Milk.urdf |" in text
    assert "| 7 | a box | ? |  |" in text
