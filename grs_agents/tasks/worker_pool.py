"""The same work on many things, in processes of their own: what is done comes back as it is done."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import Any, Final, TypeVar

from grs_agents.base.errors import GrsError

Item = TypeVar("Item")
Result = TypeVar("Result")
_THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def map_in_processes(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    workers: int,
    begin: Callable[..., object],
    arguments: tuple[Any, ...] = (),
) -> Iterator[Result]:
    """``work`` of each item, in no order; with one worker, in this process and in theirs.

    ``work`` and ``begin`` are functions of a module; each process calls ``begin(*arguments)`` once, first. An
    interruption ends it as soon as the items under way are done.

    Raises:
        GrsError: a process was killed, as for want of memory. What ``work`` raises is passed on.
    """
    if workers == 1 or len(items) < 2:
        begin(*arguments)
        yield from map(work, items)
        return
    with _limit_workers_to_one_thread():
        yield from _map_in_pool(work, items, workers, begin, arguments)


@contextmanager
def _limit_workers_to_one_thread() -> Generator[None]:
    """Processes that begin meanwhile leave threads of matrix products alone: there are as many of them as cores."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _map_in_pool(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    workers: int,
    begin: Callable[..., object],
    arguments: tuple[Any, ...],
) -> Iterator[Result]:
    spawn: Any = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(workers, len(items)), spawn, _initialize_worker_process, (begin, arguments))
    left = iter(items)
    running: set[Future[Result]] = set()
    try:
        while True:
            running.update(pool.submit(work, item) for item in islice(left, workers + 1 - len(running)))
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                yield future.result()
    except BrokenProcessPool as error:
        raise GrsError("a process at work was killed", "run the command again, with fewer --workers") from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _initialize_worker_process(begin: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent is interrupted, and ends this process
    begin(*arguments)
