"""Many runs, on this machine or as tasks of a Ray cluster (docs.ray.io)."""

from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import closing
from functools import cache, partial

from grs_agents.base.ray_cluster import Engine, map_on_cluster
from grs_agents.runs.batch.run_process import RunEnd, RunJob, RunProcesses, Watcher, run_job


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
        work = partial(_run_in_task, timeout)
        with closing(map_on_cluster(work, jobs, address, _lose_run, variables=variables)) as ended:
            for end in ended:
                store_ended_job(end)
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
        processes.close()
    return [ends[job.name] for job in jobs]


def _run_in_task(timeout: float, job: RunJob) -> RunEnd:
    """Make a run in a process of the node; the task's CPU is enough, for the run and its sandbox take turns."""
    return run_job(job, timeout, _processes_of_worker())


@cache
def _processes_of_worker() -> RunProcesses:
    """The runs of a worker of the cluster, which share a warm parent."""
    return RunProcesses()


def _lose_run(job: RunJob, why: str) -> RunEnd:
    return RunEnd(job, None, why)
