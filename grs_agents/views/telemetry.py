"""A run as OpenTelemetry spans with the semantic conventions for generative AI (attributes ``gen_ai.*``). Any OTLP
backend shows the same tree: the run, its nodes, and in each node its model calls, tools and decisions. Spans are
made from events, live or later, with the timestamps of the events."""

import importlib
import json
from typing import Any

from grs_agents.base.errors import ConfigError
from grs_agents.base.trace.events import (
    Event,
    NodeEnded,
    NodeStarted,
    Prompt,
    Reply,
    Rollout,
    RunEnded,
    RunStarted,
    TestsRun,
)
from grs_agents.views.common.event_steps import summarise_event

_PROVIDERS = {
    **dict.fromkeys(("google", "google_genai"), "gcp.gemini"),
    **dict.fromkeys(("azure", "azure_openai"), "azure.ai.openai"),
    **dict.fromkeys(("bedrock", "bedrock_converse"), "aws.bedrock"),
    "google_vertexai": "gcp.vertex_ai",
    "ibm": "ibm.watsonx.ai",
    "mistralai": "mistral_ai",
    "offline": "grs",
    "xai": "x_ai",
}
"""OpenTelemetry's provider names that differ from LangChain's."""


def make_otlp_provider() -> Any:
    """A tracer provider that exports over OTLP/HTTP to the endpoint of the standard ``OTEL_*`` variables."""
    try:
        sdk = importlib.import_module("opentelemetry.sdk.trace")
        export = importlib.import_module("opentelemetry.sdk.trace.export")
        resources = importlib.import_module("opentelemetry.sdk.resources")
        otlp = importlib.import_module("opentelemetry.exporter.otlp.proto.http.trace_exporter")
    except ImportError as error:
        raise ConfigError("OpenTelemetry is not installed", 'pip install "grs-agents[otel]"') from error
    provider = sdk.TracerProvider(resource=resources.Resource.create({"service.name": "grs-agents"}))
    provider.add_span_processor(export.BatchSpanProcessor(otlp.OTLPSpanExporter()))
    return provider


class SpanView:
    """Subscriber of the event log that exports a run as spans, prompts and replies included."""

    def __init__(self, provider: Any) -> None:
        self._provider = provider
        self._trace = importlib.import_module("opentelemetry.trace")
        self._tracer = provider.get_tracer("grs_agents")
        self._run: Any = None
        self._node: Any = None
        self._prompts: dict[str, Prompt] = {}
        self._last = 0

    def __call__(self, event: Event) -> None:
        """Add an event to the spans."""
        self._last = round(event.time * 1e9)
        match event:
            case RunStarted():
                self._end_open_spans()
                shown = {"gen_ai.conversation.id": event.run_id, "grs.graph": event.graph, "grs.seed": event.seed}
                self._run = self._start_span(f"invoke_agent {event.graph}", None, _make_agent_attributes("grs") | shown)
            case NodeStarted():
                self._end_span(self._node)
                shown = _make_agent_attributes(event.node) | {"grs.visit": event.visit, "grs.attempt": event.attempt}
                self._node = self._start_span(f"invoke_agent {event.node}", self._run, shown)
            case NodeEnded():
                self._end_span(self._node, event.error)
                self._node = None
            case Prompt():
                self._prompts[event.call] = event
            case Reply():
                self._record_model_call(event)
            case RunEnded():
                if self._run is not None:
                    self._run.set_attributes({"grs.status": event.status, "grs.reason": event.reason})
                self._end_span(self._node)
                self._end_span(self._run, event.reason if event.status == "failed" else "")
                self._node = self._run = None
            case TestsRun():
                self._record_tool("run_tests", event, seconds=float(event.report.get("seconds") or 0))
            case Rollout():
                self._record_tool("rollout", event)
            case _:
                span = self._node or self._run
                fields = _FIELDS.get(event.kind)
                text = "" if fields else summarise_event(event)
                values = event.model_dump(include=fields) if fields else {"text": text} if text else {}
                if span is not None and values:
                    span.add_event(f"grs.{event.kind}", values, timestamp=self._last)

    def finish(self) -> None:
        """End the open spans and flush the exporter."""
        self._end_open_spans()
        self._provider.force_flush()
        self._provider.shutdown()

    def _start_span(
        self, name: str, parent: Any, attributes: dict[str, Any], at: int | None = None, kind: str = "INTERNAL"
    ) -> Any:
        context = self._trace.set_span_in_context(parent) if parent is not None else None
        kind_of_span = getattr(self._trace.SpanKind, kind)
        return self._tracer.start_span(
            name, context=context, kind=kind_of_span, attributes=attributes, start_time=at or self._last
        )

    def _end_span(self, span: Any, error: str = "") -> None:
        if span is None:
            return
        if error:
            span.set_status(self._trace.Status(self._trace.StatusCode.ERROR, error))
            span.set_attribute("error.type", error.partition(":")[0])
        span.end(end_time=self._last)

    def _end_open_spans(self) -> None:
        self._end_span(self._node)
        self._end_span(self._run)
        self._node = self._run = None

    def _record_model_call(self, event: Reply) -> None:
        """Add a span from the prompt to its reply."""
        prompt = self._prompts.pop(event.call, None)
        provider, _, name = event.model.partition(":")
        attributes: dict[str, Any] = {
            "gen_ai.operation.name": "chat",
            "gen_ai.provider.name": _PROVIDERS.get(provider, provider),
            "gen_ai.request.model": name or provider,
            "gen_ai.agent.name": event.role,
            "gen_ai.usage.input_tokens": event.input_tokens,
            "gen_ai.usage.output_tokens": event.output_tokens,
            "gen_ai.usage.cache_read.input_tokens": event.cached_tokens,
        }
        if event.finish_reason:
            attributes["gen_ai.response.finish_reasons"] = [event.finish_reason]
        if event.cost is not None:
            attributes["grs.cost_usd"] = event.cost
        if prompt is not None:
            attributes["gen_ai.input.messages"] = _dump_message("user", prompt.text)
        attributes["gen_ai.output.messages"] = _dump_message("assistant", event.text, event.finish_reason or "stop")
        begin = round(prompt.time * 1e9) if prompt else self._last - round(event.seconds * 1e9)
        span = self._start_span(f"chat {name or provider}", self._node or self._run, attributes, begin, "CLIENT")
        self._end_span(span, event.error)

    def _record_tool(self, tool: str, event: Event, seconds: float = 0.0) -> None:
        """Add a span of ``seconds`` that ends with ``event``."""
        parent = self._node or self._run
        if parent is None:
            return
        attributes = {
            "gen_ai.operation.name": "execute_tool",
            "gen_ai.tool.name": tool,
            "grs.result": summarise_event(event),
        }
        begin = self._last - round(seconds * 1e9)
        self._end_span(self._start_span(f"execute_tool {tool}", parent, attributes, begin))


def _make_agent_attributes(name: str) -> dict[str, Any]:
    return {"gen_ai.operation.name": "invoke_agent", "gen_ai.agent.name": name}


def _dump_message(role: str, text: str, finish: str = "") -> str:
    """A message in the JSON form of the conventions."""
    message: dict[str, Any] = {"role": role, "parts": [{"type": "text", "content": text}]}
    return json.dumps([message | ({"finish_reason": finish} if finish else {})], ensure_ascii=False)


_FIELDS: dict[str, set[str]] = {
    "decision": {"verdict", "explanation", "policy"},
    "finding": {"check", "passed", "measured", "bound"},
    "program_version": {"program", "number", "sha256", "diff"},
    "note": {"level", "text"},
}
"""Event fields exported as attributes of a span event; other kinds export their summary."""
