"""A process that prepares and writes items one after another: what breaks it breaks one item, not the import.

Orders come as lines of JSON on standard input, answers go as lines of JSON to standard output.
"""

import json
import os
import resource
import select
import subprocess
import sys
from pathlib import Path
from typing import IO, Any

from grs_agents.base import Frozen
from grs_agents.errors import InputError
from grs_agents.library.asset import Asset
from grs_agents.library.importing.source_folder import Folder
from grs_agents.library.importing.types import ImportOptions, Item, RefusedError

_GRACE = 2.0
"""Wall seconds for each second of processor time."""


class Order(Frozen):
    """One item to import.

    Attributes:
        source: folder of the source.
        item: one of its assets.
        options: how to read it.
        root: of the library.
        collection: folder of the library.
        content: SHA-256 of the item's files.
        license: of the item.
        known: the assets of which size and mass are known.
    """

    source: Path
    item: Item
    options: ImportOptions
    root: Path
    collection: str
    content: str
    license: str
    known: tuple[Asset, ...] = ()


def carry_out(order: Order) -> Asset:
    """Prepare and write one item.

    Raises:
        RefusedError: it is broken or not to be trusted.
        InputError: the library cannot be written.
    """
    from grs_agents.library.importing.preparation import prepare
    from grs_agents.library.importing.writing import write_prepared

    folder = Folder(order.source, order.options.limits.bytes)
    thing = prepare(folder, order.item, order.options, order.known)
    return write_prepared(order.root, order.collection, order.item, thing, order.content, order.license)


class Worker:
    """The parent's side: a process that is started when it is needed and again after it broke.

    Args:
        options: whose limits it keeps.
    """

    def __init__(self, options: ImportOptions) -> None:
        self._limits = options.limits
        self._process: subprocess.Popen[bytes] | None = None

    def import_item(self, order: Order) -> Asset:
        """What `carry_out` does, in the process.

        Raises:
            RefusedError: the item is refused, took too long or broke the process.
            InputError: the library cannot be written.
        """
        process = self._running()
        orders, answers = _pipes(process)
        try:
            orders.write(order.model_dump_json().encode() + b"\n")
            orders.flush()
            ready, _, _ = select.select([answers], [], [], _GRACE * self._limits.seconds)
            line = answers.readline() if ready else b""
        except OSError:
            line, ready = b"", [answers]
        if not line:
            self.close()
            seconds = _GRACE * self._limits.seconds
            reason = "it broke the process that read it" if ready else f"it took more than {seconds:.0f} s"
            raise RefusedError(f"{order.item.file}: {reason}", "simplify it")
        answer: dict[str, Any] = json.loads(line)
        if "asset" in answer:
            return Asset.model_validate(answer["asset"])
        error = RefusedError if answer["refused"] else InputError
        raise error(answer["message"], answer["remedy"])

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for pipe in _pipes(self._process):
                pipe.close()
            self._process = None

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "grs_agents.library.importing.worker", str(self._limits.memory)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, "MUJOCO_GL": "disabled"},
            )
        return self._process


def _pipes(process: subprocess.Popen[bytes]) -> tuple[IO[bytes], IO[bytes]]:
    if process.stdin is None or process.stdout is None:
        raise RuntimeError("the worker has no pipes")
    return process.stdin, process.stdout


def _answer(line: str) -> dict[str, Any]:
    try:
        asset = carry_out(Order.model_validate_json(line))
    except InputError as error:
        return {"refused": isinstance(error, RefusedError), "message": error.message, "remedy": error.remedy}
    except MemoryError:
        return {"refused": True, "message": "it needs too much memory", "remedy": "simplify it"}
    return {"asset": asset.model_dump(mode="json")}


def main() -> None:
    """Serve orders until standard input ends."""
    if sys.platform == "linux":
        memory = int(sys.argv[1])
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # libraries that print must not speak into the answers
    for line in sys.stdin:
        print(json.dumps(_answer(line)), file=answers, flush=True)


if __name__ == "__main__":
    main()
