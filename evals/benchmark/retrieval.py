"""Cost of the asset index, measured in separate processes on synthetic assets.

Their descriptions have nine words by Zipf's law, four of them common to a kind; their appearances six of 400
colours; their sizes scatter around those of the kind. Queries are assets of the index with disturbed vectors.
"""

import json
import resource
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evals.benchmark.worker_processes import error_of, run_worker
from grs_agents.base.errors import GrsError, InputError
from grs_agents.perception.matching.asset_index import (
    DIMENSIONS,
    WEIGHTS,
    AssetIndex,
    Vectors,
    embed_color_histogram,
    embed_sizes,
    embed_words,
)
from grs_agents.perception.matching.color_histogram import histograms_from_rgb
from grs_agents.runs.metrics import Figure

_KINDS, _WORDS, _TOLD, _COLORS = 300, 8000, 9, 400
_MIXED = 6
_NOISE = 0.03
_NEAREST = 20
_MEBIBYTE = 1024 * 1024 if sys.platform == "darwin" else 1024


def synthetic_vectors(count: int, rng: np.random.Generator) -> Vectors:
    """(count, DIMENSIONS) vectors of assets that nobody made."""
    shares = 1 / np.arange(1, _WORDS + 1)
    shares /= shares.sum()
    spelt = np.array([embed_words(f"word{number}") for number in range(_WORDS)])
    kinds = rng.integers(0, _KINDS, count)
    shared = rng.choice(_WORDS, (_KINDS, 4), p=shares)
    numbers = np.concatenate([shared[kinds], rng.choice(_WORDS, (count, _TOLD - 4), p=shares)], axis=1)
    usual = np.exp(rng.normal(-2.5, 0.6, (_KINDS, 3)))
    pure = histograms_from_rgb(rng.random((_COLORS, 3)), np.eye(_COLORS)).astype(np.float64) ** 2
    vectors = np.empty((count, DIMENSIONS), np.float32)
    for first in range(0, count, 1000):
        some = slice(first, min(first + 1000, count))
        words = spelt[numbers[some]].sum(axis=1)
        words /= np.maximum(np.linalg.norm(words, axis=1, keepdims=True), 1e-9)
        number = len(words)
        mixed, amounts = rng.integers(0, _COLORS, (number, _MIXED)), rng.dirichlet(np.full(_MIXED, 0.7), number)
        looks = np.sqrt(np.einsum("nm,nmb->nb", amounts, pure[mixed]))
        sizes = usual[kinds[some]] * np.exp(rng.normal(0, 0.25, (number, 3)))
        parts = (words, embed_color_histogram(looks), embed_sizes(sizes))
        vectors[some] = np.concatenate([np.sqrt(w) * part for w, part in zip(WEIGHTS, parts, strict=True)], axis=1)
    return vectors


def build(folder: Path, count: int, queries: int, seed: int) -> dict[str, float]:
    """Make an index of ``count`` synthetic assets, and beside it the vectors of some of them that will be asked for."""
    vectors = synthetic_vectors(count, np.random.default_rng(seed))
    np.save(_asked(folder), vectors[np.linspace(0, count - 1, queries).astype(np.int64)])
    begin = time.process_time()
    AssetIndex(folder).add([f"synthetic/{number}.urdf" for number in range(count)], vectors)
    return {"build s": time.process_time() - begin}


def probe(folder: Path, count: int, queries: int, seed: int) -> dict[str, float]:
    """Open the index, search it, and add to it."""
    begin = time.process_time()
    index = AssetIndex(folder)
    opened = time.process_time() - begin
    rng = np.random.default_rng(seed + 1)
    vectors: Vectors = np.load(_asked(folder), allow_pickle=False)
    vectors += rng.normal(0, _NOISE, vectors.shape).astype(np.float32)
    index.search(vectors[0])
    seconds: list[float] = []
    answers: list[set[str]] = []
    for query in vectors:
        begin = time.process_time()
        nearest = index.search(query, _NEAREST)
        seconds.append(time.process_time() - begin)
        answers.append({name for name, _ in nearest})
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _MEBIBYTE
    if len(index) != count:
        raise InputError(f"the index holds {len(index)} assets of {count}", "measure again")
    fresh = synthetic_vectors(1000, rng)
    begin = time.process_time()
    index.add([f"added/{number}.urdf" for number in range(1000)], fresh)
    added = time.process_time() - begin
    index.remove([f"added/{number}.urdf" for number in range(1000)])
    near = vectors @ synthetic_vectors(count, np.random.default_rng(seed)).T
    exact = [[f"synthetic/{number}.urdf" for number in np.argsort(-row, kind="stable")[:_NEAREST]] for row in near]
    shares = [len(some & set(names)) / _NEAREST for some, names in zip(answers, exact, strict=True)]
    return {
        "open s": opened,
        "search ms, median": 1000 * float(np.median(seconds)),
        "search ms, 95th percentile": 1000 * float(np.percentile(seconds, 95)),
        "recall": float(np.mean(shares)),
        "memory MiB": peak,
        "add 1000 s": added,
        "size on disk MiB": sum(file.stat().st_size for file in folder.iterdir()) / 2**20,
    }


def measure_retrieval(folder: Path, count: int, queries: int, seed: int) -> dict[str, float]:
    """Build and probe, each in a separate process on a single core.

    Raises:
        GrsError: a process failed.
    """
    figures: dict[str, float] = {}
    for verb in ("build", "probe"):
        numbers = [str(number) for number in (count, queries, seed)]
        done = run_worker("retrieval", (verb, str(folder), *numbers))
        if error := error_of(done):
            raise GrsError(f"{verb} of the index failed: {error}", "pip install 'grs-agents[index]'")
        figures.update(json.loads(done.stdout))
    return figures


def retrieval_targets(figures: dict[str, float]) -> list[Figure]:
    """The figures that have a bound."""
    bounds = (("memory MiB", 1024.0), ("search ms, median", 10.0), ("open s", 1.0), ("add 1000 s", 1.0))
    targets = [Figure(name=name, value=figures[name], target=bound) for name, bound in bounds]
    return [*targets, Figure(name="recall", value=figures["recall"], target=0.98, smaller_is_better=False)]


def main(arguments: Sequence[str]) -> int:
    """``build`` or ``probe``, the folder, how many assets and queries, the seed; prints figures as JSON.

    Returns:
        0.
    """
    verb, folder, *numbers = arguments
    work: dict[str, Any] = {"build": build, "probe": probe}
    try:
        import_threads()
        print(json.dumps(work[verb](Path(folder), *(int(number) for number in numbers))))
    except GrsError as error:
        print(error, file=sys.stderr)
        return error.exit_status
    return 0


def _asked(folder: Path) -> Path:
    return folder.parent / f"{folder.name}-asked.npy"


def import_threads() -> None:
    """Keep FAISS on a single core."""
    from importlib import import_module

    import_module("faiss").omp_set_num_threads(1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
