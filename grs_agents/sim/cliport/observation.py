"""What the cameras see, rendered only when somebody looks."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy.typing as npt

from grs_agents.sim.world import rendering


class Observation(Mapping[str, Any]):
    """``color``: three (480, 640, 3) uint8 images; ``depth``: three (480, 640) float32 images, metres."""

    def __init__(self, sight: rendering.Sight) -> None:
        self._sight = sight
        self._images: dict[str, tuple[npt.NDArray[Any], ...]] | None = None

    def __getitem__(self, key: str) -> tuple[npt.NDArray[Any], ...]:
        if key not in ("color", "depth"):
            raise KeyError(key)
        images = self._images or rendering.observe(self._sight)
        self._images = images
        return images[key]

    def __iter__(self) -> Iterator[str]:
        return iter(("color", "depth"))

    def __len__(self) -> int:
        return 2
