"""Many runs, on this machine or as tasks of a Ray cluster (docs.ray.io)."""

import importlib
import os
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any, Literal

from grs_agents.base.errors import InputError
from grs_agents.base.interrupts import install_signal_handlers
from grs_agents.runs.batch.run_process import RunEnd, RunJob, RunProcesses, Watcher, run_job

Engine = Literal["local", "ray"]


def run_jobs(
    jobs: Sequence[RunJob],
    watch: Watcher = lambda _: None,
    *,
    workers: int = 2,
    timeout: float = 600,
    engine: Engine = "local",
    address: str | None = None,
    variables: Collection[str] = (),
) -> list[RunEnd]:
    """Make the runs, ``workers`` at a time, each killed after ``timeout`` seconds; ``watch`` receives each end.

    A run with a verdict is not repeated; an interrupted run is resumed. An interruption ends the running
    processes before it propagates.

    Args:
        engine: ``local`` starts processes on this machine, ``ray`` tasks on the cluster at ``address`` (None: a
            local cluster), whose CPUs bound the number of parallel runs.
        variables: environment variables of the models, shipped to a cluster.

    Raises:
        InputError: Ray is not installed, or there is no cluster at ``address``.
    """
    ends: dict[str, RunEnd] = {}

    def store_ended_job(end: RunEnd) -> None:
        ends[end.job.name] = end
        watch(end)

    if engine == "ray":
        _run_on_cluster(jobs, store_ended_job, timeout, address, variables)
    else:
        processes = RunProcesses()
        with ThreadPoolExecutor(max_workers=workers) as pool:
            futures = [pool.submit(run_job, job, timeout, processes) for job in jobs]
            try:
                for future in as_completed(futures):
                    store_ended_job(future.result())
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                processes.end()
                raise
    return [ends[job.name] for job in jobs]


_RETRIES = 3
"""Repetitions of a run whose worker or node was lost; the run resumes in its folder."""
_SHIPPED_VARIABLES = frozenset(
    {"PYTHONPATH", "LANG", "LC_ALL", "MUJOCO_GL", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"}
    | {"XDG_CACHE_HOME", "HF_HOME", "HF_HUB_OFFLINE"}  # features of the library; weights of segmenters
    | {"SSL_CERT_FILE", "SSL_CERT_DIR", "REQUESTS_CA_BUNDLE"}
    | {name for proxy in ("HTTP", "HTTPS", "ALL", "NO") for name in (f"{proxy}_PROXY", f"{proxy.lower()}_proxy")}
)
"""Variables shipped to a cluster, with ``GRS_*``; no other variable leaves this machine, since many hold keys."""


def _run_on_cluster(
    jobs: Sequence[RunJob], watch: Watcher, timeout: float, address: str | None, variables: Collection[str]
) -> None:
    """Make the runs as Ray tasks; each starts a process on its node.

    All nodes need this package in the same place, and the folder of the batch on shared storage.
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

    def run_job_with_variables(job: RunJob, timeout: float) -> RunEnd:
        for name, value in shipped.items():
            os.environ.setdefault(name, value)
        return run_job(job, timeout, RunProcesses())

    running: dict[Any, RunJob] = {}
    try:
        # A run is a single computing process; it and its sandbox take turns.
        task: Any = ray.remote(num_cpus=1, max_retries=_RETRIES)(run_job_with_variables)
        running.update((task.remote(job, timeout), job) for job in jobs)
        while running:
            (ended,), _ = ray.wait(list(running), num_returns=1)
            job = running.pop(ended)
            try:
                end: RunEnd = ray.get(ended)
            except ray.exceptions.RayError as error:
                end = RunEnd(job, None, f"its worker was lost {_RETRIES + 1} times: {type(error).__name__}")
            watch(end)
    except BaseException:
        for task_of_run in running:
            ray.cancel(task_of_run, force=True)  # the run ends with its worker
        raise
    finally:
        if started_here:
            ray.shutdown()
