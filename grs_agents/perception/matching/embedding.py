"""One vector for what is known of an asset, and one for what is asked: words, look and size, compared by one product.

Nothing is learnt and nothing is downloaded: words are hashed, looks projected, sizes told by random Fourier features
(Rahimi and Recht 2007), so that a product of two vectors is the weighted sum of three similarities in 0..1.
"""

import hashlib
import re
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.perception.frame import Array
from grs_agents.perception.matching.color_histogram import BINS

WORDS, LOOK, SIZE = 192, 96, 96
DIMENSIONS = WORDS + LOOK + SIZE
WEIGHTS = (0.45, 0.3, 0.25)
"""Of words, look and size; they add up to 1."""
_WIDTH = 0.25
"""Sizes whose logarithms differ by so much are about as alike as not."""
Vectors = npt.NDArray[np.float32]


def embed(description: str = "", look: npt.NDArray[np.float32] | None = None, size: Vec3 | None = None) -> Vectors:
    """The vector (DIMENSIONS,) of a thing; what is not known of it counts as unlike everything.

    Args:
        description: in words.
        look: (BINS,) square roots of shares of tones (`color_histogram`); of several views their mean.
        size: extents in m, in any order.
    """
    parts = [
        words_vector(description),
        np.zeros(LOOK) if look is None else look_vector(look),
        size_vectors(np.array(size)) if size else np.zeros(SIZE),
    ]
    scaled = [np.sqrt(weight) * part for weight, part in zip(WEIGHTS, parts, strict=True)]
    return np.concatenate(scaled).astype(np.float32)


def words_vector(text: str) -> Array:
    """(WORDS,) of length 1: each word, and each of its runs of four letters, adds to one place by its hash."""
    found = np.zeros(WORDS)
    for word in re.findall(r"[a-z0-9]+", text.lower()):
        for token, weight in ((word, 1.0), *((word[i : i + 4], 0.25) for i in range(len(word) - 3))):
            place, sign = _hashed(token)
            found[place] += sign * weight
    length = float(np.linalg.norm(found))
    return found / length if length else found


@lru_cache(maxsize=65536)
def _hashed(token: str) -> tuple[int, float]:
    digest = hashlib.blake2b(token.encode(), digest_size=8).digest()
    return int.from_bytes(digest[:4], "little") % WORDS, 1.0 if digest[4] & 1 else -1.0


def look_vector(look: npt.NDArray[np.floating[Any]]) -> Array:
    """(..., LOOK) of length 1, of square roots of shares of tones (..., BINS)."""
    found = look.astype(np.float64) @ _projection()
    return found / np.maximum(np.linalg.norm(found, axis=-1, keepdims=True), 1e-12)


@lru_cache(maxsize=1)
def _projection() -> Array:
    return np.random.default_rng(1).normal(size=(BINS, LOOK)) / np.sqrt(LOOK)


def size_vectors(sizes: Array) -> Array:
    """(..., SIZE) of length 1; a product of two is near a Gaussian of how much the logarithms of the sizes differ.

    Args:
        sizes: (..., 3) extents in m, in any order.
    """
    phases = np.log(np.sort(np.maximum(sizes, 1e-4), axis=-1)) @ _waves()
    return np.concatenate([np.cos(phases), np.sin(phases)], axis=-1) / np.sqrt(SIZE / 2)


@lru_cache(maxsize=1)
def _waves() -> Array:
    return np.random.default_rng(2).normal(size=(3, SIZE // 2)) / _WIDTH
