"""A process that prepares and writes items one after another: what breaks it breaks one item, not the import.
Jobs come as lines of JSON on standard input, answers go as lines of JSON to standard output."""

import json
import os
import resource
import select
import subprocess
import sys
from typing import IO, Any

from grs_agents.errors import InputError
from grs_agents.library.asset import Asset
from grs_agents.library.importing.types import ImportJob, ImportLimits, RefusedError

_WALL_SECONDS = 2.0
"""For each second of processor time."""


class Worker:
    """The parent's side: a process that is started when it is needed and again after it broke."""

    def __init__(self, limits: ImportLimits) -> None:
        self._memory, self._seconds = limits.memory, _WALL_SECONDS * limits.seconds
        self._process: subprocess.Popen[bytes] | None = None

    def import_item(self, job: ImportJob) -> Asset:
        """Prepare and write an item in the process, which it must not break nor occupy too long; its entry."""
        jobs, answers = self._ensure_process_pipes()
        try:
            jobs.write(job.model_dump_json().encode() + b"\n")
            jobs.flush()
            ready, _, _ = select.select([answers], [], [], self._seconds)
            line = answers.readline() if ready else b""
        except OSError:
            line, ready = b"", [answers]
        if not line:
            self.close()
            reason = "it broke the process that read it" if ready else f"it took more than {self._seconds:.0f} s"
            raise RefusedError(f"{job.item.file}: {reason}", "simplify it")
        answer: dict[str, Any] = json.loads(line)
        if "asset" in answer:
            return Asset.model_validate(answer["asset"])
        error = RefusedError if answer["refused"] else InputError
        raise error(answer["message"], answer["remedy"])

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def _ensure_process_pipes(self) -> tuple[IO[bytes], IO[bytes]]:
        """Standard input and output of the process."""
        if self._process is None or self._process.poll() is not None:
            command, pipe = [sys.executable, "-P", "-m", __name__, str(self._memory)], subprocess.PIPE
            self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL)
        if self._process.stdin is None or self._process.stdout is None:
            raise RuntimeError("the worker has no pipes")
        return self._process.stdin, self._process.stdout


def _process_job_line(line: str) -> dict[str, Any]:
    from grs_agents.library.importing.asset_preparation import prepare_asset
    from grs_agents.library.importing.asset_writing import write_asset_files

    try:
        job = ImportJob.model_validate_json(line)
        asset = write_asset_files(job.root, *prepare_asset(job))
    except InputError as error:
        return {"refused": isinstance(error, RefusedError), "message": error.message, "remedy": error.remedy}
    except MemoryError:
        return {"refused": True, "message": "it needs too much memory", "remedy": "simplify it"}
    return {"asset": asset.model_dump(mode="json")}


def main() -> None:
    """Serve jobs until standard input ends."""
    if sys.platform == "linux":
        memory = int(sys.argv[1])
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # libraries that print must not speak into the answers
    for line in sys.stdin:
        print(json.dumps(_process_job_line(line)), file=answers, flush=True)


if __name__ == "__main__":
    main()
