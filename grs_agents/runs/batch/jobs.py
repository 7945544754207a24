"""Many runs, here or on a cluster."""

from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Literal

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
    """Make the runs, ``workers`` at a time, each killed after ``timeout`` seconds; ``watch`` hears of each end.

    A run whose folder holds a verdict is not made again; one that was interrupted is resumed. An interruption ends the
    runs that are under way before it goes on.

    Args:
        engine: ``local`` starts processes here, ``ray`` on the cluster at ``address`` (its own on this machine
            where that is ``None``); there ``workers`` is what the cluster's CPUs allow.
        variables: environment variables that the models read, which go along to a cluster.

    Raises:
        InputError: Ray is not installed, or there is no cluster at ``address``.
    """
    ends: dict[str, RunEnd] = {}

    def store_ended_job(end: RunEnd) -> None:
        ends[end.job.name] = end
        watch(end)

    if engine == "ray":
        from grs_agents.runs.batch.ray_engine import run_on_cluster

        run_on_cluster(jobs, store_ended_job, timeout, address, variables)
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
