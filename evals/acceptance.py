"""What the audit accepts: cheats, which it should not, and the first plans of honest authors, which it should."""

import json
import os
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from langgraph.runtime import Runtime

from grs_agents import content, nodes
from grs_agents.agents import Agents
from grs_agents.audit import AuditReport
from grs_agents.base import Frozen
from grs_agents.config import load_config
from grs_agents.nodes import Services
from grs_agents.perception import read_scene_description
from grs_agents.policies import load_policy
from grs_agents.runs import open_sandbox
from grs_agents.sandbox import TestReport
from grs_agents.terminal import EscapingParser
from grs_agents.trace import EventLog

FALSE_ALARMS = 0.02
"""The largest share of honest plans that may be rejected."""
State = dict[str, Any]


class AuditedCase(Frozen):
    """What the audit said of one task with its programs."""

    scene: str
    name: str  # the cheat's folder, or the seed of the plan
    honest: bool
    accepted: bool
    failed: tuple[str, ...]  # checks, or what came before them
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


def audit_cheats(scene: str, folders: Iterable[Path], settings: Sequence[str]) -> Iterator[AuditedCase]:
    """Test and audit the programs of each folder (``task.json``, ``simulation.py``, ``test_simulation.py``)."""
    for folder in folders:
        task = json.loads((folder / "task.json").read_text())
        programs = {
            key: (folder / file).read_text()
            for key, file in (("simulation", "simulation.py"), ("tests", "test_simulation.py"))
        }
        with tempfile.TemporaryDirectory() as temporary:
            yield _audit_in_folder(scene, folder.name, {"task": task, **programs}, Path(temporary), settings)


def audit_first_plans(scenes: Sequence[str], seeds: Iterable[int], settings: Sequence[str]) -> Iterator[AuditedCase]:
    """Let the authors write a task with its programs for each seed and scene, and audit it without a fix."""
    for seed in seeds:
        for scene in scenes:
            with tempfile.TemporaryDirectory() as temporary:
                yield _audit_in_folder(scene, f"seed {seed}", {}, Path(temporary), [*settings, f"seed={seed}"])


def _audit_in_folder(scene: str, name: str, given: State, folder: Path, settings: Sequence[str]) -> AuditedCase:
    config = load_config(None, settings).config
    label, known = Path(scene).name, (Path(scene) / "scene.json").is_file()
    with open_sandbox(config) as sandbox, EventLog(folder / "events.jsonl") as log:
        agents = Agents(config=config, log=log, folder=folder)
        policy, assets = load_policy(config.policy), Path(scene).resolve() / "assets" if known else None
        services = Services(config, log, agents, policy, sandbox, folder, assets=assets)
        state: Any = {"max_fixes": 0, "fixes": 0, "history": [], "image": ""}
        state |= _read_or_comprehend(scene, known, services) | given
        if reason := _write_and_test(state, not given, services):
            return _rejected(label, name, not given, *reason)
        before = _cpu_seconds_of_processes()
        state |= nodes.audit_task(state, runtime=Runtime(context=services))
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
    """Have the programs written if asked to, and run the tests; the stage that failed and why, if one did."""
    runtime = Runtime(context=services)
    for author in (nodes.generate_task, nodes.generate_sim, nodes.generate_tests) if write else ():
        state |= author(state, runtime=runtime)
        if state.get("problem"):
            return "no plan", state["problem"]
    state |= nodes.run_tests(state, runtime=runtime)
    if nodes.next_step_after_tests(state) == "audit":
        return None
    report = TestReport.model_validate(state["report"])
    failing = "; ".join(f"{case.id}: {case.message}" for case in report.cases if case.outcome != "passed")
    return "tests", failing or str(report.message)


def _rejected(scene: str, name: str, honest: bool, stage: str, detail: str) -> AuditedCase:
    return AuditedCase(
        scene=scene, name=name, honest=honest, accepted=False, failed=(stage,), detail=detail, cpu_seconds=0.0
    )


def _read_or_comprehend(scene: str, known: bool, services: Services) -> State:
    if known:
        return {"scene": read_scene_description(Path(scene) / "scene.json").model_dump(mode="json")}
    sample = content.content_path("assets", "scenes") / scene
    graph = content.load_module("graphs", "scene").build().compile()
    return graph.invoke({"scene_path": str(sample if sample.is_dir() else scene)}, context=services)


def _cpu_seconds_of_processes() -> float:
    """Of this process, its descendants, and those of theirs that have ended (Linux)."""
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
    """How many were accepted, how many verdicts are wrong and by which checks, and what an audit costs."""
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
    parser = EscapingParser(prog="grs eval acceptance", description=__doc__)
    parser.add_argument("scenes", nargs="*", default=["groceries"], help="samples, or folders of runs (groceries)")
    parser.add_argument("--cheats", type=Path, help="a folder of cheats, tried on the first scene; without it, plans")
    parser.add_argument("--seeds", default="0:10", help="of the plans, FIRST:END (0:10)")
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args(arguments)
    if chosen.cheats:
        folders = sorted(path.parent for path in chosen.cheats.glob("*/task.json"))
        cases = audit_cheats(chosen.scenes[0], folders, chosen.settings)
    else:
        first, end = map(int, chosen.seeds.split(":"))
        cases = audit_first_plans(chosen.scenes, range(first, end), chosen.settings)
    rows: list[AuditedCase] = []
    for case in cases:
        rows.append(case)
        if not chosen.json:
            print(case, flush=True)
    summary = summarise_verdicts(rows)
    print(
        json.dumps(
            {"rows": [row.model_dump() for row in rows], "summary": summary} if chosen.json else summary, indent=2
        )
    )
    wrong = sum(row.accepted != row.honest for row in rows)
    return int(wrong > (0 if chosen.cheats else FALSE_ALARMS * len(rows)))
