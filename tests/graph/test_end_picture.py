"""Models that see get a picture of the end with the object at fault outlined; others cost nothing."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from grs_agents.base.config.schema import ModelConfig
from grs_agents.base.geometry.transforms import matrix_to_quaternion
from grs_agents.graph.evidence import draw_from_photo
from grs_agents.graph.fixing import fix_code
from grs_agents.graph.judging import decide_what_to_fix
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState
from grs_agents.sim.instance.task_instance import InstanceCamera, InstanceObject, TaskInstance
from grs_agents.sim.world.spec import TIMESTEP
from tests.graph.conftest import SIMULATION, Make, fenced, kinds, run, with_

OUT_OF_REACH = SIMULATION.replace("(0.6, 0.0)", "(1.6, 0.0)")
SEES = {"default": ModelConfig(model="openai:any")}
REPORT = {"outcome": "failed", "cases": [{"id": "T.test_a", "outcome": "failed", "message": "1 != 2"}]}


def test_the_object_at_fault_is_outlined_and_shown_beside_the_photo(state: RunState, make_services: Make) -> None:
    services = make_services("Out of reach.\n```\nfix_code\n```", fenced(SIMULATION), models=SEES)
    failed = with_(state, simulation=OUT_OF_REACH, report=REPORT)
    run(decide_what_to_fix, failed, services)
    run(fix_code, failed, services)
    path = "history/end_000.png"
    routed, fixed = kinds(services, "prompt")
    assert (routed.images, fixed.images) == ((path,), ("scene/annotated.png", path))
    picture = cv2.imread(str(services.folder / path))
    assert picture is not None
    outlined = (abs(picture.astype(int) - (255, 0, 255)) < 20).all(axis=2)
    holes = cv2.connectedComponentsWithStats(np.asarray(~outlined, np.uint8), connectivity=4)
    areas = sorted(range(1, holes[0]), key=lambda label: -holes[2][label, cv2.CC_STAT_AREA])
    blue, _, red = picture[holes[1] == areas[1]].mean(axis=0)  # the largest area is what is around the outline
    assert blue > 2 * red  # the blue block is the one at fault


def lens_at(azimuth: float, focal: float = 300.0) -> InstanceCamera:
    """A camera that looks at the middle of the table from ``azimuth`` degrees about it; 180 is the robot's side."""
    turn, down = np.radians(azimuth), np.radians(45)
    forward = np.array([-np.cos(turn) * np.cos(down), -np.sin(turn) * np.cos(down), -np.sin(down)])
    right = np.cross(forward, (0.0, 0.0, 1.0)) / np.cos(down)
    rotation = np.stack([right, np.cross(forward, right), forward], axis=1)
    x, y, z = (np.array([0.5, 0.0, 0.0]) - 0.9 * forward).tolist()
    return InstanceCamera(
        width=320, height=240, fx=focal, fy=focal, cx=160, cy=120, pose=((x, y, z), matrix_to_quaternion(rotation))
    )


@pytest.mark.parametrize(("camera", "left"), [(None, "red"), (lens_at(180), "red"), (lens_at(0), "green")])
def test_the_end_is_seen_from_the_photos_camera_or_else_from_the_robots_side(
    camera: InstanceCamera | None, left: str, make_services: Make
) -> None:
    """The red block stands on the robot's left, which is right in a photo of a camera that faces the robot."""
    picture = draw_blocks(camera, 0.2, make_services())
    columns = {
        name: np.argwhere((picture[..., band].astype(int) - np.delete(picture, band, 2).max(axis=2)) > 40)[:, 1].mean()
        for name, band in (("red", 2), ("green", 1))
    }
    assert min(columns, key=lambda name: columns[name]) == left


def test_a_picture_is_widened_for_an_object_that_was_taken_out_of_the_photos_view(make_services: Make) -> None:
    near, far = (draw_blocks(lens_at(180, 500.0), y, make_services()) for y in (0.1, 0.3))
    assert near.shape == (240, 320, 3)
    assert far.shape[0] == 240 and far.shape[1] > 320
    red = (far[..., 2].astype(int) - far[..., :2].max(axis=2)) > 60
    assert red.any() and not red[:, 0].any()


def draw_blocks(camera: InstanceCamera | None, y: float, services: Services) -> npt.NDArray[np.uint8]:
    """The picture of a red block at ``y`` (m) and a green block on the other side."""
    blocks = tuple(
        InstanceObject(id=number, asset=f"block/{color}_block.urdf", pose=((0.5, side, 0.02), (0, 0, 0, 1)))
        for number, (color, side) in enumerate((("red", y), ("green", -0.1)), 1)
    )
    instance = TaskInstance(
        task="t", seed=0, max_steps=1, timestep=TIMESTEP, goals=(), objects=blocks, robot="ur5e", camera=camera
    )
    output = services.folder / "drawn.png"
    assert draw_from_photo(instance, {item.id: item.pose for item in blocks}, output, services)
    picture = cv2.imread(str(output))
    assert picture is not None
    return np.asarray(picture, np.uint8)


@pytest.mark.parametrize("settings", [{}, {"models": SEES, "end_picture": False}])
def test_no_picture_is_drawn_for_models_that_see_none(
    state: RunState, make_services: Make, settings: dict[str, Any]
) -> None:
    services = make_services(fenced(SIMULATION), **settings)
    run(fix_code, with_(state, simulation=OUT_OF_REACH, report=REPORT), services)
    assert kinds(services, "prompt")[0].images == ("scene/annotated.png",)
    assert not list((services.folder / "history").glob("end_*"))


def test_a_program_that_gives_no_instance_has_no_picture(state: RunState, make_services: Make) -> None:
    services = make_services(fenced(SIMULATION), models=SEES)
    run(fix_code, with_(state, simulation="raise RuntimeError", report=REPORT), services)
    assert kinds(services, "prompt")[0].images == ("scene/annotated.png",)
