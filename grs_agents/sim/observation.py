"""What the cameras see, rendered only when somebody looks."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.library import Library
from grs_agents.sim import rendering
from grs_agents.sim.arm import Arm
from grs_agents.sim.instance import InstanceObject


class Observation(Mapping[str, Any]):
    """``color``: three (480, 640, 3) uint8 images; ``depth``: three (480, 640) float32 images, metres."""

    def __init__(
        self, objects: tuple[InstanceObject, ...], library: Library, joints: npt.NDArray[np.float64], arm: Arm
    ) -> None:
        self._objects, self._library, self._joints, self._arm = objects, library, joints, arm
        self._images: dict[str, tuple[npt.NDArray[Any], ...]] | None = None

    def __getitem__(self, key: str) -> tuple[npt.NDArray[Any], ...]:
        if key not in ("color", "depth"):
            raise KeyError(key)
        images = self._images or rendering.observe(self._objects, self._library, self._joints, self._arm)
        self._images = images
        return images[key]

    def __iter__(self) -> Iterator[str]:
        return iter(("color", "depth"))

    def __len__(self) -> int:
        return 2
