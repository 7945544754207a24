"""Process pool: a function mapped over items, results in the order of completion."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import Any, Final, TypeVar

from grs_agents.base.errors import GrsError
from grs_agents.base.parent_death import die_with_parent

Item = TypeVar("Item")
Result = TypeVar("Result")
_THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def map_in_processes(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    workers: int,
    begin: Callable[..., object],
    arguments: tuple[Any, ...] = (),
) -> Generator[Result]:
    """Results of ``work`` for each item, as they are completed; a single worker runs here, in the items' order.

    ``work`` and ``begin`` are module-level functions; each process calls ``begin(*arguments)`` once, first. After an
    interruption the items under way are completed.

    Raises:
        GrsError: a process was killed, e.g. for lack of memory. Errors of ``work`` are passed on.
    """
    if workers == 1 or len(items) < 2:
        begin(*arguments)
        yield from map(work, items)
        return
    with _limit_workers_to_one_thread():
        spawn: Any = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(
            min(workers, len(items)), spawn, _initialize_worker_process, (os.getpid(), begin, arguments)
        )
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


@contextmanager
def _limit_workers_to_one_thread() -> Generator[None]:
    """Let processes started meanwhile compute matrix products on a single thread: there is a process for each core."""
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


def _initialize_worker_process(parent: int, begin: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    die_with_parent(parent, signal.SIGKILL)  # a worker of a killed parent would wait for work for ever
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent is interrupted, and ends this process
    begin(*arguments)
