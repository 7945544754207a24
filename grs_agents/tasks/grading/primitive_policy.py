"""Imitation learning at the level of primitives, with numpy alone.

The expert may choose the next object, one of several slots, and a rotation; a regression would aim between the choices.
The policy therefore first classifies (object, slot), a slot being a cluster of places of that object in the frame of
its goal; then it regresses the place within the slot.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray

IntArray = npt.NDArray[np.int_]
_SPREAD: Final = 0.2
"""Diameter of a slot; metres count tenfold, sine and cosine of the yaw as they are."""
_SLOTS: Final = 16
_FEW: Final = 20
"""Most decisions in a slot for which its mean place is used without a regression."""
_SHRINK: Final = 0.03
"""Ridge penalty for each sample, on features of unit deviation."""
_BATCH, _HIDDEN = 32, 64
"""Batch and layer size, so small that matrix products stay on a single thread."""
_RATE, _BLUR = 2e-3, 0.03


@dataclass(frozen=True)
class PrimitiveDemonstration:
    """An expert's episode of T decisions."""

    features: FloatArray  # (T, F) features before each decision
    waiting: npt.NDArray[np.bool_]  # (T, candidates) whether a goal waits for the object
    objects: IntArray  # (T,) index of the object among the candidates
    places: FloatArray  # (T, 3) place: x, y (m) and yaw (rad) in the frame of its goal


@dataclass(frozen=True)
class _Slot:
    """Cluster of an object's places: their mean and its linear dependence on the features."""

    object: int
    wanted: bool  # the object was put there only for a goal that waited for it
    mean: FloatArray  # (4,) x, y, sine and cosine of the yaw
    slopes: FloatArray  # (F, 4) on standardised features


class PrimitivePolicy:
    """Policy that learns from demonstrations which object to carry to which place."""

    def __init__(self, demonstrations: Sequence[PrimitiveDemonstration], seed: int = 0, iterations: int = 8000) -> None:
        """Learn; ``iterations`` are steps of the classifier's training. ``ValueError``: there is no demonstration."""
        features = np.concatenate([shown.features for shown in demonstrations])
        objects = np.concatenate([shown.objects for shown in demonstrations])
        waiting = np.concatenate([shown.waiting for shown in demonstrations])
        x, y, yaw = np.concatenate([shown.places for shown in demonstrations]).T
        places = np.column_stack([x, y, np.sin(yaw), np.cos(yaw)])
        self._mean, self._deviation = features.mean(axis=0), features.std(axis=0) + 1e-3
        scaled, rng = self._standardize_features(features), np.random.default_rng(seed)
        labels = np.zeros(len(features), dtype=np.int_)
        self._slots: list[_Slot] = []
        for number in np.unique(objects).tolist():
            moved = np.flatnonzero(objects == number)
            clusters = _cluster_with_k_means(places[moved] * (10, 10, 1, 1), rng)
            for cluster in np.unique(clusters).tolist():
                rows = moved[clusters == cluster]
                labels[rows] = len(self._slots)
                self._slots.append(_fit_slot(number, bool(waiting[rows, number].all()), scaled[rows], places[rows]))
        self._classifier = Classifier(scaled, labels, len(self._slots), rng, iterations)

    @property
    def slots(self) -> int:
        """Number of pairs of an object and a slot."""
        return len(self._slots)

    def _standardize_features(self, features: FloatArray) -> FloatArray:
        return (features - self._mean) / self._deviation

    def __call__(self, features: FloatArray, waiting: Sequence[bool]) -> tuple[int, tuple[float, float, float]]:
        """The next decision.

        Args:
            features: (F,) of the scene.
            waiting: for each candidate whether a goal waits for it; objects whose goals are met are moved only as in
                demonstrations after their goals were met.

        Returns:
            Index of an object among the candidates, and its place in the frame of its goal: x, y (m), yaw (rad).
        """
        scaled = self._standardize_features(features)
        open_slots = np.array([waiting[slot.object] or not slot.wanted for slot in self._slots])
        logits = self._classifier.logits(scaled[None])[0]
        slot = self._slots[int(np.argmax(np.where(open_slots | ~open_slots.any(), logits, -np.inf)))]
        x, y, sin, cos = (slot.mean + scaled @ slot.slopes).tolist()
        return slot.object, (x, y, float(np.arctan2(sin, cos)))


def _cluster_with_k_means(points: FloatArray, rng: np.random.Generator) -> IntArray:
    """Cluster (N,) of each point (N, D): k-means, begun with far points until every point is near a centre."""
    centers = points[rng.integers(len(points))][None]
    while len(centers) < _SLOTS:
        away = np.linalg.norm(points[:, None] - centers[None], axis=2).min(axis=1)
        if away.max() < _SPREAD:
            break
        centers = np.vstack([centers, points[int(away.argmax())]])
    nearest = np.zeros(len(points), dtype=np.int_)
    for _ in range(15):
        nearest = np.linalg.norm(points[:, None] - centers[None], axis=2).argmin(axis=1)
        centers = np.stack(
            [points[nearest == k].mean(axis=0) if (nearest == k).any() else centers[k] for k in range(len(centers))]
        )
    return nearest


def _fit_slot(number: int, wanted: bool, scaled: FloatArray, places: FloatArray) -> _Slot:
    count = len(places)
    mean = np.asarray(places.mean(axis=0), dtype=np.float64)
    if count <= _FEW:
        return _Slot(number, wanted, mean, np.zeros((scaled.shape[1], 4)))
    middle = scaled.mean(axis=0)
    centered = scaled - middle
    gram = centered.T @ centered + _SHRINK * count * np.eye(scaled.shape[1])
    slopes = np.asarray(np.linalg.solve(gram, centered.T @ (places - mean)), dtype=np.float64)
    return _Slot(number, wanted, mean - middle @ slopes, slopes)


class Classifier:
    """Perceptron with two hidden layers and a softmax, trained with Adam on standardised features."""

    def __init__(
        self, features: FloatArray, labels: IntArray, classes: int, rng: np.random.Generator, iterations: int
    ) -> None:
        sizes = (features.shape[1], _HIDDEN, _HIDDEN, classes)
        self._layers = [(rng.standard_normal((a, b)) * np.sqrt(2 / a), np.zeros(b)) for a, b in pairwise(sizes)]
        if classes > 1:
            wanted = np.eye(classes)[labels]
            parameters = [part for layer in self._layers for part in layer]
            means, squares = [np.zeros_like(part) for part in parameters], [np.zeros_like(part) for part in parameters]
            for step in range(1, iterations + 1):
                rows = rng.integers(0, len(features), _BATCH)
                passed = self._forward(features[rows] + _BLUR * rng.standard_normal((_BATCH, features.shape[1])))
                rate = _RATE * 0.5 * (1 + np.cos(np.pi * step / iterations))
                for index, gradient in enumerate(self._cross_entropy_gradients(passed, wanted[rows])):
                    means[index] += 0.1 * (gradient - means[index])
                    squares[index] += 0.001 * (gradient**2 - squares[index])
                    mean, square = means[index] / (1 - 0.9**step), squares[index] / (1 - 0.999**step)
                    parameters[index] -= rate * mean / (np.sqrt(square) + 1e-8)

    def logits(self, features: FloatArray) -> FloatArray:
        """Logits (N, classes) of features (N, F)."""
        return self._forward(features)[-1]

    def _forward(self, values: FloatArray) -> list[FloatArray]:
        """Inputs of all layers, and the output of the last."""
        passed = [values]
        for depth, (weights, bias) in enumerate(self._layers):
            values = values @ weights + bias
            values = values if depth == len(self._layers) - 1 else np.maximum(values, 0.0)
            passed.append(values)
        return passed

    def _cross_entropy_gradients(self, passed: list[FloatArray], wanted: FloatArray) -> list[FloatArray]:
        """Gradients of the cross-entropy for the weights and biases of all layers in turn."""
        shares = np.exp(passed[-1] - passed[-1].max(axis=1, keepdims=True))
        error = (shares / shares.sum(axis=1, keepdims=True) - wanted) / len(wanted)
        gradients: list[FloatArray] = []
        for depth in range(len(self._layers) - 1, -1, -1):
            gradients = [passed[depth].T @ error, error.sum(axis=0), *gradients]
            if depth:
                error = (error @ self._layers[depth][0].T) * (passed[depth] > 0)
        return gradients
