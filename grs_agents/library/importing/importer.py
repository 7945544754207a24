"""Importing a source: each item in a process of its own kind, copies left out, what was done remembered."""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue

from grs_agents.errors import InputError
from grs_agents.library.asset import Asset, read_manifest
from grs_agents.library.importing.archives import Opened
from grs_agents.library.importing.discovery import item_files
from grs_agents.library.importing.journal import Journal, Known, content_of, key_of, write_entries
from grs_agents.library.importing.types import ImportOptions, Item, Outcome, RefusedError
from grs_agents.library.importing.worker import Order, Worker

_SAVE_EVERY = 10.0
"""Seconds between two writings of the manifest."""


@dataclass
class Importing:
    """One import into a library.

    Attributes:
        root: of the library.
        collection: folder of the library.
        options: how to read the source.
        known: assets whose size and mass are known.
        again: import what was imported or refused before, too.
        jobs: processes.
    """

    root: Path
    collection: str
    options: ImportOptions
    known: tuple[Asset, ...] = ()
    again: bool = False
    jobs: int = 1
    _pool: SimpleQueue[Worker] = field(default_factory=SimpleQueue[Worker])

    def run(self, source: Opened, told: Callable[[Outcome, bool], None]) -> list[Outcome]:
        """Import every item of a source.

        Args:
            source: what to import.
            told: called with each outcome as it is known, and whether it was known from an earlier import.

        Returns:
            The outcomes in the order of the items.

        Raises:
            InputError: the library cannot be read or written.
        """
        journal, taken = Journal(self.root, self.collection), Known(read_manifest(_made(self.root)).assets)
        outcomes: list[Outcome] = []
        fresh: list[Asset] = []
        removed: set[str] = set()
        saved = time.monotonic()
        for archive, error in source.refused:
            outcomes.append(_refused(archive, archive, error, ""))
            told(outcomes[-1], False)
        try:
            for outcome, old in self._outcomes(source, journal, taken):
                result = outcome if old else self._judged(outcome, taken, removed)
                if result.asset is not None:
                    fresh.append(result.asset)
                    taken.add(result.asset)
                if not old:
                    journal.add(result)
                outcomes.append(result)
                told(result, old)
                if time.monotonic() - saved > _SAVE_EVERY:
                    write_entries(self.root, fresh, removed)
                    saved = time.monotonic()
        finally:
            write_entries(self.root, fresh, removed)
        return outcomes

    def _outcomes(self, source: Opened, journal: Journal, taken: Known) -> Iterator[tuple[Outcome, bool]]:
        """Each item's outcome in their order, and whether it is from the journal."""

        def one(item: Item) -> tuple[Outcome, bool]:
            return self._one(source, item, journal, taken)

        for _ in range(self.jobs):
            self._pool.put(Worker(self.options))
        threads = ThreadPoolExecutor(self.jobs)
        try:
            yield from threads.map(one, source.items)
        finally:
            threads.shutdown(cancel_futures=True)
            while not self._pool.empty():
                self._pool.get().close()

    def _one(self, source: Opened, item: Item, journal: Journal, taken: Known) -> tuple[Outcome, bool]:
        name, license_, key = f"{self.collection}/{item.name}.urdf", self._license(source, item), ""
        begin = time.monotonic()
        try:
            content = content_of(source.folder, item_files(source.folder, item))
            key = key_of(content, self.options, license_)
            before = journal.outcomes.get(item.file)
            if before is not None and before.key == key and not self.again and self._stands(before):
                return before, True
            if copy := taken.of_content(content, name):
                return self._copy(item, copy, key), False
            order = Order(
                source=source.folder.root,
                item=item,
                options=self.options,
                root=self.root.resolve(),
                collection=self.collection,
                content=content,
                license=license_,
                known=self.known if item.kind == "hope" else (),
            )
            worker = self._pool.get()
            try:
                asset = worker.import_item(order)
            finally:
                self._pool.put(worker)
        except RefusedError as error:
            return _refused(item.name, item.file, error, key), False
        seconds = round(time.monotonic() - begin, 2)
        notes = asset.origin.notes if asset.origin is not None else ()
        done = Outcome(item=item.name, source=item.file, status="imported", notes=notes, key=key, asset=asset)
        return done.model_copy(update={"seconds": seconds}), False

    def _stands(self, outcome: Outcome) -> bool:
        """Whether what an outcome tells is still there."""
        files = outcome.asset.origin.files if outcome.asset is not None and outcome.asset.origin is not None else {}
        return all((self.root / name).is_file() for name in files)

    def _judged(self, outcome: Outcome, taken: Known, removed: set[str]) -> Outcome:
        """The outcome, or, where a copy has been made, that it is one; the copy's files are removed."""
        if outcome.asset is None or outcome.asset.origin is None:
            return outcome
        copy, variant = taken.like(outcome.asset)
        if variant is not None:
            return outcome.model_copy(update={"notes": (*outcome.notes, f"it has the shape of {variant}")})
        if copy is None:
            return outcome
        for name in outcome.asset.origin.files:
            (self.root / name).unlink(missing_ok=True)
        for picture in (self.root / self.collection / "views").glob(f"{outcome.item}-?.png"):
            picture.unlink()
        removed.add(outcome.asset.name)
        reason = f"of the same shape and look as {copy}"
        return outcome.model_copy(update={"status": "duplicate", "reason": reason, "asset": None})

    def _copy(self, item: Item, copy: str, key: str) -> Outcome:
        return Outcome(
            item=item.name, source=item.file, status="duplicate", reason=f"of the same files as {copy}", key=key
        )

    def _license(self, source: Opened, item: Item) -> str:
        """What the user says, else what the set is known for, else the first line of a licence file beside it."""
        if self.options.license != "unknown":
            return self.options.license
        return item.license or _license_file(source.folder.root, item.file) or "unknown"


def _license_file(root: Path, file: str) -> str | None:
    for folder in [root / parent for parent in Path(file).parents]:
        for name in ("LICENSE", "LICENSE.txt", "LICENSE.md", "license.txt", "COPYING"):
            path = folder / name
            if path.is_file() and not path.is_symlink():
                with path.open(encoding="utf-8", errors="replace") as text:
                    lines = (" ".join(line.split()) for line in text.read(2000).splitlines())
                    return next((line[:200] for line in lines if line), None)
    return None


def _made(root: Path) -> Path:
    try:
        root.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write {root}: {error.strerror}", "name a writable folder with --library") from error
    return root


def _refused(name: str, source: str, error: RefusedError, key: str) -> Outcome:
    return Outcome(item=name, source=source, status="refused", reason=f"{error.message}; {error.remedy}", key=key)
