"""Fixes in vain lead to another strategy, the best version stays, and a task that cannot be done may be revised."""

import json
from collections import Counter
from pathlib import Path
from typing import Any, Literal

import pytest

from grs_agents.agents.types import TaskDefinition
from grs_agents.audit.checks import audit_task
from grs_agents.base.config.schema import AuditConfig, Config
from grs_agents.base.trace.log import EventLog
from grs_agents.graph.fix_history import describe_fix_history, list_untried_fix_strategies
from grs_agents.graph.fixing import fix_code
from grs_agents.graph.judging import conclude_with_best_version, next_step_after_audit, run_tests
from grs_agents.graph.policies.policy_registry import load_policy
from grs_agents.graph.services import Services
from grs_agents.graph.state import FixRecord, RunState, state_as_json
from grs_agents.graph.topology import add_authors, add_fix_loop, add_judging, empty_graph
from grs_agents.library.library import Library
from grs_agents.sandbox.host.sandbox import Sandbox
from tests.graph.conftest import SIMULATION, TASK, TESTS, Make, fenced, kinds, run, with_
from tests.scripted import StubbornAgents, StubbornModel

WRONG_TESTS = TESTS.replace("goals), 2)", "goals), 3)")
STUBBORN = {
    "task": fenced(json.dumps(TASK), "json"),
    "simulation": fenced(SIMULATION),
    "tests": fenced(WRONG_TESTS),
    "route": "The program, as ever.\n```\nfix_code\n```",
    "fix_code": fenced(SIMULATION),
    "fix_tests": fenced(WRONG_TESTS),
    "fix_task": fenced(json.dumps({**TASK, "given-up": "nothing"}), "json"),
}
ASSERTED = {"id": "T.test_a", "outcome": "failed", "message": "1 != 2", "raised_in": "tests"}


def run_stubborn(
    state: RunState, folder: Path, sandbox: Sandbox, words: Literal["sentence", "agree"] = "sentence", **replies: str
) -> tuple[dict[str, Any], Services]:
    """The graph ``grs`` from the scene on, with a model that never changes its mind."""
    config = Config(max_fixes=12, audit=AuditConfig(seeds=1, words=words))
    model = StubbornModel(replies={**STUBBORN, **replies})
    agents = StubbornAgents(config, EventLog(folder / "events.jsonl"), folder, stubborn=model)
    services = Services(config, agents.log, agents, load_policy("llm"), sandbox, folder)
    graph = empty_graph()
    graph.add_edge("__start__", "generate_task")
    add_authors(graph, "generate_task", "generate_sim", "generate_tests", then="run_tests")
    add_judging(graph, fix=add_fix_loop(graph, then="audit", revise=True))
    begin: Any = {key: state[key] for key in ("scene_path", "fixes", "history", "image", "scene")}
    begin["max_fixes"] = 12
    return graph.compile().invoke(begin, {"recursion_limit": 90}, context=services), services


def test_a_stubborn_model_is_never_asked_the_same_more_than_twice(
    state: RunState, tmp_path: Path, sandbox: Sandbox
) -> None:
    ended, services = run_stubborn(state, tmp_path, sandbox)
    prompts = kinds(services, "prompt")
    assert max(Counter(prompt.digest for prompt in prompts).values()) <= 2
    records: list[FixRecord] = ended["history"]
    assert [(record.fixed, record.strategy) for record in records] == [
        ("simulation", "fix"),
        ("simulation", "rewrite"),
        ("tests", "fix"),
        ("tests", "rewrite"),
        ("task", "fix"),
    ]
    assert all(record.vain for record in records)
    assert ended["status"] == "rejected" and "the last 5 in vain" in ended["reason"]


def test_a_revised_task_is_written_for_anew_and_what_was_given_up_is_recorded(
    state: RunState, tmp_path: Path, sandbox: Sandbox
) -> None:
    wide = {**TASK, "assets-used": [*TASK["assets-used"], "block/green_block.urdf"]}
    revision = fenced(json.dumps({**TASK, "given-up": "The green block stays."}), "json")
    ended, services = run_stubborn(
        state,
        tmp_path,
        sandbox,
        task=fenced(json.dumps(wide), "json"),
        tests=fenced(TESTS),
        route="It cannot be done.\n```\nfix_task\n```",
        fix_task=revision,
    )
    assert ended["status"] == "accepted" and "The green block stays." in ended["reason"]
    revised = {"from": wide, "given-up": "The green block stays."}
    assert state_as_json(ended)["revised"] == revised
    written = json.loads((tmp_path / "task.json").read_text())
    assert written.pop("sentence") == written.pop("instructions")["specific"]["text"] == ended["audit"].sentence
    assert written == {**TASK, "revised": revised}
    ran = [event.node for event in kinds(services, "node_ended")]
    assert ran[ran.index("fix_task") :] == [
        "fix_task",
        "generate_sim",
        "generate_tests",
        "run_tests",
        "audit",
        "conclude",
    ]
    assert [finding.check for finding in ended["audit"].findings if finding.check == "revision"]


@pytest.mark.parametrize(
    ("measured", "revisable", "verdicts"),
    [
        ("not_judged, says m: which cube?", True, ["fix_task"]),
        ("not_judged, says m: which cube?", False, []),
        ("differ, says m: the cube stays", True, ["fix_code", "fix_task"]),
        ("differ, says m: the cube stays", False, ["fix_code"]),
    ],
)
def test_no_program_is_changed_for_unclear_words(
    state: RunState, measured: str, revisable: bool, verdicts: list[str]
) -> None:
    finding = {"check": "words", "passed": False, "measured": measured, "bound": ""}
    audit = {"accepted": False, "findings": [finding], "changes": [], "rollouts": [], "rewards": []}
    failed = with_(state, audit=audit, revisable=revisable)
    assert list(list_untried_fix_strategies(failed)) == verdicts
    assert next_step_after_audit(failed) == ("fix" if verdicts else "stop")


def test_a_run_whose_words_stay_unclear_revises_the_task_once_and_changes_no_program(
    state: RunState, tmp_path: Path, sandbox: Sandbox
) -> None:
    plainer = {"task-description": "Move the red block, then the blue block."}
    ended, services = run_stubborn(
        state,
        tmp_path,
        sandbox,
        words="agree",
        tests=fenced(TESTS),
        judge=fenced(json.dumps({"verdict": "unclear", "reason": "Where to?"}), "json"),
        fix_task=fenced(json.dumps(plainer), "json"),
    )
    assert state_as_json(ended)["task"] == {**TASK, **plainer}
    ran = [event.node for event in kinds(services, "node_ended")]
    assert ran.count("fix_task") == 1 and not {"fix_code", "fix_tests"} & {*ran}
    assert "audit failed: words; 1 of 12 fixes used)" in ended["reason"] and "Where to?" in ended["reason"]


@pytest.mark.parametrize(
    ("measured", "verdicts"),
    [("line 3: they import mock", ["fix_test"]), ("line 3: in the simulation program it imports gc", ["fix_code"])],
)
def test_a_check_of_the_tests_that_names_the_program_blames_the_program(
    state: RunState, measured: str, verdicts: list[str]
) -> None:
    finding = {"check": "tests_of_program", "passed": False, "measured": measured, "bound": ""}
    audit = {"accepted": False, "findings": [finding], "changes": [], "rollouts": [], "rewards": []}
    assert list(list_untried_fix_strategies(with_(state, audit=audit))) == verdicts


def test_a_run_that_is_not_accepted_leaves_the_best_version_in_place(state: RunState, make_services: Make) -> None:
    worse = SIMULATION.replace("super().__init__()", "raise RuntimeError('no such luck')")
    services = make_services(fenced(worse))
    failed = run(run_tests, with_(state, tests=WRONG_TESTS + GOOD_TEST), services)
    first = with_(state, tests=WRONG_TESTS + GOOD_TEST, max_fixes=1, **failed)
    fixed = with_(first, **run(fix_code, first, services))
    judged = with_(fixed, **run(run_tests, fixed, services))
    [line, best] = describe_fix_history(judged)
    assert "version 2 (+1 -1 lines): tests 1/2, strict 0.00 -> tests 0/2, strict 0.00" in line
    assert "program version 1 with tests version 1" in best
    ended = run(conclude_with_best_version, judged, services)
    assert ended["status"] == "rejected" and "left in place is program version 1" in ended["reason"]
    assert ended["simulation"] == SIMULATION == (services.folder / "simulation.py").read_text()
    assert (services.folder / "test_simulation.py").read_text() == WRONG_TESTS + GOOD_TEST


GOOD_TEST = """
    def test_it_is_a_task(self):
        self.assertEqual(MoveTwoBlocks().max_steps, 6)
"""


@pytest.mark.parametrize("brings_back", [False, True])
def test_a_fix_is_in_vain_where_the_report_stays_or_old_programs_come_back(
    state: RunState, make_services: Make, brings_back: bool
) -> None:
    report = {"outcome": "failed", "cases": [ASSERTED]}
    other = SIMULATION.replace("max_steps = 6", "max_steps = 7")
    services = make_services(fenced(other), fenced(SIMULATION))
    first = with_(state, report=report)
    second = with_(first, **run(fix_code, first, services))
    judged = with_(second, **run(run_tests, with_(second, tests=WRONG_TESTS), services))
    assert not judged["history"][-1].vain
    third = with_(judged, **run(fix_code, judged, services))
    outcome = run(run_tests, with_(third, tests=TESTS if brings_back else WRONG_TESTS), services)
    assert outcome["history"][-1].vain


@pytest.mark.parametrize(
    ("before", "after", "passes"),
    [(3, 2, True), (2, 1, False), (5, 3, True), (5, 2, False), (1, 1, True)],
)
def test_a_revision_gives_up_half_of_the_objects_at_most_and_leaves_two(before: int, after: int, passes: bool) -> None:
    names = [f"block/{number}.urdf" for number in range(before)]
    tasks = [
        TaskDefinition.model_validate({"task-name": "t", "task-description": "d", "assets-used": assets})
        for assets in (names[:after], names)
    ]
    report = audit_task([], [], [], AuditConfig(), Library(), tasks[0], None, tasks[1])
    [finding] = [finding for finding in report.findings if finding.check == "revision"]
    assert finding.passed is passes and f"{after} of {before}" in finding.detail
