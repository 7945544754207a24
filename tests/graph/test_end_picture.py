"""Models that see get a picture of the end with the object at fault outlined; others cost nothing."""

from typing import Any

import cv2
import numpy as np
import pytest

from grs_agents.base.config.schema import ModelConfig
from grs_agents.graph.fixing import fix_code
from grs_agents.graph.judging import decide_what_to_fix
from grs_agents.graph.state import RunState
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
