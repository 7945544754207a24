"""What else the photo shows stands on the table of its tasks, in the tests and in the audit."""

import json
import math
from typing import Any

import pytest

from grs_agents.base.errors import InputError
from grs_agents.graph.bystanders import photo_objects, prepare_scene_for_tasks, program_tool_settings
from grs_agents.graph.judging import audit_task, run_tests
from grs_agents.graph.perceive import require_movable_object
from grs_agents.graph.scene_prompt import scene_for_prompt
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState
from grs_agents.library.library import Library
from grs_agents.perception.types import SceneDescription
from grs_agents.sim import TaskInstance
from grs_agents.sim.arms.registry import get_arm
from tests.graph.conftest import SIMULATION, TESTS, Make, block, kinds, run, with_

GREEN = "block/green_block.urdf"


def scene_of(state: RunState, *changes: dict[str, Any]) -> SceneDescription:
    """The scene of three blocks, some of them changed."""
    objects = [block("red", 1), block("blue", 2), block("green", 3)]
    return SceneDescription.model_validate({**dict(state["scene"]), "objects": [*map(dict, objects), *changes]})


def moved(number: int, x: float, y: float, z: float = 0.02, **fields: Any) -> dict[str, Any]:
    """A small yellow block somewhere."""
    return {
        **block("red", number),
        "name": f"yellow_block_{number}",
        "asset": "block/yellow_block.urdf",
        "box": {"low": (x - 0.02, y - 0.02, z - 0.02), "high": (x + 0.02, y + 0.02, z + 0.02)},
        "position": (x, y, z),
        **fields,
    }


def instance_in(services: Services) -> TaskInstance:
    return TaskInstance.model_validate(json.loads((services.folder / "instances/seed_0.json").read_text()))


def test_a_scene_is_refused_only_if_no_object_can_be_reached_and_moved(state: RunState) -> None:
    scene, arm = scene_of(state, moved(4, 0.9, 0.0, reachable=False)), get_arm("ur5e")
    require_movable_object(scene, arm)
    stuck = [{"reachable": False}, {"held": True}, {"reachable": False, "stands_in_robot": True}]
    fixed = [item.model_copy(update=change) for item, change in zip(scene.objects, stuck, strict=False)]
    with pytest.raises(InputError, match=r"move none of 3 objects: .* out of reach, .* would fall, .* in the robot"):
        require_movable_object(scene.model_copy(update={"objects": tuple(fixed)}), arm)
    heavy = [item.model_copy(update={"pick_trouble": "it weighs 4 kg"}) for item in scene.objects]
    require_movable_object(scene.model_copy(update={"objects": (scene.objects[0], *heavy[1:])}), arm)
    words = rf"can pick none of {len(heavy)} objects: {heavy[0].name}: it weighs 4 kg; .* 0\.85 m from its base, up to"
    with pytest.raises(InputError, match=words):
        require_movable_object(scene.model_copy(update={"objects": tuple(heavy)}), arm)


def test_photo_objects_stand_where_they_came_to_rest(state: RunState) -> None:
    rest = ((0.31, 0.41, 0.019), (0.0, 0.0, 0.0, 1.0))
    scene = scene_of(state, moved(4, 0.3, 0.4, settled=rest), moved(5, 0.6, -0.4, 0.3, held=True))
    found = photo_objects(scene, Library())
    assert [item.id for item in found] == [50_000, 50_001, 50_002, 50_003, 50_004]
    assert {item.role for item in found} == {"bystander"}
    assert [item.category for item in found] == ["rigid"] * 4 + ["fixed"]
    assert found[3].pose == rest


@pytest.mark.parametrize(
    ("x", "y", "near"), [(0.91, 0.0, True), (0.93, 0.0, False), (0.5, -0.66, True), (0.5, 0.7, False)]
)
def test_photo_objects_are_those_up_to_15_cm_around_the_workspace(
    state: RunState, x: float, y: float, near: bool
) -> None:
    found = photo_objects(scene_of(state, moved(4, x, y)), Library())
    assert len(found) == 3 + near


def test_what_does_not_stay_is_held_the_lowest_first(state: RunState) -> None:
    in_air, on_it = moved(4, 0.6, -0.3, 0.12), moved(5, 0.6, -0.3, 0.16)
    held = prepare_scene_for_tasks(scene_of(state, in_air, on_it), Library(), "ur5e")
    assert [item.held for item in held.objects] == [False, False, False, True, False]
    assert held == prepare_scene_for_tasks(held, Library(), "ur5e")


def test_the_scene_tells_what_the_robot_cannot_pick(state: RunState) -> None:
    """One carries another, and one is held by a roof that the cup does not get under; the rest it lifts."""
    lower, upper = moved(4, 0.6, -0.3), moved(5, 0.6, -0.3, 0.06)
    under, roof = moved(6, 0.35, -0.3), moved(7, 0.35, -0.3, 0.2, held=True)
    scene = prepare_scene_for_tasks(scene_of(state, lower, upper, under, roof), Library(), "ur5e")
    troubles = {item.name: item.pick_trouble for item in scene.objects if item.pick_trouble}
    assert troubles.keys() == {"yellow_block_4", "yellow_block_6"}
    assert troubles["yellow_block_4"] == "it carries yellow_block_5"
    assert "covered by" in troubles["yellow_block_6"] and "yellow_block_7" in troubles["yellow_block_6"]
    told = {item["name"]: item.get("cannot_be_picked") for item in scene_for_prompt(scene, Library())["objects"]}
    assert {name: why for name, why in told.items() if why} == troubles


def test_an_object_seen_too_sparsely_stays_a_bystander_that_the_authors_are_told_to_leave(state: RunState) -> None:
    doubt = "seen too sparsely to be sure of it: 120 measured pixels, 4.1 cm2"
    near, covered, on_it = moved(4, 0.6, -0.3), moved(5, 0.35, -0.3), moved(6, 0.35, -0.3, 0.06)
    for item in (near, covered):
        item["pick_trouble"] = doubt
    scene = prepare_scene_for_tasks(scene_of(state, near, covered, on_it), Library(), "ur5e")
    both = f"{doubt}; it carries yellow_block_6"
    assert [item.pick_trouble for item in scene.objects] == ["", "", "", doubt, both, ""]
    assert prepare_scene_for_tasks(scene, Library(), "ur5e") == scene
    assert [item.id for item in photo_objects(scene, Library())][3:] == [50_003, 50_004, 50_005]
    told = [item.get("cannot_be_picked") for item in scene_for_prompt(scene, Library())["objects"]]
    assert told[3:5] == [doubt, both]


def test_what_stands_where_the_robot_does_is_left_out(state: RunState) -> None:
    wide = {"low": (-0.15, -0.1, 0.05), "high": (0.15, 0.1, 0.12)}
    state_of_all = scene_of(state, moved(4, 0.0, 0.0, 0.1, held=True, box=wide))
    scene = prepare_scene_for_tasks(state_of_all, Library(), "ur5e")
    assert [item.stands_in_robot for item in scene.objects] == [False, False, False, True]
    assert [item.id for item in photo_objects(scene, Library())] == [50_000, 50_001, 50_002]
    assert scene_for_prompt(scene, Library())["objects"][3]["reachable"] is False


def test_the_audit_is_about_instances_among_all_that_the_photo_shows(state: RunState, make_services: Make) -> None:
    services = make_services()
    update = run(audit_task, state, services)
    instance = instance_in(services)
    assert [(item.asset, item.role) for item in instance.objects][2:] == [(GREEN, "bystander")]
    rollout = update["audit"].rollouts[0]
    assert math.dist(rollout.final[50_002][0], (0.55, 0.3, 0.02)) < 0.01
    assert "scene.bystanders" not in update["audit"].about


def test_what_is_left_out_is_in_the_record(state: RunState, make_services: Make) -> None:
    services = make_services(scene={"bystanders": False})
    update = run(audit_task, state, services)
    assert all(item.role == "task" for item in instance_in(services).objects)
    assert "scene.bystanders = false" in update["audit"].about
    assert any("scene.bystanders = false" in event.text for event in kinds(services, "note"))


def test_a_program_cannot_choose_its_bystanders(state: RunState, make_services: Make) -> None:
    """It takes the green block off the table behind the environment's back, and puts another one there."""
    forged = SIMULATION + (
        "        from grs_agents.sim import InstanceObject\n"
        "        from grs_agents.sim.world import context\n"
        "        away = ((0.3, -0.4, 0.02), (0, 0, 0, 1))\n"
        "        forged = InstanceObject(id=60_000, asset='block/gray_block.urdf', pose=away, role='bystander')\n"
        "        object.__setattr__(context.PROCESS_CONTEXT, 'bystanders', (forged,))\n"
    )
    services = make_services()
    run(audit_task, with_(state, simulation=forged), services)
    assert [(item.id, item.asset) for item in instance_in(services).objects][2:] == [(50_002, GREEN)]


SEES = TESTS.replace(
    "        self.assertEqual(len(task.goals), 2)\n",
    "        self.assertEqual(env.physics.surface_height_below(0.55, 0.3)[1], 50_002)\n"
    "        self.assertEqual(env.find('block/green_block.urdf'), [])\n",
)


def test_the_tests_run_among_all_that_the_photo_shows(state: RunState, make_services: Make) -> None:
    services = make_services()
    update = run(run_tests, with_(state, tests=SEES), services)
    assert update["report"].outcome == "passed", update["report"]
    bare = make_services(scene={"bystanders": False})
    assert run(run_tests, with_(state, tests=SEES), bare)["report"].outcome == "failed"


def test_without_a_photo_nothing_stands_around(state: RunState, make_services: Make) -> None:
    services = make_services()
    assert program_tool_settings(None, services)["bystanders"] == ()
    assert len(program_tool_settings(state["scene"], services)["bystanders"]) == 3
