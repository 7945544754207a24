"""A pair of programs is tested and audited once in a run: what was found out is used again, and said to be."""

from pathlib import Path

from grs_agents.audit.types import AuditReport
from grs_agents.graph.fix_history import describe_fix_history
from grs_agents.graph.fixing import fix_code
from grs_agents.graph.judging import audit_task, conclude_with_best_version, run_tests
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState
from grs_agents.sandbox.protocol.report import TestReport
from tests.graph.conftest import SIMULATION, TASK, TESTS, Make, fenced, kinds, run, with_

SLOWER = SIMULATION.replace("max_steps = 6", "max_steps = 5")
OTHER_TASK = {"task-name": "push-both", "task-description": "move both blocks", "assets-used": ["block/red_block.urdf"]}


def reused(services: Services) -> list[str]:
    """The notes that say that something was used again."""
    return [event.text for event in kinds(services, "note") if "used again" in event.text]


def files(folder: Path) -> dict[str, bytes]:
    """What the task instances of a run hold, by name."""
    return {file.name: file.read_bytes() for file in (folder / "instances").iterdir()}


def judge(state: RunState, services: Services) -> tuple[TestReport, AuditReport]:
    """The test report and the audit of a state's programs."""
    tested = with_(state, **run(run_tests, state, services))
    return tested["report"], run(audit_task, tested, services)["audit"]


def test_programs_that_come_back_are_not_judged_again(state: RunState, make_services: Make) -> None:
    services = make_services()
    first = with_(state, simulation_version=1, tests_version=1)
    report, audit = judge(first, services)
    instances = files(services.folder)
    other = judge(with_(state, simulation=SLOWER, simulation_version=2, tests_version=1), services)
    assert not reused(services) and other[1] != audit and files(services.folder) != instances
    again = judge(with_(state, simulation_version=3, tests_version=1), services)
    assert again == (report, audit)  # to the millisecond
    assert files(services.folder) == instances
    assert [text.rpartition(" ")[0].rpartition("their ")[2] for text in reused(services)] == [
        "test report is used",
        "audit is used",
    ]
    assert all("(simulation version 1, tests version 1)" in text for text in reused(services))
    assert [event.report["seconds"] for event in kinds(services, "tests_run")][::2] == [report.seconds] * 2
    rollouts = kinds(services, "rollout")
    assert [(event.seed, event.recording) for event in rollouts] == [(0, "instances/seed_0.npz")] * 3
    assert len(kinds(services, "finding")) == 2 * len(audit.findings) + len(other[1].findings)


def test_other_tests_or_another_task_are_judged(state: RunState, make_services: Make) -> None:
    services = make_services()
    judge(state, services)
    judge(with_(state, tests=TESTS + "\n"), services)
    assert not reused(services)
    judge(with_(state, task=OTHER_TASK), services)
    assert len(reused(services)) == 1 and "test report" in reused(services)[0]


def test_the_same_programs_are_audited_anew_once_the_task_is_a_revised_one(
    state: RunState, make_services: Make
) -> None:
    services = make_services()
    _, audit = judge(state, services)
    _, anew = judge(with_(state, revised={"from": TASK, "given-up": "Nothing."}), services)
    assert len(reused(services)) == 1 and "test report" in reused(services)[0]
    told = [{finding.check for finding in report.findings} for report in (audit, anew)]
    assert told[1] - told[0] == {"revision"}


def test_a_run_that_goes_on_knows_what_was_judged(state: RunState, make_services: Make) -> None:
    report, audit = judge(state, make_services())
    resumed = make_services()
    assert judge(state, resumed) == (report, audit)
    assert len(reused(resumed)) == 2


def test_what_was_torn_is_judged_anew(state: RunState, make_services: Make) -> None:
    services = make_services()
    judge(state, services)
    for number, file in enumerate(sorted((services.folder / ".judged").rglob("report.json"))):
        file.write_text(("{", '{"report": {"outcome": "fine"}}')[number % 2])
    judge(state, services)
    assert not reused(services)


def test_nothing_of_it_stays_in_a_run_that_ended(state: RunState, make_services: Make) -> None:
    services = make_services()
    report, audit = judge(state, services)
    assert (services.folder / ".judged").is_dir()
    run(conclude_with_best_version, with_(state, report=report, audit=audit), services)
    assert not (services.folder / ".judged").exists()


def test_the_router_is_told_which_version_a_fix_brought_back(state: RunState, make_services: Make) -> None:
    services = make_services(fenced(SLOWER), fenced(SIMULATION))
    history = services.folder / "history"
    history.mkdir()
    (history / "simulation_001.py").write_text(SIMULATION)
    failed = {"outcome": "failed", "cases": [{"id": "T.test_a", "outcome": "failed", "message": "1 != 2"}]}
    first = with_(state, report=failed, simulation_version=1)
    second = with_(first, **run(fix_code, first, services))
    third = with_(second, **run(fix_code, second, services))
    assert [record.equals for record in third["history"]] == [0, 1]
    assert "version 3, equal to version 1 (+1 -1 lines)" in describe_fix_history(third)[1]
