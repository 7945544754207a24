"""Verdicts of the audit on cheats, which it should reject, and on first plans of honest authors, which it should
accept."""

import json
import os
import tempfile
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from langgraph.runtime import Runtime

from grs_agents.agents.agent import Agents
from grs_agents.audit.types import AuditReport
from grs_agents.base import Frozen, content
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import InputError
from grs_agents.base.trace.log import EventLog
from grs_agents.graph.authoring import generate_sim, generate_task, generate_tests
from grs_agents.graph.judging import audit_task, next_step_after_tests, run_tests
from grs_agents.graph.policies.policy_registry import load_policy
from grs_agents.graph.services import Services
from grs_agents.perception.types import read_scene_description
from grs_agents.runs.experiment_run import ExperimentParser
from grs_agents.runs.sandbox_setup import open_sandbox
from grs_agents.sandbox.protocol.report import TestReport

FALSE_ALARMS = 0.02
"""The largest share of honest plans that may be rejected."""
State = dict[str, Any]


class AuditedCase(Frozen):
    """The audit of a task with its programs."""

    scene: str
    name: str  # the cheat's folder, or the seed of the plan
    honest: bool
    accepted: bool
    failed: tuple[str, ...]  # checks, or an earlier stage
    detail: str
    cpu_seconds: float  # of the audit, all processes together
    objects: int = 0  # of the first instance, bystanders among them

    def __str__(self) -> str:
        mark = "accepted" if self.accepted else "rejected"
        wrong = "" if self.accepted == self.honest else "WRONG"
        numbers = f"{self.objects:3} objects {self.cpu_seconds:5.2f} s"
        return (
            f"{self.scene:14} {self.name:32} {mark:9} {wrong:6} {numbers} {', '.join(self.failed)} {self.detail[:300]}"
        )


def audit_cheat(scene: str, folder: Path, config: Config) -> AuditedCase:
    """Test and audit the programs of a folder (``task.json``, ``simulation.py``, ``test_simulation.py``)."""
    task = json.loads((folder / "task.json").read_text())
    programs = {
        key: (folder / file).read_text()
        for key, file in (("simulation", "simulation.py"), ("tests", "test_simulation.py"))
    }
    with tempfile.TemporaryDirectory() as temporary:
        return _audit_in_folder(scene, folder.name, {"task": task, **programs}, Path(temporary), config)


def audit_first_plan(scene: str, seed: int, config: Config) -> AuditedCase:
    """Let the authors write a task with its programs for a scene, and audit it without a fix."""
    with tempfile.TemporaryDirectory() as temporary:
        return _audit_in_folder(scene, f"seed {seed}", {}, Path(temporary), config.model_copy(update={"seed": seed}))


def _audit_in_folder(scene: str, name: str, given: State, folder: Path, config: Config) -> AuditedCase:
    label, known = Path(scene).name, (Path(scene) / "scene.json").is_file()
    with open_sandbox(config) as sandbox, EventLog(folder / "events.jsonl") as log:
        agents = Agents(config=config, log=log, folder=folder)
        policy, assets = load_policy(config.policy), Path(scene).resolve() / "assets" if known else None
        services = Services(config, log, agents, policy, sandbox, folder, assets=assets)
        state: Any = {"max_fixes": 0, "fixes": 0, "history": [], "image": ""}
        if known:
            state["scene"] = read_scene_description(Path(scene) / "scene.json").model_dump(mode="json")
        else:
            sample = content.content_path("assets", "scenes") / scene
            graph = content.load_module("graphs", "scene").build().compile()
            state |= graph.invoke({"scene_path": str(sample if sample.is_dir() else scene)}, context=services)
        state |= given
        if failure := _write_and_test(state, not given, services):
            stage, detail = failure
            return AuditedCase(
                scene=label,
                name=name,
                honest=not given,
                accepted=False,
                failed=(stage,),
                detail=detail,
                cpu_seconds=0.0,
            )
        before = _cpu_seconds_of_processes()
        state |= audit_task(state, runtime=Runtime(context=services))
        seconds = _cpu_seconds_of_processes() - before
    audit = AuditReport.model_validate(state["audit"])
    failed = [finding for finding in audit.findings if not finding.passed]
    return AuditedCase(
        scene=label,
        name=name,
        honest=not given,
        accepted=audit.accepted,
        failed=tuple(finding.check for finding in failed),
        detail="; ".join(finding.detail for finding in failed),
        cpu_seconds=seconds,
        objects=max((len(rollout.initial) for rollout in audit.rollouts), default=0),
    )


def _write_and_test(state: Any, write: bool, services: Services) -> tuple[str, str] | None:
    """Have the programs written if requested, and run the tests. Returns: failed stage and reason, if any."""
    runtime = Runtime(context=services)
    for author in (generate_task, generate_sim, generate_tests) if write else ():
        state |= author(state, runtime=runtime)
        if state.get("problem"):
            return "no plan", state["problem"]
    state |= run_tests(state, runtime=runtime)
    if next_step_after_tests(state) == "audit":
        return None
    report = TestReport.model_validate(state["report"])
    failing = "; ".join(f"{case.id}: {case.message}" for case in report.cases if case.outcome != "passed")
    return "tests", failing or str(report.message)


def _cpu_seconds_of_processes() -> float:
    """CPU time of this process and its descendants, ended ones included (Linux), s."""
    parents: dict[int, int] = {}
    ticks: dict[int, int] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:  # it has ended since
            continue
        parents[int(folder.name)] = int(fields[1])
        ticks[int(folder.name)] = sum(map(int, fields[11:15]))  # utime, stime, cutime, cstime
    family, grown = {os.getpid()}, True
    while grown:
        children = {number for number, parent in parents.items() if parent in family}
        grown = not children <= family
        family |= children
    return sum(ticks.get(number, 0) for number in family) / os.sysconf("SC_CLK_TCK")


def summarise_verdicts(rows: Sequence[AuditedCase]) -> State:
    """Number of accepted cases, wrong verdicts by check, and cost of an audit."""
    wrong = [row for row in rows if row.accepted != row.honest]
    spent = sorted(row.cpu_seconds for row in rows if row.cpu_seconds) or [0.0]
    return {
        "accepted": f"{sum(row.accepted for row in rows)} of {len(rows)}",
        "judged wrongly": len(wrong),
        "by": dict(Counter(check for row in wrong for check in row.failed)),
        "CPU seconds of an audit": {"median": spent[len(spent) // 2], "largest": spent[-1]},
    }


def main(arguments: Sequence[str]) -> int:
    """Audit cheats and first plans; print a row for each and the shares.

    Returns:
        0 if no cheat is accepted and at most ``FALSE_ALARMS`` of the honest plans are rejected, 1 if not.
    """
    parser = ExperimentParser("acceptance", __doc__)
    parser.add_argument("scenes", nargs="*", default=["groceries"], help="samples, or folders of runs (groceries)")
    parser.add_argument("--cheats", type=Path, help="a folder of cheats, tried on the first scene; without it, plans")
    parser.add_argument("--seeds", default="0:10", help="of the plans, FIRST:END (0:10)")
    experiment = parser.start(arguments)
    options, config = experiment.options, experiment.config
    if options.cheats:
        folders = sorted(path.parent for path in options.cheats.glob("*/task.json"))
        work = {folder.name: partial(audit_cheat, options.scenes[0], folder, config) for folder in folders}
    else:
        first, end = map(int, options.seeds.split(":"))
        plans = [(scene, seed) for seed in range(first, end) for scene in options.scenes]
        work = {f"{scene} {seed}": partial(audit_first_plan, scene, seed, config) for scene, seed in plans}
    if not work:
        raise InputError("there is nothing to audit", "name a folder of cheats, or --seeds FIRST:END with FIRST < END")
    choosing = ("scenes", "seeds") if not options.cheats else ()
    rows = experiment.make_or_reuse_rows(AuditedCase, work, choosing=choosing, show=str)
    summary = summarise_verdicts(rows)
    audited = f"cheats of {options.cheats.name}" if options.cheats else f"plans, {len(options.scenes)} scenes"
    refused = [row for row in rows if not row.accepted]
    by_tests = sum(row.failed[0] in ("tests", "no plan") for row in refused)
    table = [
        {
            "audited": audited,
            "accepted": summary["accepted"],
            "rejected by the audit": len(refused) - by_tests,
            "rejected by their tests": by_tests,
        }
    ]
    lines = [f"{key}: {value}" for key, value in summary.items()]
    experiment.tell(table, *lines, summary=summary, rows=[row.model_dump() for row in rows])
    wrong = sum(row.accepted != row.honest for row in rows)
    return int(wrong > (0 if options.cheats else FALSE_ALARMS * len(rows)))
