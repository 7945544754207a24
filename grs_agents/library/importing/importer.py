"""Import of a source: each item in its own process, without duplicates, resumable by a journal."""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from grs_agents.base.errors import InputError
from grs_agents.library.asset import Asset, read_manifest
from grs_agents.library.importing.archives import ImportSource
from grs_agents.library.importing.asset_discovery import find_item_files
from grs_agents.library.importing.item_worker import ItemWorkers
from grs_agents.library.importing.journal import (
    FileHashes,
    ImportedAssets,
    Journal,
    compute_import_key,
    update_manifest_entries,
)
from grs_agents.library.importing.types import ImportJob, ImportOptions, ImportOutcome, RefusedError, SourceItem

_SAVE_EVERY = 10.0
"""Seconds between two writings of the manifest."""
_BASE_SECONDS, _SECONDS_A_MEGABYTE = 7200.0, 20.0
"""Wall seconds of all items of an import together, by the size of their files. A small file takes about 5 s; many of
them can name the same large file."""
_LICENSE_FILES = ("LICENSE", "LICENSE.txt", "LICENSE.md", "license.txt", "COPYING")


@dataclass
class ImportRun:
    """Import of a source into a library."""

    root: Path  # of the library
    collection: str  # folder of the library
    options: ImportOptions
    known: tuple[Asset, ...] = ()  # assets whose size and mass are known
    again: bool = False  # repeat earlier imports and refusals, too
    jobs: int = 1  # processes
    shipped: frozenset[str] = frozenset()  # names of shipped assets that an import would shadow
    _spent: float = field(default=0.0, init=False)  # wall seconds of all items

    def run(self, source: ImportSource, report: Callable[[ImportOutcome, bool], None]) -> list[ImportOutcome]:
        """The outcome of every item of a source, in their order.

        Args:
            report: called with each outcome as it is known, and whether it was known from an earlier import.

        Raises:
            InputError: the library cannot be read or written.
        """
        try:
            self.root.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            remedy = "name a writable folder with --library"
            raise InputError(f"cannot write {self.root}: {error.strerror}", remedy) from error
        journal, imported = Journal(self.root, self.collection), ImportedAssets(read_manifest(self.root).assets)
        outcomes: list[ImportOutcome] = []
        new: list[Asset] = []
        removed: set[str] = set()
        saved = time.monotonic()
        for archive, error in source.refused:
            outcomes.append(_make_refused_outcome(archive, archive, error, ""))
            report(outcomes[-1], False)
        try:
            for outcome, known in self._import_items_in_parallel(source, journal, imported):
                result = outcome if known else self._discard_duplicate_import(outcome, imported, removed)
                if result.asset is not None:
                    new.append(result.asset)
                    imported.add_asset(result.asset)
                if not known:
                    journal.record_outcome(result)
                outcomes.append(result)
                report(result, known)
                if time.monotonic() - saved > _SAVE_EVERY:
                    update_manifest_entries(self.root, new, removed)
                    saved = time.monotonic()
        finally:
            update_manifest_entries(self.root, new, removed)
        return outcomes

    def _import_items_in_parallel(
        self, source: ImportSource, journal: Journal, imported: ImportedAssets
    ) -> Iterator[tuple[ImportOutcome, bool]]:
        """Each item's outcome in their order, and whether it is from the journal."""
        workers, hashes = ItemWorkers(source.folder, self.options.limits, self.jobs), FileHashes(source.folder)
        threads = ThreadPoolExecutor(self.jobs)
        try:
            importing = partial(self._import_item, source, workers, hashes, journal, imported)
            yield from threads.map(importing, source.items)
        finally:
            threads.shutdown(cancel_futures=True)
            workers.close()

    def _import_item(
        self,
        source: ImportSource,
        workers: ItemWorkers,
        hashes: FileHashes,
        journal: Journal,
        imported: ImportedAssets,
        item: SourceItem,
    ) -> tuple[ImportOutcome, bool]:
        license_, key, begin = self._resolve_license(source, item), "", time.monotonic()
        try:
            if self._spent > (most := _BASE_SECONDS + _SECONDS_A_MEGABYTE * hashes.size / 1e6):
                remedy = "the same command goes on with the rest"
                raise RefusedError(f"the source has taken {self._spent:.0f} of at most {most:.0f} s", remedy)
            content = hashes.hash_item_files(find_item_files(source.folder, item))
            if source.folder.resolve_file(item.file).stat().st_size == 0:
                raise RefusedError(f"{item.file} is empty", "export it again")
            key = compute_import_key(content, self.options, license_)
            before = journal.outcomes.get(item.file)
            if before is not None and before.key == key and not self.again:
                origin = before.asset.origin if before.asset is not None else None
                if origin is None or all((self.root / name).is_file() for name in origin.files):
                    return before, True
            if copy := imported.find_same_content(content, f"{self.collection}/{item.name}.urdf"):
                why = f"of the same files as {copy}"
                return ImportOutcome(item=item.name, source=item.file, status="duplicate", reason=why, key=key), False
            job = ImportJob(
                source=source.folder.root,
                item=item,
                options=self.options,
                root=self.root.resolve(),
                collection=self.collection,
                content=content,
                license=license_,
                known=self.known if item.kind == "hope" else (),
            )
            asset = workers.import_item(job)
        except RefusedError as error:
            return _make_refused_outcome(item.name, item.file, error, key), False
        finally:
            self._spent += time.monotonic() - begin
        notes = asset.origin.notes if asset.origin is not None else ()
        if asset.name in self.shipped:
            notes = (*notes, "it takes the place of the shipped asset of that name; --name COLLECTION avoids it")
        done = ImportOutcome(item=item.name, source=item.file, status="imported", notes=notes, key=key, asset=asset)
        return done.model_copy(update={"seconds": round(time.monotonic() - begin, 2)}), False

    def _discard_duplicate_import(
        self, outcome: ImportOutcome, imported: ImportedAssets, removed: set[str]
    ) -> ImportOutcome:
        """The outcome, or ``duplicate`` for a copy of another asset; the copy's files are removed."""
        if outcome.asset is None or outcome.asset.origin is None:
            return outcome
        copy, variant = imported.find_same_shape(outcome.asset)
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

    def _resolve_license(self, source: ImportSource, item: SourceItem) -> str:
        """The user's licence, else that of a published set, else the first line of a licence file beside the item."""
        if self.options.license != "unknown":
            return self.options.license
        if item.license:
            return item.license
        folders = [source.folder.root / parent for parent in Path(item.file).parents]
        for path in (folder / name for folder in folders for name in _LICENSE_FILES):
            if path.is_file() and not path.is_symlink():
                with path.open(encoding="utf-8", errors="replace") as text:
                    lines = (" ".join(line.split()) for line in text.read(2000).splitlines())
                    return next((line[:200] for line in lines if line), "unknown")
        return "unknown"


def _make_refused_outcome(name: str, source: str, error: RefusedError, key: str) -> ImportOutcome:
    return ImportOutcome(item=name, source=source, status="refused", reason=f"{error.message}; {error.remedy}", key=key)
