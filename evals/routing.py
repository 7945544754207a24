"""Run pairs of programs with planted faults, ask a routing policy whose fault each is, and compare with the truth."""

import json
import re
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from langgraph.runtime import Runtime

from evals.faults.planting import PlantedFault, plant_mistakes, read_fault_folders
from grs_agents import content, nodes
from grs_agents.agents import Agents
from grs_agents.base import Frozen
from grs_agents.config import load_config
from grs_agents.nodes import Services
from grs_agents.policies import load_policy
from grs_agents.runs import open_sandbox
from grs_agents.terminal import VisibleParser
from grs_agents.trace import EventLog

SCENE = "groceries"
TARGET = 0.85
"""The least share of the faults that is to be routed rightly."""


class RoutedFault(Frozen):
    """What became of one fault."""

    name: str
    kind: str
    truth: str
    right_tests: bool
    verdict: str  # empty where tests and audit pass: a fault that does no harm
    cause: str
    sure: bool
    explanation: str

    @property
    def mark(self) -> str:
        """Whether it was routed rightly, in one word."""
        return "harmless" if not self.verdict else "right" if self.verdict == self.truth else "WRONG"

    def __str__(self) -> str:
        verdict = f"{self.truth:9} {self.verdict:9} {self.mark:9} {self.cause:18} {'sure' if self.sure else '':5}"
        return f"{self.name:36} {verdict} {self.explanation[:240]}"


def route_faults(faults: Sequence[PlantedFault], settings: Sequence[str]) -> Iterator[RoutedFault]:
    """Run the programs of each fault as a run does, and route where tests or audit fail."""
    config = load_config(None, settings).config
    scene = content.content_path("assets", "scenes") / SCENE
    with tempfile.TemporaryDirectory() as temporary, open_sandbox(config) as sandbox:
        folder = Path(temporary)
        with EventLog(folder / "events.jsonl") as log:
            agents = Agents(config=config, log=log, folder=folder)
            services = Services(config, log, agents, load_policy(config.policy), sandbox, folder)
            graph = content.load_module("graphs", "scene").build().compile()
            begin: dict[str, Any] = {"scene_path": str(scene), "max_fixes": 1, "fixes": 0, "history": []}
            state = graph.invoke(begin, context=services)
            for fault in faults:
                yield _route_fault(fault, state, services)


def _route_fault(fault: PlantedFault, scene: dict[str, Any], services: Services) -> RoutedFault:
    runtime = Runtime(context=services)
    state: Any = {**scene, "task": fault.task, "simulation": fault.simulation, "tests": fault.tests}
    state |= nodes.run_tests(state, runtime=runtime)
    if nodes.next_step_after_tests(state) == "audit":
        state |= nodes.audit_task(state, runtime=runtime)
    decision: dict[str, Any] = {}
    if not state["audit"] or not state["audit"]["accepted"]:
        decision = nodes.decide_what_to_fix(state, runtime=runtime)["decision"]
    return RoutedFault(
        name=fault.name,
        kind=fault.kind,
        truth=fault.truth,
        right_tests=fault.right_tests,
        verdict=decision.get("verdict", ""),
        cause=decision.get("cause", ""),
        sure=decision.get("sure", False),
        explanation=decision.get("explanation", "tests and audit pass"),
    )


def summarise_routing(rows: Sequence[RoutedFault]) -> dict[str, str]:
    """How many of the faults that do harm were routed rightly, and how many of either program blamed the other."""
    shown = [row for row in rows if row.verdict]
    code = [row for row in shown if row.truth == "fix_code"]
    tests = [row for row in shown if row.truth == "fix_test"]
    return {
        "faults": str(len(rows)),
        "harmless": str(len(rows) - len(shown)),
        "routed rightly": _format_share(shown, "right"),
        "code taken for tests": _format_share(code, "WRONG"),
        "tests taken for code": _format_share(tests, "WRONG"),
        "right test, wrong program": _format_share([row for row in shown if row.right_tests], "right"),
        "sure": f"{sum(row.sure for row in shown)}, wrongly {sum(row.sure and row.mark == 'WRONG' for row in shown)}",
    }


def _format_share(rows: Sequence[RoutedFault], mark: str) -> str:
    count = sum(row.mark == mark for row in rows)
    return f"{count} of {len(rows)}" + (f" ({100 * count / len(rows):.0f} %)" if rows else "")


def main(arguments: Sequence[str]) -> int:
    """Route the faults and print them with the shares.

    Returns:
        0 if ``TARGET`` of the faults that do harm are routed rightly, 1 if not.
    """
    parser = VisibleParser(prog="grs eval routing", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", help="faults in folders; without one, mistakes are made")
    parser.add_argument("--half", type=int, choices=(0, 1), default=1, help="which half of the made mistakes (1)")
    parser.add_argument("--seed", type=int, default=0, help="of the made mistakes")
    parser.add_argument("--policy", default="rules")
    parser.add_argument("--only", default="", help="a regular expression that names of faults match")
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args(arguments)
    planted = read_fault_folders(chosen.folder) if chosen.folder else plant_mistakes(chosen.half, chosen.seed)
    faults = list(filter(lambda fault: re.search(chosen.only, fault.name), planted))
    settings = [f"policy={chosen.policy}", "limits.cpu_seconds=10", *chosen.settings]
    rows = list(route_faults(faults, settings))
    summary = summarise_routing(rows)
    if chosen.json:
        print(json.dumps({"summary": summary, "rows": [row.model_dump() for row in rows]}, indent=2))
    else:
        print(*map(str, rows), sep="\n")
        print(*(f"{key}: {value}" for key, value in summary.items()), sep="\n")
    shown = [row.mark for row in rows if row.verdict]
    return 0 if shown.count("right") >= TARGET * len(shown) else 1
