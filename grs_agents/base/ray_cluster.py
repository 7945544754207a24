"""Work as tasks of a Ray cluster (docs.ray.io)."""

import importlib
import os
import sys
import uuid
from collections.abc import Callable, Collection, Generator, Sequence
from functools import partial
from typing import Any, Final, Literal, TypeVar

from grs_agents.base.errors import InputError
from grs_agents.base.interrupts import install_signal_handlers

Engine = Literal["local", "ray"]
"""Processes on this machine, or tasks of a Ray cluster."""
Item = TypeVar("Item")
Result = TypeVar("Result")
_RETRIES: Final = 3
"""Repetitions of a task whose worker or node was lost."""
_SHIPPED_VARIABLES: Final = frozenset(
    {"PYTHONPATH", "LANG", "LC_ALL", "MUJOCO_GL", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"}
    | {"XDG_CACHE_HOME", "HF_HOME", "HF_HUB_OFFLINE"}  # features of the library; weights of segmenters
    | {"SSL_CERT_FILE", "SSL_CERT_DIR", "REQUESTS_CA_BUNDLE"}
    | {name for proxy in ("HTTP", "HTTPS", "ALL", "NO") for name in (f"{proxy}_PROXY", f"{proxy.lower()}_proxy")}
)
"""Variables shipped to a cluster, with ``GRS_*``; no other variable leaves this machine, since many hold keys."""


def map_on_cluster(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    address: str | None,
    lose: Callable[[Item, str], Result],
    begin: Callable[..., object] = bool,
    arguments: tuple[Any, ...] = (),
    variables: Collection[str] = (),
) -> Generator[Result]:
    """Results of ``work`` for each item, as they are completed; each is a task with one CPU.

    All nodes need this package in the same place. A closed or interrupted generator ends the tasks under way.

    Args:
        work: a function; its errors are passed on.
        items: that it is called with.
        address: of the cluster; None: a local cluster, ended with the generator.
        lose: gives the result of an item whose worker was lost, from the item and the cause.
        begin: called with ``arguments`` by each worker process, before its first task.
        arguments: of ``begin``.
        variables: names of environment variables that are shipped to the workers, besides the usual ones.

    Raises:
        InputError: Ray is not installed, or there is no cluster at ``address``.
    """
    try:
        ray: Any = importlib.import_module("ray")
    except ImportError as error:
        raise InputError("engine ray needs the package ray", "pip install 'grs-agents[ray]'") from error
    started_here = not ray.is_initialized()
    if started_here:
        try:
            ray.init(address=address, log_to_driver=False, include_dashboard=False, configure_logging=False)
        except (ConnectionError, ValueError) as error:
            remedy = "ray start --head, or --address"
            raise InputError(f"there is no Ray cluster at {address}: {error}", remedy) from error
        install_signal_handlers()  # Ray has replaced them
    names = _SHIPPED_VARIABLES.union(variables)
    shipped = {name: value for name, value in os.environ.items() if name in names or name.startswith("GRS_")}
    prepare = partial(_prepare_worker, uuid.uuid4().hex, shipped, begin, arguments)
    running: dict[Any, Item] = {}
    try:
        task: Any = ray.remote(num_cpus=1, max_retries=_RETRIES)(_run_task)
        running.update((task.remote(prepare, work, item), item) for item in items)
        while running:
            (ended,), _ = ray.wait(list(running), num_returns=1)
            item = running.pop(ended)
            try:
                result: Result = ray.get(ended)
            except ray.exceptions.RayTaskError as error:
                raise error.cause from error
            except ray.exceptions.RayError as error:
                result = lose(item, f"its worker was lost {_RETRIES + 1} times: {type(error).__name__}")
            yield result
    finally:
        for unfinished in running:
            ray.cancel(unfinished, force=True)  # ends its worker, too
        if started_here:
            ray.shutdown()


_prepared: list[str] = []
"""Of a worker process: the call of ``map_on_cluster`` that it was last prepared for."""


def _prepare_worker(
    call: str, variables: dict[str, str], begin: Callable[..., object], arguments: tuple[Any, ...]
) -> None:
    """Set the shipped variables that the worker lacks and call ``begin``, once for each call."""
    if _prepared == [call]:
        return
    for name, value in variables.items():
        os.environ.setdefault(name, value)
    for folder in filter(None, variables.get("PYTHONPATH", "").split(os.pathsep)):
        if folder not in sys.path:  # set after this process began
            sys.path.append(folder)
    begin(*arguments)
    _prepared[:] = [call]


def _run_task(prepare: Callable[[], None], work: Callable[[Item], Result], item: Item) -> Result:
    prepare()
    return work(item)
