"""How much a provider may send, and how long it may take over one reply."""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from contextvars import ContextVar, copy_context
from dataclasses import dataclass
from functools import partial
from threading import Thread
from typing import Any, TypeVar

from grs_agents.interrupts import is_interrupt_requested
from grs_agents.models.answer import ReplyProblem

Result = TypeVar("Result")
_LOOK = 0.2
"""Seconds between two looks at whether the run was asked to end."""
LONGEST = 16 * 2**20
"""Bytes of one HTTP body, decoded. The longest context windows hold some 4 MB of text; JSON doubles that at worst."""


@dataclass
class _Call:
    """A call that is under way."""

    over: bool = False  # whether nobody waits for it any more
    problem: ReplyProblem | None = None  # why its body was not read to the end


_call: ContextVar[_Call | None] = ContextVar("call", default=None)


def limit_response_size(client: Any) -> None:
    """Let ``client``, of httpx or its successor httpx2, read at most ``LONGEST`` bytes of a body."""
    client.headers["accept-encoding"] = "gzip, deflate"  # these grow at most 1000 times, so a chunk stays small
    hooks: dict[str, list[Any]] = client.event_hooks
    if _limit_response_hook not in hooks["response"]:  # LangChain shares a client among models
        client.event_hooks = {**hooks, "response": [*hooks["response"], _limit_response_hook]}


def _limit_response_hook(response: Any) -> None:
    response.iter_bytes = partial(_read_limited_chunks, response.iter_bytes)


def _read_limited_chunks(read: Callable[..., Iterator[bytes]], *sizes: int, **named: int) -> Iterator[bytes]:
    call = _call.get()
    length = 0
    for chunk in read(*sizes, **named):
        length += len(chunk)
        if length > LONGEST:
            message = f"the provider sends more than {LONGEST / 2**20:.0f} MB in one reply"
            problem = ReplyProblem("too_long", message, "check base_url")
            if call is not None:
                call.problem = problem
            raise problem
        if call is not None and call.over:
            raise TimeoutError("nobody waits for this reply any more")
        yield chunk


def call_with_timeout(seconds: float | None, ask: Callable[[], Result]) -> Result:
    """What ``ask`` returns, waiting at most so many seconds in all; None waits as long as it takes.

    A client's own time-out holds for each read, so a server that sends a byte now and then never meets it. The call
    runs in a thread; after a time-out that thread ends with the next bytes that arrive.

    Raises:
        TimeoutError: it took longer.
        ReplyProblem: the body was too long, whatever the client made of that.
    """
    call, future = _Call(), Future[Result]()
    context = copy_context()
    context.run(_call.set, call)

    def work() -> None:
        try:
            future.set_result(context.run(ask))
        except BaseException as error:  # raised again where the result is waited for
            future.set_exception(error)
            if not isinstance(error, Exception):
                raise

    if seconds is None:
        return ask()
    Thread(target=work, name="model-call", daemon=True).start()
    try:
        return _wait_for_result(future, seconds)
    except Exception as error:
        if call.problem is not None:
            raise call.problem from error
        if not future.done():
            raise TimeoutError(f"no whole reply in {seconds:g} s") from error
        raise
    finally:
        call.over = True


def _wait_for_result(future: Future[Result], seconds: float) -> Result:
    """The result within so many seconds, unless the run was asked to end: of that only the main thread is told."""
    end = time.monotonic() + seconds
    while not wait([future], timeout=max(0.0, min(_LOOK, end - time.monotonic()))).done:
        if is_interrupt_requested():
            raise KeyboardInterrupt
        if time.monotonic() >= end:
            raise TimeoutError
    return future.result()
