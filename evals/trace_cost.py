"""Cost of tracing: the size of the recording and its share of the CPU time, in a run with many fixes."""

import importlib
import re
import shutil
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

from langchain_core.callbacks import CallbackManagerForLLMRun
from langchain_core.language_models.chat_models import BaseChatModel
from langchain_core.messages import AIMessage, BaseMessage
from langchain_core.outputs import ChatGeneration, ChatResult

from grs_agents.agents.agent import Agents
from grs_agents.base import Frozen, content
from grs_agents.base.config.schema import Config
from grs_agents.base.trace.events import Event, RunEnded, RunStarted
from grs_agents.base.trace.log import EventLog, read_events
from grs_agents.graph.policies.policy_registry import load_policy
from grs_agents.graph.services import Services
from grs_agents.library.library import Library
from grs_agents.runs.experiment_run import ExperimentParser
from grs_agents.runs.experiments import terminal_table
from grs_agents.runs.metrics import cpu_seconds
from grs_agents.runs.sandbox_setup import open_sandbox

LARGEST_MIB, LARGEST_SHARE = 15.0, 0.05
"""The bounds of a run with ten fixes and three rollouts."""


class Cost(Frozen):
    """The cost of a run.

    Attributes:
        status: of its record.
        fixes, rollouts, events: recorded numbers.
        mib: size of ``trace.rrd``.
        trace_seconds: CPU time of log and recording.
        run_seconds: CPU time of all the rest: Python's start, imports and the sandbox included, as in ``grs run``.
        import_seconds: CPU time of importing rerun, once and in neither of the above.
    """

    status: str
    fixes: int
    rollouts: int
    events: int
    mib: float
    trace_seconds: float
    run_seconds: float
    import_seconds: float

    @property
    def share(self) -> float:
        """Overhead of tracing over the run's CPU time."""
        return self.trace_seconds / self.run_seconds

    @property
    def kept(self) -> bool:
        """True if both bounds are kept."""
        return self.mib <= LARGEST_MIB and self.share <= LARGEST_SHARE


class Clumsy(BaseChatModel):
    """The offline model, whose simulation programs stop too early until ``faults`` errors were reported."""

    inner: BaseChatModel
    faults: int
    spoilt: int = 0
    good: str = ""

    @property
    def _llm_type(self) -> str:
        return "clumsy"

    def _generate(
        self,
        messages: list[BaseMessage],
        stop: list[str] | None = None,
        run_manager: CallbackManagerForLLMRun | None = None,
        **kwargs: Any,
    ) -> ChatResult:
        reply = self.inner.invoke(messages)
        self.good = text = self.good or str(reply.text)
        if self.spoilt < self.faults:
            self.spoilt += 1
            text = re.sub(
                r"self\.max_steps = \d+", f"self.max_steps = {1 + self.spoilt % 2}  # try {self.spoilt}", text
            )
        message = AIMessage(text, response_metadata=reply.response_metadata)
        message.usage_metadata = reply.usage_metadata
        return ChatResult(generations=[ChatGeneration(message=message)])


class ClumsyAgents(Agents):
    """Agents whose simulation authors share a clumsy model."""

    faults = 10
    _clumsy: Clumsy | None = None

    def chat_model_for_role(self, role: str) -> BaseChatModel:
        """The chat model that serves ``role``."""
        if role not in ("simulation", "fix_code"):
            return super().chat_model_for_role(role)
        if self._clumsy is None:
            self._clumsy = Clumsy(inner=super().chat_model_for_role(role), faults=self.faults)
        return self._clumsy


class TimedLog(EventLog):
    """An event log that adds up the CPU time of writing and of its subscribers, in the threads that they run in."""

    seconds = 0.0

    def append(self, event: Event) -> Event:
        """Append and add the CPU time."""
        begin = time.thread_time()
        try:
            return super().append(event)
        finally:
            self.seconds += time.thread_time() - begin


@contextmanager
def _timed_rows() -> Generator[list[float]]:
    """CPU times of sending rows, in threads."""
    from grs_agents.views.rerun.recording import RowBatcher

    spent: list[float] = []
    send = RowBatcher.send_pending_rows

    def timed(rows: RowBatcher) -> None:
        begin = time.thread_time()
        try:
            send(rows)
        finally:
            spent.append(time.thread_time() - begin)

    with mock.patch.object(RowBatcher, "send_pending_rows", timed):
        yield spent


def measure(scene: Path, folder: Path, fixes: int, config: Config) -> Cost:
    """Run the graph ``grs`` on ``scene`` with ``fixes`` fixes and measure the cost of its trace."""
    begin = cpu_seconds()
    for module in ("rerun", "rerun.blueprint"):
        importlib.import_module(module)
    imported = cpu_seconds() - begin
    from grs_agents.views.rerun.rerun_view import TRACE, RerunView

    log = TimedLog(folder / "events.jsonl")
    with log:
        with open_sandbox(config) as sandbox, _timed_rows() as sending:
            agents = ClumsyAgents(config=config, log=log, folder=folder)
            agents.faults = fixes
            policy = load_policy(config.policy)
            services = Services(config, log, agents, policy, sandbox, folder)
            view = RerunView(folder, Library())
            log.subscribe(view)
            log.append(RunStarted(run_id="trace_cost", graph="grs", seed=config.seed))
            graph = content.load_module("graphs", "grs").build().compile()
            state: dict[str, Any] = {"scene_path": str(scene), "max_fixes": fixes + 1, "fixes": 0, "history": []}
            ended = graph.invoke(state, {"recursion_limit": 25 + 4 * fixes}, context=services)
            log.append(RunEnded(status=str(ended["status"]), reason=str(ended.get("reason", ""))))
        nanoseconds = 0
        for task in Path("/proc/self/task").glob("[0-9]*"):
            if (task / "comm").read_text().startswith(("ChunkBatcher", "RecordingStream", "file_writer", "tokio")):
                nanoseconds += int((task / "schedstat").read_text().split()[0])
        spent = log.seconds + sum(sending) + (nanoseconds / 1e9)
        last = time.process_time()
        view.finish()
        spent += time.process_time() - last
    whole = cpu_seconds() - imported
    kinds = [event.kind for event in read_events(folder / "events.jsonl")]
    return Cost(
        status=str(ended["status"]),
        fixes=int(ended["fixes"]),
        rollouts=kinds.count("rollout"),
        events=len(kinds),
        mib=(folder / TRACE).stat().st_size / 2**20,
        trace_seconds=spent,
        run_seconds=whole - spent,
        import_seconds=imported,
    )


def main(arguments: Sequence[str]) -> int:
    """Measure, print, and return 0 if the bounds are kept, else 1."""
    parser = ExperimentParser("trace_cost", __doc__)
    parser.add_argument("--scene", type=Path, default=content.content_path("assets", "scenes") / "groceries")
    parser.add_argument("--fixes", type=int, default=10)
    experiment = parser.start(
        arguments, lambda options: (f"max_fixes={options.fixes + 1}", "audit.seeds=3", "policy=always_code")
    )
    options, folder = experiment.options, experiment.options.out.resolve() / "run"

    def measure_anew() -> Cost:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        return measure(options.scene, folder, options.fixes, experiment.config)

    (cost,) = experiment.make_or_reuse_rows(Cost, {"run": measure_anew})
    run = f"{cost.status}, {cost.fixes} fixes, {cost.rollouts} rollouts, {cost.events} events"
    traced = f"{cost.trace_seconds:.2f} s, {100 * cost.share:.1f} %"
    rows = [
        {"what": "run", "value": run, "bound": ""},
        {"what": "recording", "value": f"{cost.mib:.1f} MiB", "bound": f"{LARGEST_MIB:.0f} MiB"},
        {"what": "CPU time of the run", "value": f"{cost.run_seconds:.1f} s", "bound": ""},
        {"what": "CPU time of importing rerun", "value": f"{cost.import_seconds:.1f} s", "bound": ""},
        {"what": "CPU time of tracing", "value": traced, "bound": f"{100 * LARGEST_SHARE:.0f} %"},
    ]
    shown = terminal_table("trace", ("what", "value", "bound"), rows)
    experiment.tell(rows, shown, **cost.model_dump(), share=cost.share, kept=cost.kept)
    return 0 if cost.kept else 1
