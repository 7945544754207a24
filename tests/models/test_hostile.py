"""Providers that send too much, too slowly, or what is no reply: a real server on loopback, the real client."""

import gzip
import json
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest
from langchain_core.language_models.fake_chat_models import GenericFakeChatModel
from langchain_core.messages import AIMessage, HumanMessage

from grs_agents.base.config.load import load_config
from grs_agents.base.config.schema import ModelConfig
from grs_agents.base.errors import GrsError
from grs_agents.models.answer import Answer, ProviderFailure, ReplyProblem
from grs_agents.models.call import LONGEST, Retries, invoke_with_retries
from grs_agents.models.factory import make_chat_model
from tests.needs import needs

pytestmark = needs("langchain_openai")
Send = Callable[[BaseHTTPRequestHandler], None]
KEY = "sk-0123456789-of-mine"


@pytest.fixture
def provider() -> Iterator[Callable[[Send], str]]:
    """Starts a server whose every answer is what a function writes; gives its base URL."""
    running: list[ThreadingHTTPServer] = []

    def start(send: Send) -> str:
        class Handler(BaseHTTPRequestHandler):
            def log_message(self, *args: Any, **named: Any) -> None:
                """Stay silent."""

            def do_POST(self) -> None:
                self.rfile.read(int(self.headers["Content-Length"]))
                try:
                    send(self)
                except OSError:  # the client has hung up
                    self.close_connection = True

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        server.daemon_threads = True
        running.append(server)
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        return f"http://127.0.0.1:{server.server_address[1]}/v1"

    yield start
    for server in running:
        server.shutdown()
        server.server_close()


def ask(url: str, deadline: float = 60.0, timeout: float = 60.0) -> Answer:
    model = make_chat_model(ModelConfig(model="openai:any", base_url=url, timeout=timeout), seed=0)
    return invoke_with_retries(model, [HumanMessage("hi")], Retries(tries=1, deadline=deadline))


def start_body(to: BaseHTTPRequestHandler, status: int = 200, **headers: str) -> None:
    to.send_response(status)
    for name, value in {"Content-Type": "application/json", **headers}.items():
        to.send_header(name.replace("_", "-"), value)
    to.end_headers()


def whole(body: bytes, status: int = 200) -> Send:
    """An answer of this body."""

    def send(to: BaseHTTPRequestHandler) -> None:
        start_body(to, status, Content_Length=str(len(body)))
        to.wfile.write(body)

    return send


def completion(content: Any, **fields: Any) -> bytes:
    """A chat completion with this content, and other fields in place of the usual ones."""
    choice = {"index": 0, "message": {"role": "assistant", "content": content}, "finish_reason": "stop"}
    usage = {"prompt_tokens": 11, "completion_tokens": 5, "total_tokens": 16, "cost": 0.25}
    whole = {"id": "x", "object": "chat.completion", "created": 1, "model": "any", "choices": [choice], "usage": usage}
    return json.dumps({**whole, **fields}).encode()


@pytest.mark.parametrize("status", [200, 500])
def test_a_body_without_end_is_read_up_to_a_bound(provider: Callable[[Send], str], status: int) -> None:
    sent: list[int] = []

    def send(to: BaseHTTPRequestHandler) -> None:
        start_body(to, status, Connection="close")
        while True:
            to.wfile.write(b" " * 2**16)
            sent.append(2**16)

    with pytest.raises(ProviderFailure, match="16 MB") as caught:
        ask(provider(send))
    assert caught.value.kind == "too_long"
    assert sum(sent) < 2 * LONGEST


def test_a_packed_body_is_bounded_as_it_is_unpacked(provider: Callable[[Send], str]) -> None:
    body = gzip.compress(b" " * (4 * LONGEST))

    def send(to: BaseHTTPRequestHandler) -> None:
        start_body(to, Content_Encoding="gzip", Content_Length=str(len(body)))
        to.wfile.write(body)

    with pytest.raises(ProviderFailure) as caught:
        ask(provider(send))
    assert caught.value.kind == "too_long"


@pytest.mark.parametrize("entry", [b"{}", b"[]", b"0"])
def test_a_body_of_many_entries_is_not_made_into_objects(provider: Callable[[Send], str], entry: bytes) -> None:
    body = b'{"id": "x", "choices": [' + b",".join([entry] * 1_000_000) + b"]}"
    with pytest.raises(ProviderFailure, match="200,000 JSON entries") as caught:
        ask(provider(whole(body)))
    assert caught.value.kind == "too_long"


@pytest.mark.parametrize("headers", [True, False])
def test_a_byte_now_and_then_does_not_outlast_the_deadline(provider: Callable[[Send], str], headers: bool) -> None:
    given_up = threading.Event()

    def send(to: BaseHTTPRequestHandler) -> None:
        to.wfile.write(b"HTTP/1.1 200 OK\r\nX-Slow: ")
        if headers:
            to.wfile.write(b"no\r\nContent-Type: application/json\r\n\r\n")
        while not given_up.wait(0.05):
            to.wfile.write(b" ")

    # each read ends long before the client's own time-out: only a total bound ends the call
    with pytest.raises(GrsError, match=r"no whole reply in 0\.5 s"):
        ask(provider(send), deadline=0.5)
    given_up.set()


NO_REPLIES = {
    "no choices": completion("x", choices=[]),
    "null choices": completion("x", choices=None),
    "content that is an object": completion({"a": 1}),
    "deep": b'{"choices": ' + b"[" * 100_000 + b"]" * 100_000 + b"}",
    "list": b"[]",
    "text": b"nonsense",
    "no message": json.dumps({"id": "x", "choices": [{"index": 0, "finish_reason": "stop"}]}).encode(),
    "tokens": completion("x", usage={"prompt_tokens": "many", "completion_tokens": 5, "total_tokens": 16}),
    "digits": b'{"id": ' + b"9" * 5000 + b"}",
    "surrogate": completion("half a \ud800 pair"),
}


@pytest.mark.parametrize("name", NO_REPLIES)
def test_what_is_no_reply_is_an_unusable_reply(provider: Callable[[Send], str], name: str) -> None:
    with pytest.raises((ProviderFailure, ReplyProblem)) as caught:
        ask(provider(whole(NO_REPLIES[name])))
    assert caught.value.kind in ("malformed", "empty")
    str(caught.value).encode()


@pytest.mark.parametrize("cost", [-1, -1e300, float("nan"), 1e308, 10**400])
def test_a_cost_that_no_reply_has_is_no_cost(provider: Callable[[Send], str], cost: float) -> None:
    usage = {"prompt_tokens": 1, "completion_tokens": 1, "total_tokens": 2, "cost": cost}
    assert ask(provider(whole(completion("x", usage=usage)))).cost is None


def test_an_unusable_reply_tells_what_it_cost(provider: Callable[[Send], str]) -> None:
    with pytest.raises(ReplyProblem) as caught:
        ask(provider(whole(completion("half a \ud800 pair"))))
    assert caught.value.answer is not None
    assert (caught.value.answer.input_tokens, caught.value.answer.output_tokens) == (11, 5)
    assert caught.value.answer.cost == 0.25


@pytest.mark.parametrize(
    ("metadata", "reason"),
    [
        ({"finish_reason": "STOP"}, "STOP"),
        ({"finish_reason": "eos_token"}, "eos_token"),
        ({"finish_reason": "COMPLETE"}, "COMPLETE"),
        ({"finish_reason": "what nobody knows"}, "what nobody knows"),
        ({"finish_reason": {"type": "stop", "matched": 2}}, "stop"),
        ({"stopReason": "tool_use"}, "tool_use"),
        ({"completionReason": "FINISH"}, "FINISH"),
        ({"stop_reason": "end_turn"}, "end_turn"),
        ({"done_reason": "stop"}, "stop"),
        ({"status": "completed"}, "completed"),
    ],
)
def test_each_provider_spells_the_finish_reason_its_own_way(metadata: dict[str, str], reason: str) -> None:
    model = GenericFakeChatModel(messages=iter([AIMessage("hello", response_metadata=metadata)]))
    assert invoke_with_retries(model, [HumanMessage("hi")]).finish_reason == reason


@pytest.mark.parametrize(
    ("metadata", "kind"),
    [
        ({"finish_reason": "length"}, "length"),
        ({"finish_reason": "MAX_TOKENS"}, "length"),
        ({"finish_reason": "FinishReason.MAX_TOKENS"}, "length"),
        ({"finish_reason": "model_length"}, "length"),
        ({"finish_reason": {"type": "length", "length": 9}}, "length"),
        ({"completionReason": "LENGTH"}, "length"),
        ({"status": "incomplete", "incomplete_details": {"reason": "max_output_tokens"}}, "length"),
        ({"status": "incomplete", "incomplete_details": {"reason": "content_filter"}}, "refusal"),
        ({"finish_reason": "content-filter"}, "refusal"),
        ({"finish_reason": "RECITATION"}, "refusal"),
        ({"stopReason": "guardrail_intervened"}, "refusal"),
        ({"finish_reason": "ERROR_TOXIC"}, "refusal"),
        ({"finish_reason": "error"}, "unfinished"),
        ({"finish_reason": "abort"}, "unfinished"),
        ({"finish_reason": "insufficient_system_resource"}, "unfinished"),
        ({"stop_reason": "pause_turn"}, "unfinished"),
    ],
)
def test_the_names_of_a_cut_and_of_a_filter_are_known(metadata: dict[str, Any], kind: str) -> None:
    model = GenericFakeChatModel(messages=iter([AIMessage("half of", response_metadata=metadata)]))
    with pytest.raises(ReplyProblem) as caught:
        invoke_with_retries(model, [HumanMessage("hi")])
    assert caught.value.kind == kind


def message(field: str, value: Any, content: Any = None) -> bytes:
    """A completion whose message has another field too."""
    words = {"role": "assistant", "content": content, field: value}
    return completion(None, choices=[{"index": 0, "message": words, "finish_reason": "stop"}])


@pytest.mark.parametrize("field", ["reasoning_content", "reasoning"])
def test_a_reply_that_is_all_reasoning_says_so_with_the_setting_that_ends_it(
    provider: Callable[[Send], str], field: str
) -> None:
    with pytest.raises(ReplyProblem, match=rf"empty.*4 characters into {field}; .*--reasoning-parser") as caught:
        ask(provider(whole(message(field, "hmm."))))
    assert caught.value.kind == "empty"
    assert ask(provider(whole(message(field, "hmm.", "hello")))).text == "hello"


def test_the_setting_that_ends_reasoning_reaches_the_server(provider: Callable[[Send], str]) -> None:
    settings = ["models.default=openai:any", "models.arguments.extra_body.chat_template_kwargs.enable_thinking=false"]
    url = provider(whole(completion("hello")))
    config = load_config(None, [*settings, f"models.base_url={url}"], {}).config.models["default"]
    assert make_chat_model(config, seed=0).model_dump()["extra_body"] == {
        "chat_template_kwargs": {"enable_thinking": False}
    }


@pytest.mark.parametrize(
    ("reply", "told"),
    [
        (AIMessage("", additional_kwargs={"reasoning_content": "hmm."}), "4 characters into reasoning_content"),
        (AIMessage([{"type": "thinking", "thinking": "hmm."}]), "4 characters into blocks of the type thinking"),
        (AIMessage([{"type": "thinking", "thinking": [{"type": "text", "text": "hmm."}]}]), "4 characters"),
        (AIMessage([{"type": "reasoning", "summary": [{"type": "summary_text", "text": "hmm."}]}]), "4 characters"),
        (AIMessage([{"type": "reasoning_content", "reasoning_content": {"text": "hmm."}}]), "4 characters"),
    ],
)
def test_each_client_sets_reasoning_apart_its_own_way(reply: AIMessage, told: str) -> None:
    model = GenericFakeChatModel(messages=iter([reply]))
    with pytest.raises(ReplyProblem, match=told):
        invoke_with_retries(model, [HumanMessage("hi")])


@pytest.mark.parametrize(
    "send",
    [
        whole(json.dumps({"error": {"message": f"wrong key {KEY}", "code": KEY}}).encode(), 401),
        whole(json.dumps({"error": {"message": "x" * 250 + KEY}}).encode(), 400),
        whole(f"<html>{KEY}</html>".encode(), 500),
        whole(completion("", refusal=KEY)),
        whole(completion(None, choices=[{"index": 0, "finish_reason": KEY, "message": {"content": ""}}])),
    ],
)
def test_an_echoed_key_is_in_no_error(
    provider: Callable[[Send], str], send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    with pytest.raises(GrsError) as caught:
        ask(provider(send))
    assert KEY[:12] not in str(caught.value)


def test_an_echoed_key_is_in_no_reply(provider: Callable[[Send], str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MY_OWN", KEY)
    model = ModelConfig(
        model="openai:any", base_url=provider(whole(completion(f"your key is {KEY}."))), key_variable="MY_OWN"
    )
    answer = invoke_with_retries(make_chat_model(model, seed=0), [HumanMessage("hi")])
    assert answer.text == "your key is [removed]."


@pytest.mark.parametrize("key", ["none", "EMPTY", "test"])
def test_a_word_that_stands_for_a_key_is_left_in_the_text(
    provider: Callable[[Send], str], monkeypatch: pytest.MonkeyPatch, key: str
) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", key)
    assert ask(provider(whole(completion(f"def {key}(): pass")))).text == f"def {key}(): pass"
