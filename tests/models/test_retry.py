"""Retries against a real server on loopback, driven by the real langchain-openai client."""

from dataclasses import dataclass, field, replace

import pytest
from langchain_core.messages import HumanMessage

from grs_agents.base.config.schema import ModelConfig
from grs_agents.base.errors import GrsError
from grs_agents.models.answer import Answer, ProviderFailure, ReplyProblem
from grs_agents.models.call import Retries, invoke_with_retries
from grs_agents.models.factory import make_chat_model
from tests.models.conftest import Scripted

FAILURE = {"error": {"message": "told so", "type": "api_error", "code": None}}


@dataclass
class Clock:
    waits: list[float] = field(default_factory=list)

    def retries(self) -> Retries:
        return Retries(sleep=self.waits.append)


@pytest.fixture
def clock() -> Clock:
    return Clock()


def ask(url: str, clock: Clock) -> Answer:
    model = make_chat_model(ModelConfig(model="openai:any", base_url=url, timeout=5), seed=0)
    return invoke_with_retries(model, [HumanMessage("hi")], clock.retries())


def test_a_reply_comes_with_its_token_usage(server: tuple[Scripted, str], clock: Clock) -> None:
    script, url = server
    script.complete("hello")
    answer = ask(url, clock)
    assert answer.text == "hello"
    assert (answer.input_tokens, answer.output_tokens) == (11, 5)


@pytest.mark.parametrize("status", [429, 500, 503, 529])
def test_retryable_errors_are_tried_again_with_growing_waits(
    server: tuple[Scripted, str], clock: Clock, status: int
) -> None:
    script, url = server
    script.say(status, FAILURE)
    script.say(status, FAILURE)
    script.complete()
    assert ask(url, clock).text == "hello"
    assert clock.waits == [1.0, 2.0]
    assert len(script.requests) == 3


def test_each_wait_is_twice_the_one_before(server: tuple[Scripted, str], clock: Clock) -> None:
    script, url = server
    script.say(503, FAILURE)
    model = make_chat_model(ModelConfig(model="openai:any", base_url=url, timeout=5), seed=0)
    with pytest.raises(ProviderFailure):
        invoke_with_retries(model, [HumanMessage("hi")], replace(clock.retries(), tries=5))
    assert clock.waits == [1.0, 2.0, 4.0, 8.0]


@pytest.mark.parametrize(("asked", "waited"), [("2", 2.0), ("60", 60.0), ("0", 0.0)])
def test_retry_after_is_honoured(server: tuple[Scripted, str], clock: Clock, asked: str, waited: float) -> None:
    script, url = server
    script.say(429, FAILURE, Retry_After=asked)
    script.complete()
    ask(url, clock)
    assert clock.waits == [waited]


def test_nobody_waits_longer_than_the_deadline(server: tuple[Scripted, str], clock: Clock) -> None:
    script, url = server
    script.say(429, FAILURE, Retry_After="3600")
    with pytest.raises(ProviderFailure, match=r"3600 s, beyond the deadline of 300 s") as caught:
        ask(url, clock)
    assert (caught.value.kind, clock.waits, len(script.requests)) == ("rate_limit", [], 1)


@pytest.mark.parametrize("status", [400, 401, 403, 404])
def test_permanent_errors_end_at_once_in_one_line(server: tuple[Scripted, str], clock: Clock, status: int) -> None:
    script, url = server
    script.say(status, FAILURE)
    with pytest.raises(GrsError, match=str(status)) as caught:
        ask(url, clock)
    assert len(script.requests) == 1
    assert "\n" not in str(caught.value)
    assert not isinstance(caught.value, ReplyProblem)


def test_after_three_tries_it_gives_up(server: tuple[Scripted, str], clock: Clock) -> None:
    script, url = server
    script.say(500, FAILURE)
    with pytest.raises(GrsError, match="3 tries"):
        ask(url, clock)
    assert len(script.requests) == 3


def test_a_used_up_quota_is_not_retried(server: tuple[Scripted, str], clock: Clock) -> None:
    script, url = server
    script.say(429, {"error": {"message": "no quota", "type": "insufficient_quota", "code": "insufficient_quota"}})
    with pytest.raises(GrsError):
        ask(url, clock)
    assert len(script.requests) == 1


@pytest.mark.parametrize("body", [b'{"id":"x","choices":[{"ind', b"<html>gateway</html>"])
def test_a_malformed_answer_is_retried_then_reported(server: tuple[Scripted, str], clock: Clock, body: bytes) -> None:
    script, url = server
    script.say(200, body)
    with pytest.raises(GrsError):
        ask(url, clock)
    assert len(script.requests) == 3


def test_nobody_listens(clock: Clock) -> None:
    with pytest.raises(ProviderFailure, match=r"http://127\.0\.0\.1:9 cannot be reached in 3 tries.*refused") as caught:
        ask("http://127.0.0.1:9/v1", clock)
    assert caught.value.kind == "unreachable"


@pytest.mark.parametrize(
    ("text", "finish", "message", "kind"),
    [
        ("", "stop", {}, "empty"),
        (None, "stop", {}, "empty"),
        ("half a prog", "length", {}, "length"),
        ("half a prog", None, {}, "unfinished"),
        (None, "stop", {"refusal": "I cannot"}, "refusal"),
        ("", "content_filter", {}, "refusal"),
    ],
)
def test_replies_that_only_look_whole_are_typed_problems(
    server: tuple[Scripted, str],
    clock: Clock,
    text: str | None,
    finish: str | None,
    message: dict[str, str],
    kind: str,
) -> None:
    script, url = server
    script.complete(text, finish, **message)
    with pytest.raises(ReplyProblem) as caught:
        ask(url, clock)
    assert caught.value.kind == kind
    assert len(script.requests) == 1
