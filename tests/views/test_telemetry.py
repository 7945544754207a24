"""A run as OpenTelemetry spans."""

import json
from collections.abc import Callable
from typing import Any

import pytest
from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter

from grs_agents.base.errors import ConfigError
from grs_agents.base.trace.events import NodeEnded, NodeStarted
from grs_agents.base.trace.log import read_events
from grs_agents.views import telemetry
from grs_agents.views.telemetry import SpanView, make_otlp_provider

Spans = list[dict[str, Any]]


@pytest.fixture
def told(script: Callable[[], Any]) -> tuple[Any, Callable[[], Spans]]:
    """A run, and what the SDK's in-memory exporter holds of it."""
    run = script()

    def tell() -> Spans:
        memory, provider = InMemorySpanExporter(), TracerProvider()
        provider.add_span_processor(SimpleSpanProcessor(memory))
        view = SpanView(provider)
        for event in read_events(run.log.path):
            view(event)
        view.finish()
        return [json.loads(span.to_json()) for span in memory.get_finished_spans()]

    return run, tell


def test_the_tree_is_run_node_call(told: tuple[Any, Callable[[], Spans]]) -> None:
    run, tell = told
    run.before_fix()
    run.after_fix()
    found = tell()
    by_id = {span["context"]["span_id"]: span for span in found}
    names = {span["name"]: span for span in found}
    assert len({span["context"]["trace_id"] for span in found}) == 1
    roots = [span for span in found if span["parent_id"] is None]
    assert [span["name"] for span in roots] == ["invoke_agent grs"]
    assert roots[0]["attributes"]["grs.status"] == "accepted"
    chats = [span for span in found if span["attributes"]["gen_ai.operation.name"] == "chat"]
    parents = [by_id[span["parent_id"]]["name"] for span in chats]
    assert parents == ["invoke_agent generate_task", "invoke_agent generate_sim", "invoke_agent fix_code"]
    chat = chats[-1]
    assert (chat["name"], chat["kind"]) == ("chat offline", "SpanKind.CLIENT")
    assert chat["attributes"]["gen_ai.usage.input_tokens"] == 900
    assert chat["attributes"]["gen_ai.response.finish_reasons"] == ["stop"]
    asked = json.loads(chat["attributes"]["gen_ai.input.messages"])
    assert asked[0]["parts"][0]["content"].startswith("# Role: fix_code")
    assert names["execute_tool rollout"]["attributes"]["grs.result"] == "seed 1: success, reward 1.00"
    decided = [event for span in found for event in span["events"] if event["name"] == "grs.decision"]
    assert decided[0]["attributes"]["verdict"] == "fix_code"
    assert all(span["start_time"] <= span["end_time"] for span in found)


def test_errors_and_an_interrupted_run_end_their_spans(told: tuple[Any, Callable[[], Spans]]) -> None:
    run, tell = told
    run.before_fix()
    run.log.append(NodeStarted(node="audit"))
    run.log.append(NodeEnded(node="audit", seconds=0.1, error="KeyError: 'x'"))
    run.log.append(NodeStarted(node="route", visit=2))
    names = {span["name"]: span for span in tell()}
    assert names["invoke_agent audit"]["status"]["status_code"] == "ERROR"
    assert names["invoke_agent audit"]["attributes"]["error.type"] == "KeyError"
    assert names["invoke_agent route"]["end_time"] and names["invoke_agent grs"]["end_time"]


def test_without_the_extra_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> Any:
        raise ImportError(name)

    monkeypatch.setattr(telemetry.importlib, "import_module", missing)
    with pytest.raises(ConfigError, match=r'pip install "grs-agents\[otel\]"'):
        make_otlp_provider()
