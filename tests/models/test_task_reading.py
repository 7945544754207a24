"""A task of any author is done as its words say, or refused; never another one in its place."""

import pytest

from grs_agents.models.offline import program_edits
from grs_agents.models.offline.chat import OfflineChatModel
from tests.models.conftest import Json, render, rich_scene, scene_object
from tests.models.roles import API, as_text, simulation_for, unit_tests_for

ZONE, CONTAINER = "zone/zone-template.urdf", "container/container-template.urdf"
RED_BOX, RED_CAN, BLUE_BOX, BLUE_CAN = (
    f"proxy/{name}_1.urdf" for name in ("red_box", "red_can", "blue_box", "blue_can")
)
BASKET = "proxy/basket_1.urdf"


def scene_with_basket() -> Json:
    """The rich scene with a basket in place of its tall carton."""
    basket = scene_object("basket_1", (0.62, 0.35), (0.24, 0.24, 0.08), "brown", "basket")
    return {"objects": [*rich_scene()["objects"][:7], {**basket, "hollow": True}]}


def task(description: str, *assets: str) -> Json:
    return {"task-name": "a-task-of-another-author", "task-description": description, "assets-used": list(assets)}


def reply_to(asked: Json) -> str:
    values = {"task": as_text(asked), "scene": as_text(scene_with_basket()), "api": API, "examples": ""}
    return str(OfflineChatModel().invoke(render("simulation", values)).text)


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (task("Put the red can and the blue can into the basket.", RED_CAN, BLUE_CAN, BASKET), ["into the {}"]),
        (task("Pack both cans into the basket.", RED_CAN, BLUE_CAN, BASKET), ["into the {}", "basket_1_pose"]),
        (task("Swap the red box and the blue box.", RED_BOX, BLUE_BOX), ["place_of_red_box_1", "place_of_blue_box_1"]),
        (
            task("Put the blue can onto the red box.", BLUE_CAN, RED_BOX),
            ['"fixed"', "The red box serves where it stands"],
        ),
        (
            task("Put the cans into the basket, then stack the blue box on the red box.", RED_CAN, BLUE_CAN, BASKET)
            | {"assets-used": [RED_CAN, BLUE_CAN, BASKET, BLUE_BOX, RED_BOX]},
            ["step_max_reward=1 / 3", "basket_1_pose", "red_box_1_pose"],
        ),
        (
            task("Put the cans on the red zone and move the boxes onto the blue zone.", RED_CAN, BLUE_CAN)
            | {"assets-used": [RED_CAN, BLUE_CAN, RED_BOX, BLUE_BOX, ZONE]},
            ["red_zone_pose", "blue_zone_pose", "step_max_reward=1 / 4"],
        ),
    ],
)
def test_the_words_are_followed(asked: Json, told: list[str]) -> None:
    code = simulation_for(asked, scene_with_basket())
    assert program_edits.find_asset_names(code) == set(asked["assets-used"])
    assert "class ATaskOfAnotherAuthor(Task):" in code
    for words in told:
        assert words in code


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (task("Put the red can beside the blue can.", RED_CAN, BLUE_CAN), "beside"),
        (task("Arrange the cans in a circle.", RED_CAN, BLUE_CAN), "circle"),
        (task("Sort the cans by weight.", RED_CAN, BLUE_CAN, ZONE), "by weight"),
        (task("Put the red can on the green zone.", RED_CAN), ZONE),
        (task("Put the red can into the mug.", RED_CAN, "HOPE/Mug.urdf"), "HOPE/Mug.urdf"),
        (task("Put the red can on the green zone.", RED_CAN, ZONE, BLUE_CAN), BLUE_CAN),
        (task("Stack the red box on the blue can.", RED_BOX, BLUE_CAN), "stack"),
    ],
)
def test_what_no_family_does_is_refused_with_the_reason(asked: Json, told: str) -> None:
    reply = reply_to(asked)
    assert "```" not in reply
    assert told in reply


def test_tests_ask_for_what_the_words_move() -> None:
    asked = task("Put the red can into the basket.", RED_CAN, BASKET)
    tests = unit_tests_for(asked, simulation_for(asked, scene_with_basket()))
    assert f"('{RED_CAN}', 0, " in tests.partition("MOVES = [")[2].partition("]")[0]
