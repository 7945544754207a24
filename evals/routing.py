"""Plant faults in right programs or their tests, ask a routing policy whose fault each is, and fix as a run does."""

import re
import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from langgraph.graph import START
from langgraph.runtime import Runtime

from evals.faults.planting import PlantedFault, plant_mistakes, read_fault_folders
from grs_agents.agents.agent import Agents
from grs_agents.base import Frozen, content
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import InputError
from grs_agents.base.trace.log import EventLog
from grs_agents.graph.judging import run_tests
from grs_agents.graph.policies.policy_registry import load_policy
from grs_agents.graph.policies.types import Policy, RoutingContext, RoutingDecision
from grs_agents.graph.services import Services
from grs_agents.graph.topology import add_fix_loop, add_judging, empty_graph
from grs_agents.runs.experiment_run import ExperimentParser
from grs_agents.runs.experiments import positive_int
from grs_agents.runs.sandbox_setup import open_sandbox
from grs_agents.sandbox.protocol.report import TestReport

SCENE = "groceries"
TARGET = 0.85
"""The least share of the faults that is to be routed rightly."""
MOST_WRONG = 0.02
"""The largest share of the faults that may end in an accepted program which is not right."""


class RoutedFault(Frozen):
    """The outcome of a fault."""

    name: str
    kind: str
    truth: str
    right_tests: bool
    verdict: str  # empty for a fault that does no harm: tests and audit pass, but perhaps for the task's words
    other_order: str  # the verdict with the options in reverse
    cause: str
    sure: bool
    explanation: str
    fixes: int  # made until the run ended
    accepted: bool
    reason: str  # how the run ended
    wrong: str  # failures of the right pair's tests on an accepted program; empty if it is right

    @property
    def mark(self) -> str:
        """Routing result in a word: harmless, right or WRONG."""
        return "harmless" if not self.verdict else "right" if self.verdict == self.truth else "WRONG"

    def __str__(self) -> str:
        verdict = f"{self.truth:9} {self.verdict:9} {self.mark:9} {self.cause:18} {'sure' if self.sure else '':5}"
        end = f"{self.fixes} fixes, {'accepted' if self.accepted else 'rejected'}{' WRONGLY' if self.wrong else ''}"
        return f"{self.name:44} {verdict} {end:27} {self.explanation[:240]}; {self.wrong or self.reason[:240]}"


@dataclass
class _BothOrders:
    """A policy that notes its first decision, and its decision with the options reversed."""

    policy: Policy
    first: RoutingDecision | None = None
    reverse: RoutingDecision | None = None

    def decide(self, context: RoutingContext) -> RoutingDecision:
        decision = self.policy.decide(context)
        if self.first is None:
            self.first = decision
            self.reverse = self.policy.decide(replace(context, verdicts=context.verdicts[::-1]))
        return decision


class FaultRuns:
    """Runs of programs with a fault, which share a sandbox and a scene; both are made for the first."""

    def __init__(self, config: Config, fixes: int, scene: str) -> None:
        self._config, self._fixes, self._scene = config, fixes, scene
        self._kept_open = ExitStack()
        self._opened: tuple[Services, dict[str, Any]] | None = None

    def __enter__(self) -> "FaultRuns":
        return self

    def __exit__(self, *_: object) -> None:
        self._kept_open.close()

    def route(self, fault: PlantedFault) -> RoutedFault:
        """Run the programs of a fault; route where they fail, and fix."""
        if self._opened is None:
            folder = Path(self._kept_open.enter_context(tempfile.TemporaryDirectory()))
            sandbox = self._kept_open.enter_context(open_sandbox(self._config))
            log = self._kept_open.enter_context(EventLog(folder / "events.jsonl"))
            agents = Agents(config=self._config, log=log, folder=folder)
            services = Services(self._config, log, agents, load_policy(self._config.policy), sandbox, folder)
            begin: dict[str, Any] = {"scene_path": self._scene, "max_fixes": self._fixes, "fixes": 0, "history": []}
            graph = content.load_module("graphs", "scene").build().compile()
            self._opened = services, graph.invoke(begin, context=services)
        services, state = self._opened
        policy = _BothOrders(services.policy)
        services = replace(services, policy=policy)
        versions = {"simulation_version": 1, "tests_version": 1}
        programs: dict[str, Any] = {
            "task": fault.task,
            "simulation": fault.simulation,
            "tests": fault.tests,
            **versions,
        }
        judging = empty_graph()
        judging.add_edge(START, "run_tests")
        add_judging(judging, fix=add_fix_loop(judging, then="audit"))
        compiled: Any = judging.compile()
        end = compiled.invoke({**state, **programs}, {"recursion_limit": 1000}, context=services)
        accepted = end["status"] == "accepted"
        first, reverse = policy.first, policy.reverse
        return RoutedFault(
            name=fault.name,
            kind=fault.kind,
            truth=fault.truth,
            right_tests=fault.right_tests,
            verdict=first.verdict if first else "",
            other_order=reverse.verdict if reverse else "",
            cause=first.cause if first else "",
            sure=first is not None and first.sure,
            explanation=first.explanation if first else "no program is at fault",
            fixes=end.get("fixes", 0),
            accepted=accepted,
            reason=end["reason"],
            wrong=_describe_wrong_program(fault, end, services) if accepted else "",
        )


_IN_BASE_ORDER = """
if "Environment" in globals():

    class _InOrder(Environment):
        @property
        def obj_ids(self):
            known = [item for asset in {order!r} for item in self.find(asset)]
            ids = {{kind: list(items) for kind, items in super().obj_ids.items()}}
            return {{**ids, "rigid": sorted(ids["rigid"], key=(known + ids["rigid"]).index)}}

    Environment = _InOrder


"""
"""Added to tests of the right pair: they name objects by the order of its program, and an author may choose another."""


def _describe_wrong_program(fault: PlantedFault, end: dict[str, Any], services: Services) -> str:
    """Failures of the right pair's tests on an accepted program.

    Another class name and another order of objects do not count.
    """
    imports = r"(?<=from task_code import )\w+"
    was, now = re.search(imports, fault.base_tests), re.search(imports, end["tests"])
    tests = re.sub(rf"\b{was[0]}\b", now[0], fault.base_tests) if was and now else fault.base_tests
    in_order = re.sub(r"^(?=if __name__|\Z)", _IN_BASE_ORDER.format(order=fault.base_order), tests, count=1, flags=re.M)
    judged: Any = {**end, "tests": in_order}
    report = TestReport.model_validate(run_tests(judged, runtime=Runtime(context=services))["report"])
    failing = [f"{case.id}: {case.message}" for case in report.cases if case.outcome != "passed"]
    return "" if report.all_passed else "; ".join(failing)[:300] or report.message or report.outcome


def summarise_routing(rows: Sequence[RoutedFault]) -> dict[str, str]:
    """Shares of right routings, of recoveries, and of equal verdicts in both orders."""
    shown = [row for row in rows if row.verdict]
    sure = [row for row in shown if row.sure]
    by_truth = {truth: [row for row in shown if row.truth == truth] for truth in ("fix_code", "fix_test")}
    return {
        "faults": str(len(rows)),
        "harmless": str(len(rows) - len(shown)),
        "routed rightly": _format_share(shown, _is_right),
        "code taken for tests": _format_share(by_truth["fix_code"], _is_misrouted),
        "tests taken for code": _format_share(by_truth["fix_test"], _is_misrouted),
        "right test, wrong program": _format_share([row for row in shown if row.right_tests], _is_right),
        "sure": f"{len(sure)}, wrongly {sum(map(_is_misrouted, sure))}",
        "same in the other order": _format_share(shown, lambda row: row.verdict == row.other_order),
        "recovered": _format_share(shown, _is_recovered),
        "recovered with one fix": _format_share(shown, lambda row: _is_recovered(row) and row.fixes == 1),
        "accepted but wrong": _format_share(rows, lambda row: bool(row.wrong)),
    }


def _is_right(row: RoutedFault) -> bool:
    return row.mark == "right"


def _is_misrouted(row: RoutedFault) -> bool:
    return row.mark == "WRONG"


def _is_recovered(row: RoutedFault) -> bool:
    return row.accepted and not row.wrong


def _format_share(rows: Sequence[RoutedFault], holds: Callable[[RoutedFault], bool]) -> str:
    count = sum(map(holds, rows))
    return f"{count} of {len(rows)}" + (f" ({100 * count / len(rows):.0f} %)" if rows else "")


def main(arguments: Sequence[str]) -> int:
    """Route the faults and print them with the shares.

    Returns:
        0 if ``TARGET`` of the faults that do harm are routed rightly and at most ``MOST_WRONG`` of all end in an
        accepted program that is not right, 1 if not.

    Raises:
        InputError: no fault was routed, because there is none or none does harm.
    """
    parser = ExperimentParser("routing", __doc__)
    parser.add_argument("folder", type=Path, nargs="?", help="faults in folders; without one, mistakes are made")
    parser.add_argument("--scene", type=Path, help="that the faults in folders are of (the sample scene groceries)")
    parser.add_argument("--half", type=int, choices=(0, 1), default=1, help="which half of the made mistakes (1)")
    parser.add_argument("--seed", type=int, default=0, help="of the made mistakes")
    parser.add_argument("--policy", default="rules")
    parser.add_argument("--fixes", type=positive_int, default=3, metavar="N", help="at most for each fault (3)")
    parser.add_argument("--only", default="", help="a regular expression that names of faults match")
    experiment = parser.start(arguments, lambda options: (f"policy={options.policy}", "limits.cpu_seconds=10"))
    options = experiment.options
    planted = read_fault_folders(options.folder) if options.folder else plant_mistakes(options.half, options.seed)
    faults = list(filter(lambda fault: re.search(options.only, fault.name), planted))
    scene = options.scene or content.content_path("assets", "scenes") / SCENE
    with FaultRuns(experiment.config, options.fixes, str(scene)) as runs:
        work = {fault.name: partial(runs.route, fault) for fault in faults}
        rows = experiment.make_or_reuse_rows(RoutedFault, work, choosing=("half", "only"), show=str)
    if not any(row.verdict for row in rows):
        raise InputError(f"none of {len(rows)} faults was routed", "name faults that do harm: another folder or --only")
    summary = summarise_routing(rows)
    author = experiment.config.models["default"].model
    table = [{"policy": experiment.config.policy, "author": author, **summary}]
    lines = [f"{key}: {value}" for key, value in summary.items()]
    experiment.tell(table, *lines, summary=summary, rows=[row.model_dump() for row in rows])
    shown = [row.mark for row in rows if row.verdict]
    wrong = sum(bool(row.wrong) for row in rows)
    return 0 if shown.count("right") >= TARGET * len(shown) and wrong <= MOST_WRONG * len(rows) else 1
