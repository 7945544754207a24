"""Runs as tasks of a Ray cluster (docs.ray.io): a task starts one run as a process on the node it lands on.

All nodes need this package in the same place, and the folder of the batch on storage that they share.
"""

import importlib
import os
from collections.abc import Callable, Collection, Sequence
from typing import Any

from grs_agents.base.errors import InputError
from grs_agents.base.interrupts import install_signal_handlers
from grs_agents.runs.batch.run_process import RunEnd, RunJob, RunProcesses, Watcher, run_job

_CPUS_OF_RUN = 1
"""A run is one process that computes, with a sandbox that waits for it or is waited for."""
_RETRIES = 3
"""How often a run is made again whose worker or node was lost; its folder says how far it came."""
_SETTINGS = "GRS_"
"""Begins the names of variables that set the configuration."""
_OF_EVERY_RUN = frozenset(
    {"PYTHONPATH", "LANG", "LC_ALL", "MUJOCO_GL", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"}
    | {"XDG_CACHE_HOME", "HF_HOME", "HF_HUB_OFFLINE"}  # features of the library; weights of segmenters
    | {"SSL_CERT_FILE", "SSL_CERT_DIR", "REQUESTS_CA_BUNDLE"}
    | {name for proxy in ("HTTP", "HTTPS", "ALL", "NO") for name in (f"{proxy}_PROXY", f"{proxy.lower()}_proxy")}
)
"""Variables that change how a run goes; each other one stays here, where keys of many things lie among them."""


def run_on_cluster(
    jobs: Sequence[RunJob], watch: Watcher, timeout: float, address: str | None, variables: Collection[str]
) -> None:
    """Make the runs as tasks, and tell ``watch`` of each end.

    Args:
        variables: environment variables that the models read; they go along with those that every run may need.

    Raises:
        InputError: no Ray, or no cluster there.
    """
    try:
        ray: Any = importlib.import_module("ray")
    except ImportError as error:
        raise InputError("engine ray needs the package ray", "pip install 'grs-agents[ray]'") from error
    ours = not ray.is_initialized()
    if ours:
        _connect_to_ray_cluster(ray, address)
    try:
        _run_tasks(ray, jobs, watch, timeout, variables)
    finally:
        if ours:
            ray.shutdown()


def _connect_to_ray_cluster(ray: Any, address: str | None) -> None:
    try:
        ray.init(address=address, log_to_driver=False, include_dashboard=False, configure_logging=False)
    except (ConnectionError, ValueError) as error:
        raise InputError(f"there is no Ray cluster at {address}: {error}", "ray start --head, or --address") from error
    install_signal_handlers()  # Ray has put its own in their place


def _run_tasks(ray: Any, jobs: Sequence[RunJob], watch: Watcher, timeout: float, variables: Collection[str]) -> None:
    names = _OF_EVERY_RUN.union(variables)
    shipped = {name: value for name, value in os.environ.items() if name in names or name.startswith(_SETTINGS)}
    task: Any = ray.remote(num_cpus=_CPUS_OF_RUN, max_retries=_RETRIES)(_make_runner_with_variables(shipped))
    under_way = {task.remote(job, timeout): job for job in jobs}
    try:
        while under_way:
            (ended,), _ = ray.wait(list(under_way), num_returns=1)
            job = under_way.pop(ended)
            try:
                end: RunEnd = ray.get(ended)
            except ray.exceptions.RayError as error:
                end = RunEnd(job, None, f"its worker was lost {_RETRIES + 1} times: {type(error).__name__}")
            watch(end)
    except BaseException:
        for ended in under_way:
            ray.cancel(ended, force=True)  # the run ends with its worker
        raise


def _make_runner_with_variables(environment: dict[str, str]) -> Callable[[RunJob, float], RunEnd]:
    """`run_job` with variables of the one who ordered it: a model may need its key."""

    def run_job_with_environment(job: RunJob, timeout: float) -> RunEnd:
        for name, value in environment.items():
            os.environ.setdefault(name, value)
        return run_job(job, timeout, RunProcesses())

    return run_job_with_environment
