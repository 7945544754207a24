"""Journal of an import, a line for each item, so that it can be resumed. Also finds duplicates: assets of the same
files, or of the same shape and the same look."""

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from grs_agents.base.files import flush_written_files, make_folder, refuse_link, unwritable_error, write_json
from grs_agents.library.asset import MANIFEST, Asset, AssetManifest, Origin, read_manifest
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.types import ImportOptions, ImportOutcome, RefusedError

_VERSION = "2"
"""Of the importer's output; a new version imports everything again."""


class Journal:
    """The outcomes of a collection; the last line of an item counts."""

    def __init__(self, root: Path, collection: str) -> None:
        self.path = root / "imports" / f"{collection}.jsonl"
        self.outcomes: dict[str, ImportOutcome] = {}
        for path in (self.path.parent, self.path):  # the library may be foreign
            refuse_link(path)
        if self.path.is_file():
            for line in self.path.read_text("utf-8", errors="replace").splitlines():
                try:
                    outcome = ImportOutcome.model_validate_json(line)
                except ValidationError:
                    continue  # an import was stopped while it wrote this line
                self.outcomes[outcome.source] = outcome

    def record_outcome(self, outcome: ImportOutcome) -> None:
        """Remember an outcome, on disk too."""
        self.outcomes[outcome.source] = outcome
        try:
            make_folder(self.path.parent)
            flush_written_files()  # the outcome says that the asset's files are there
            with self.path.open("a+b") as file:
                torn = file.tell() > 0 and (file.seek(-1, os.SEEK_END), file.read(1))[1] != b"\n"
                file.write((b"\n" if torn else b"") + outcome.model_dump_json().encode() + b"\n")
        except OSError as error:
            raise unwritable_error(self.path, error) from error


def compute_import_key(content: str, options: ImportOptions, license_: str) -> str:
    """Hash of all inputs of an asset: while it stays the same, so does the asset."""
    settings = options.model_dump_json(exclude={"limits", "license"})
    return hashlib.sha256(f"{_VERSION} {content} {settings} {license_}".encode()).hexdigest()


class FileHashes:
    """SHA-256 of the files of a source, each read once."""

    def __init__(self, folder: SourceFolder) -> None:
        self._folder = folder
        self._digests: dict[str, bytes] = {}
        self.size = 0  # bytes of the files so far

    def hash_item_files(self, files: tuple[str, ...]) -> str:
        """SHA-256 of the files of an item. Raises RefusedError: a file cannot be read."""
        for name in files:
            if name in self._digests:
                continue
            try:
                with self._folder.resolve_file(name).open("rb") as file:
                    self._digests[name] = hashlib.file_digest(file, "sha256").digest()
                    self.size += file.tell()
            except OSError as error:
                raise RefusedError(f"cannot read {name}: {error.strerror}", "make it readable") from error
        return hashlib.sha256(b"".join(self._digests[name] for name in files)).hexdigest()


def update_manifest_entries(root: Path, assets: Iterable[Asset], removed: Iterable[str] = ()) -> None:
    """Put entries into the manifest in place of those of the same name, and take ``removed`` out."""
    root.mkdir(parents=True, exist_ok=True)
    entries = {asset.name: asset for asset in read_manifest(root).assets if asset.name not in removed}
    entries |= {asset.name: asset for asset in assets}
    manifest = AssetManifest(assets=tuple(entries[name] for name in sorted(entries)))
    write_json(root / MANIFEST, manifest.model_dump(mode="json"), durable=True)


_SHAPE_TOLERANCE, _LOOK_TOLERANCE = 0.01, 0.15
"""Most that numbers of the shape differ, as a share; most that shares of colours differ in all."""


class ImportedAssets:
    """The imported assets that there are, to find copies among."""

    def __init__(self, assets: Iterable[Asset]) -> None:
        self._by_content: dict[str, str] = {}
        self._origins: dict[str, Origin] = {}
        for asset in assets:
            self.add_asset(asset)

    def add_asset(self, asset: Asset) -> None:
        """Take an asset into the comparison."""
        if asset.origin is not None:
            self._by_content.setdefault(asset.origin.content, asset.name)
            self._origins[asset.name] = asset.origin

    def find_same_content(self, content: str, name: str) -> str | None:
        """The name of another asset than ``name`` that was made from the same files."""
        original = self._by_content.get(content)
        return original if original != name else None

    def find_same_shape(self, asset: Asset) -> tuple[str | None, str | None]:
        """Names of an asset of the same shape and look, and of an asset of the same shape alone."""
        origin, variant = asset.origin, None
        if origin is None or not self._origins:
            return None, None
        names, origins = list(self._origins), list(self._origins.values())
        shapes = np.array([known.shape for known in origins])
        difference = np.abs(shapes - origin.shape) / np.maximum(np.abs(shapes), 1e-12)
        for index in np.flatnonzero(difference.max(axis=1) < _SHAPE_TOLERANCE):
            if names[index] == asset.name:
                continue
            if np.abs(np.subtract(origins[index].look, origin.look)).sum() < _LOOK_TOLERANCE:
                return names[index], None
            variant = variant or names[index]
        return None, variant
