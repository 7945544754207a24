"""The authoring nodes ask for a task and two programs, keep every version, and count every fix."""

import json
from pathlib import Path
from typing import Any

import pytest

from grs_agents.base.errors import GrsError
from grs_agents.graph.authoring import generate_sim, generate_task, generate_tests, next_step_after_author
from grs_agents.graph.fix_history import describe_fix_history
from grs_agents.graph.fixing import fix_code, fix_tests
from grs_agents.graph.judging import conclude_with_best_version
from grs_agents.graph.services import Node
from grs_agents.graph.state import RunState, state_as_json
from tests.graph.conftest import SIMULATION, TASK, TESTS, Make, fenced, kinds, run, with_

REPORT = {"outcome": "failed", "cases": [{"id": "T.test_a", "outcome": "failed", "message": "1 != 2"}]}
AUDIT: dict[str, Any] = {"accepted": False, "findings": [], "changes": [], "rollouts": [], "rewards": []}
BETTER = SIMULATION.replace("self.max_steps = 6", "self.max_steps = 8")


@pytest.fixture
def unwritten(state: RunState) -> RunState:
    """The state before anything was written for the scene."""
    return with_(state, task=..., simulation=..., simulation_version=..., tests=..., tests_version=...)


def test_a_task_is_defined_from_the_scene_and_its_picture(unwritten: RunState, make_services: Make) -> None:
    services = make_services(fenced(json.dumps(TASK), "json"))
    update = run(generate_task, unwritten, services)
    assert state_as_json(update) == {"task": TASK, "revisable": True}
    assert next_step_after_author(with_(unwritten, **update)) == "ok"
    assert json.loads((services.folder / "task.json").read_text()) == TASK
    assert [event.task for event in kinds(services, "task_defined")] == [TASK]
    [prompt] = kinds(services, "prompt")
    assert prompt.images == ("scene/annotated.png",)
    assert "block/green_block.urdf" in prompt.text


def test_a_task_with_what_the_scene_lacks_is_asked_for_again(unwritten: RunState, make_services: Make) -> None:
    foreign = {**TASK, "assets-used": ["HOPE/Milk.urdf"]}
    services = make_services(fenced(json.dumps(foreign), "json"), fenced(json.dumps(TASK), "json"))
    assert run(generate_task, unwritten, services)["task"].as_json() == TASK
    assert "HOPE/Milk.urdf" in kinds(services, "prompt")[1].text


AUTHORS: dict[str, Node] = {
    "task": generate_task,
    "simulation": generate_sim,
    "tests": generate_tests,
}


@pytest.mark.parametrize("role", AUTHORS)
def test_an_author_without_a_usable_reply_ends_the_run_with_a_reason(
    state: RunState, make_services: Make, role: str
) -> None:
    services = make_services("No.", "No, really.", reply_retries=1)
    update = run(AUTHORS[role], state, services)
    assert set(update) == {"problem"}
    assert f"the {role} model gave no usable reply in 2 tries" in update["problem"]
    assert next_step_after_author(with_(state, **update)) == "stop"
    ended = run(conclude_with_best_version, with_(state, **update), services)
    assert ended == {"status": "rejected", "reason": update["problem"]}
    assert not (services.folder / "history").exists()


def test_the_first_program_is_kept_with_its_history(unwritten: RunState, make_services: Make) -> None:
    services = make_services(fenced(SIMULATION))
    update = run(generate_sim, with_(unwritten, task=TASK), services)
    assert update == {"simulation": SIMULATION, "simulation_version": 1}
    assert (services.folder / "simulation.py").read_text() == SIMULATION
    assert (services.folder / "history" / "simulation_001.py").read_text() == SIMULATION
    [version] = kinds(services, "program_version")
    assert (version.program, version.number, version.parent) == ("simulation", 1, None)
    [prompt] = kinds(services, "prompt")
    assert prompt.images == ("scene/annotated.png",)
    assert "move the red and the blue block" in prompt.text and "add_goal(" in prompt.text


def test_the_tests_are_written_from_task_and_program_alone(unwritten: RunState, make_services: Make) -> None:
    services = make_services(fenced(TESTS))
    written = with_(unwritten, task=TASK, simulation=SIMULATION, simulation_version=1)
    assert run(generate_tests, written, services) == {"tests": TESTS, "tests_version": 1}
    assert (services.folder / "test_simulation.py").read_text() == TESTS
    [prompt] = kinds(services, "prompt")
    assert not prompt.images
    assert SIMULATION.strip() in prompt.text and "green_block" not in prompt.text


def test_a_fix_of_the_program_is_its_next_version(state: RunState, make_services: Make) -> None:
    services = make_services(fenced(BETTER))
    decision = {"verdict": "fix_code", "explanation": "six steps are too few", "policy": "llm"}
    update = run(fix_code, with_(state, report=REPORT, audit=AUDIT, decision=decision), services)
    assert (update["simulation"], update["simulation_version"], update["fixes"]) == (BETTER, 2, 1)
    assert "tests" not in update
    assert not update["audit"]  # it was the audit of the version before
    assert (services.folder / "simulation.py").read_text() == BETTER
    diff = (services.folder / "history" / "simulation_002.diff").read_text()
    assert "-        self.max_steps = 6" in diff and "+        self.max_steps = 8" in diff
    [prompt] = kinds(services, "prompt")
    assert all(
        part in prompt.text
        for part in ("six steps are too few", "1 != 2", "== audit", SIMULATION.strip(), TESTS.strip())
    )


def test_a_fix_of_the_tests_is_their_next_version(state: RunState, make_services: Make) -> None:
    better = TESTS.replace("assertEqual", "assertGreaterEqual")
    services = make_services(fenced(better))
    decision = {"verdict": "fix_test", "explanation": "two is not the point", "policy": "llm"}
    update = run(fix_tests, with_(state, report=REPORT, decision=decision), services)
    assert (update["tests"], update["tests_version"], update["fixes"]) == (better, 2, 1)
    assert "simulation" not in update
    [prompt] = kinds(services, "prompt")
    assert not prompt.images
    shown = (
        "two is not the point",
        "1 != 2",
        TESTS.strip(),
        SIMULATION.strip(),
        "env.get_object_pose",
        '"blue_block_1"',
    )
    assert all(part in prompt.text for part in shown)
    assert "green_block" not in prompt.text  # no object of the task


@pytest.mark.parametrize(("node", "program"), [(fix_code, SIMULATION), (fix_tests, TESTS)])
def test_a_fix_that_changes_nothing_is_a_fix_and_the_history_says_so(
    state: RunState, make_services: Make, node: Node, program: str
) -> None:
    update = run(node, with_(state, report=REPORT), make_services(fenced(program)))
    assert update["fixes"] == 1
    assert not {"simulation", "tests"} & set(update)
    assert "unchanged" in describe_fix_history(with_(state, **update))[-1]


@pytest.mark.parametrize("node", [fix_code, fix_tests])
def test_a_fixer_without_a_usable_reply_uses_the_fix_up_and_changes_nothing(
    state: RunState, make_services: Make, node: Node
) -> None:
    services = make_services("No.", reply_retries=0)
    update = run(node, with_(state, report=REPORT), services)
    assert update["fixes"] == 1
    assert not {"simulation", "tests", "problem"} & set(update)
    assert "no usable reply" in describe_fix_history(with_(state, **update))[-1]
    assert any("no usable reply" in note.text for note in kinds(services, "note"))


class NoSuchModel(Exception):
    """What a provider's client raises for a model that it does not have."""

    status_code = 404


@pytest.mark.parametrize("node", [*AUTHORS.values(), fix_code, fix_tests])
def test_a_provider_that_refuses_is_no_outcome_but_an_error(
    state: RunState, make_services: Make, node: Node, tmp_path: Path
) -> None:
    services = make_services(NoSuchModel("any"))
    with pytest.raises(GrsError, match="404"):
        run(node, with_(state, report=REPORT), services)
    assert "404" in kinds(services, "node_ended")[-1].error
    assert not (tmp_path / "history").exists()
