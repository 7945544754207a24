"""Index of assets on disk for approximate nearest-neighbour search, memory-mapped.

Only this module uses FAISS. Most vectors are in an inverted file that is mapped into memory; vectors added since are
beside it and are searched exhaustively, until there are enough of them to build the inverted file again.

An asset and a query are each a vector of words, look and size. Nothing is learnt or downloaded: words are hashed, looks
projected, sizes encoded by random Fourier features (Rahimi and Recht 2007), so that the product of two vectors is the
weighted sum of three similarities in 0..1.
"""

import hashlib
import json
import re
from collections.abc import Sequence
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from pydantic import Field, ValidationError

from grs_agents.base import Frozen, Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.files import unwritable_error, write_bytes, write_json, write_text
from grs_agents.perception.matching.color_histogram import BINS
from grs_agents.perception.types import Array

WORDS, LOOK, SIZE = 192, 96, 96
DIMENSIONS = WORDS + LOOK + SIZE
WEIGHTS = (0.45, 0.3, 0.25)  # of words, look and size; they add up to 1
_WIDTH = 0.25  # standard deviation of the Gaussian kernel on log sizes
Vectors = npt.NDArray[np.float32]


def embed_object(
    description: str = "", look: npt.NDArray[np.float32] | None = None, size: Vec3 | None = None
) -> Vectors:
    """The vector (DIMENSIONS,) of an object; a missing part has similarity 0 to everything.

    Args:
        description: in words.
        look: (BINS,) square roots of shares of tones (`color_histogram`); of several views their mean.
        size: extents in m, in any order.
    """
    parts = [
        embed_words(description),
        np.zeros(LOOK) if look is None else embed_color_histogram(look),
        embed_sizes(np.array(size)) if size else np.zeros(SIZE),
    ]
    scaled = [np.sqrt(weight) * part for weight, part in zip(WEIGHTS, parts, strict=True)]
    return np.concatenate(scaled).astype(np.float32)


def embed_words(text: str) -> Array:
    """Unit vector (WORDS,): each word, and each of its runs of four letters, adds to the place of its hash."""
    vector = np.zeros(WORDS)
    for word in re.findall(r"[a-z0-9]+", text.lower()):
        for token, weight in ((word, 1.0), *((word[i : i + 4], 0.25) for i in range(len(word) - 3))):
            place, sign = _hash_token(token)
            vector[place] += sign * weight
    length = float(np.linalg.norm(vector))
    return vector / length if length else vector


@lru_cache(maxsize=65536)
def _hash_token(token: str) -> tuple[int, float]:
    digest = hashlib.blake2b(token.encode(), digest_size=8).digest()
    return int.from_bytes(digest[:4], "little") % WORDS, 1.0 if digest[4] & 1 else -1.0


def embed_color_histogram(look: npt.NDArray[np.floating[Any]]) -> Array:
    """Unit vectors (..., LOOK): random projections of square roots of shares of tones (..., BINS)."""
    projected = look.astype(np.float64) @ _random_projection_matrix()
    return projected / np.maximum(np.linalg.norm(projected, axis=-1, keepdims=True), 1e-12)


@lru_cache(maxsize=1)
def _random_projection_matrix() -> Array:
    return np.random.default_rng(1).normal(size=(BINS, LOOK)) / np.sqrt(LOOK)


def embed_sizes(sizes: Array) -> Array:
    """Unit vectors (..., SIZE) of extents (..., 3) in m in any order.

    The product of two approximates a Gaussian kernel on the logarithms of the sizes.
    """
    phases = np.log(np.sort(np.maximum(sizes, 1e-4), axis=-1)) @ _random_fourier_frequencies()
    return np.concatenate([np.cos(phases), np.sin(phases)], axis=-1) / np.sqrt(SIZE / 2)


@lru_cache(maxsize=1)
def _random_fourier_frequencies() -> Array:
    return np.random.default_rng(2).normal(size=(3, SIZE // 2)) / _WIDTH


_META, _VERSION = "index.json", 1
_FEW: Final = 2000  # up to this number vectors are searched exhaustively
_SORTED_AGAIN: Final = 0.1  # largest share of vectors beside the inverted file
_PROBED: Final = 0.12  # share of the lists that is searched
_TRAINED: Final = 64  # training vectors for each list


class _Meta(Frozen):
    """Metadata: number of vectors in the inverted file and beside it, and the row numbers of removed names."""

    version: int = _VERSION
    dimensions: int = DIMENSIONS
    generation: int = Field(default=0, ge=0)
    base: int = Field(default=0, ge=0)
    beside: int = Field(default=0, ge=0)
    removed: tuple[int, ...] = ()


class AssetIndex:
    """Names and vectors in a folder, created by the first `add`.

    Raises:
        InputError: the folder holds a broken index, an index of another version, or other files.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._meta = _Meta()
        file = folder / _META
        if file.exists():
            try:
                self._meta = _Meta.model_validate_json(file.read_text(encoding="utf-8"))
            except (OSError, ValidationError) as error:
                raise _broken_index_error(folder, error) from error
            if (self._meta.version, self._meta.dimensions) != (_VERSION, DIMENSIONS):
                raise InputError(f"{folder} holds an index of another version", "delete it and index again")
        elif folder.is_dir() and any(folder.iterdir()):
            raise InputError(f"{folder} holds no index, but other things", "name an empty folder or one with an index")
        self._open_index_files()

    def __len__(self) -> int:
        return self._meta.base + self._meta.beside - len(self._meta.removed)

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name in self._row_numbers_by_name()

    def names(self) -> list[str]:
        """All names, in the order of adding."""
        gone = set(self._meta.removed)
        return [name for number, name in enumerate(self._names) if number not in gone]

    def add(self, names: Sequence[str], vectors: Vectors) -> None:
        """Add vectors (N, DIMENSIONS), or replace those of the same names; atomic.

        Raises:
            InputError: the shapes disagree, a name comes twice, a number is not finite, or the folder is
                read-only.
        """
        if vectors.shape != (len(names), DIMENSIONS):
            raise InputError(
                f"{len(names)} names and vectors {vectors.shape}", f"give one of {DIMENSIONS} for each name"
            )
        if len(set(names)) != len(names):
            raise InputError("a name is given twice", "give each name once")
        if not np.isfinite(vectors).all():
            raise InputError("a vector holds a number that is not finite", "leave that asset out")
        places = self._row_numbers_by_name()
        gone = tuple(sorted({*self._meta.removed, *(places[name] for name in names if name in places)}))
        if len(names) > max(_FEW, _SORTED_AGAIN * self._meta.base):
            self._rebuild_inverted_file(names, vectors, gone)
            return
        beside = self._meta.beside + len(names)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            _overwrite_file_tail(
                self._index_file_path("f32"), vectors.astype("<f4").tobytes(), 4 * DIMENSIONS * self._meta.beside
            )
            added = "".join(json.dumps(name, ensure_ascii=False) + "\n" for name in names)
            known = "".join(json.dumps(name, ensure_ascii=False) + "\n" for name in self._names[self._meta.base :])
            _overwrite_file_tail(self._index_file_path("beside"), added.encode(), len(known.encode()))
        except OSError as error:
            raise unwritable_error(self.folder, error) from error
        self._save_metadata_and_reopen(self._meta.model_copy(update={"beside": beside, "removed": gone}))

    def remove(self, names: Sequence[str]) -> None:
        """Remove names; unknown names are ignored."""
        places = self._row_numbers_by_name()
        gone = {*self._meta.removed, *(places[name] for name in names if name in places)}
        self._save_metadata_and_reopen(self._meta.model_copy(update={"removed": tuple(sorted(gone))}))

    @property
    def needs_compaction(self) -> bool:
        """Whether enough vectors are beside the inverted file, or removed, that `compact` speeds up searches."""
        extra = self._meta.beside + len(self._meta.removed)
        return extra > max(_FEW, _SORTED_AGAIN * self._meta.base)

    def compact(self) -> None:
        """Build a new inverted file without the removed vectors."""
        self._rebuild_inverted_file((), np.zeros((0, DIMENSIONS), np.float32), self._meta.removed)

    def search(self, query: Vectors, count: int = 20) -> list[tuple[str, float]]:
        """The names whose vectors have the largest product with ``query`` (DIMENSIONS,), the largest first."""
        gone = set(self._meta.removed)
        query = np.ascontiguousarray(query, dtype=np.float32).reshape(1, -1)
        found: list[tuple[float, int]] = []
        if self._base is not None:
            values, numbers = self._base.search(query, count + min(len(gone), 4 * count))
            found += [(float(v), int(n)) for v, n in zip(values[0], numbers[0], strict=True) if n >= 0]
        if len(self._beside):
            near = self._beside @ query[0]
            first = np.argsort(-near, kind="stable")[: count + len(gone)]
            found += [(float(near[n]), self._meta.base + int(n)) for n in first]
        found = sorted((item for item in found if item[1] not in gone), key=lambda item: (-item[0], item[1]))[:count]
        return [(self._names[number], value) for value, number in found]

    def _row_numbers_by_name(self) -> dict[str, int]:
        if self._numbers is None:
            gone = set(self._meta.removed)
            self._numbers = {name: number for number, name in enumerate(self._names) if number not in gone}
        return self._numbers

    def _rebuild_inverted_file(self, names: Sequence[str], vectors: Vectors, gone: Sequence[int]) -> None:
        """Build a new inverted file of all vectors; the old file stays until the new file is complete."""
        kept = np.setdiff1d(np.arange(len(self._names)), gone)
        earlier = self._beside
        if self._base is not None:
            self._base.make_direct_map()
            base = np.asarray(self._base.reconstruct_n(0, self._meta.base), np.float32)
            earlier = np.concatenate([base, self._beside])
        everything = np.concatenate([earlier[kept], np.asarray(vectors, np.float32)])
        all_names = [*(self._names[int(number)] for number in kept), *names]
        old, meta = self._meta, _Meta(generation=self._meta.generation + 1, base=len(all_names))
        self.folder.mkdir(parents=True, exist_ok=True)
        write_bytes(self._index_file_path("faiss", meta), _build_inverted_file(everything))
        write_text(
            self._index_file_path("names", meta), "\n".join(json.dumps(name, ensure_ascii=False) for name in all_names)
        )
        self._save_metadata_and_reopen(meta)
        for kind in ("faiss", "names", "f32", "beside"):
            self._index_file_path(kind, old).unlink(missing_ok=True)

    def _save_metadata_and_reopen(self, meta: _Meta) -> None:
        write_json(self.folder / _META, meta.model_dump(mode="json"))
        self._meta = meta
        self._open_index_files()

    def _index_file_path(self, kind: str, meta: _Meta | None = None) -> Path:
        return self.folder / f"{(meta or self._meta).generation}.{kind}"

    def _open_index_files(self) -> None:
        meta = self._meta
        self._numbers: dict[str, int] | None = None
        self._base: Any = None
        if meta.base:
            faiss = _import_faiss()
            try:
                self._base = faiss.read_index(str(self._index_file_path("faiss")), faiss.IO_FLAG_MMAP)
            except RuntimeError as error:
                raise _broken_index_error(self.folder, error) from error
            self._base.nprobe = max(1, round(_PROBED * self._base.nlist))
        self._names = _read_names(self._index_file_path("names"), meta.base) + _read_names(
            self._index_file_path("beside"), meta.beside
        )
        size = (meta.beside, DIMENSIONS)
        self._beside: Vectors = np.zeros(size, np.float32)
        if meta.beside:
            try:
                self._beside = np.memmap(self._index_file_path("f32"), dtype="<f4", mode="r", shape=size)
            except (OSError, ValueError) as error:
                raise _broken_index_error(self.folder, error) from error


def _import_faiss() -> Any:
    """The bindings, which are untyped."""
    try:
        return import_module("faiss")
    except ImportError as error:
        raise InputError("an index of many assets needs faiss", "pip install 'grs-agents[index]'") from error


def _build_inverted_file(vectors: Vectors) -> bytes:
    """The serialised inverted file of vectors (N, DIMENSIONS)."""
    faiss = _import_faiss()
    lists = max(1, round(float(np.sqrt(len(vectors)))))
    coarse = faiss.IndexFlatIP(DIMENSIONS)
    index = faiss.IndexIVFFlat(coarse, DIMENSIONS, lists, faiss.METRIC_INNER_PRODUCT)
    chosen = np.random.default_rng(0).permutation(len(vectors))[: _TRAINED * lists]
    index.cp.niter, index.cp.seed = 8, 0
    index.train(np.ascontiguousarray(vectors[chosen]))
    index.add(np.ascontiguousarray(vectors))
    return bytes(faiss.serialize_index(index))


def _broken_index_error(folder: Path, error: Exception) -> InputError:
    return InputError(f"the index in {folder} is broken: {str(error).splitlines()[0]}", "delete it and index again")


def _read_names(file: Path, count: int) -> list[str]:
    if not count:
        return []
    try:
        names = json.loads("[" + ",".join(file.read_text(encoding="utf-8").splitlines()[:count]) + "]")
    except (OSError, ValueError) as error:
        raise _broken_index_error(file.parent, error) from error
    if len(names) != count:
        raise _broken_index_error(file.parent, ValueError(f"{len(names)} names of {count}"))
    return [str(name) for name in names]


def _overwrite_file_tail(file: Path, data: bytes, begin: int) -> None:
    """Truncate a file at ``begin``, where an interrupted writer may have left data, and append."""
    file.touch()
    with file.open("r+b") as stream:
        stream.truncate(begin)
        stream.seek(begin)
        stream.write(data)
