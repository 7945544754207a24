"""Copies: assets of the same files, or of the same shape and the same look."""

from collections.abc import Iterable

import numpy as np

from grs_agents.library.asset import Asset
from grs_agents.library.physical_properties import Origin

_SHAPE, _LOOK = 0.01, 0.15
"""Most that numbers of the shape differ, as a share; most that shares of colours differ in all."""


class Known:
    """The assets that there are.

    Args:
        assets: those without an origin are left out.
    """

    def __init__(self, assets: Iterable[Asset]) -> None:
        self._by_content: dict[str, str] = {}
        self._names: list[str] = []
        self._origins: list[Origin] = []
        for asset in assets:
            self.add(asset)

    def add(self, asset: Asset) -> None:
        """One more."""
        if asset.origin is not None:
            self._by_content.setdefault(asset.origin.content, asset.name)
            self._names.append(asset.name)
            self._origins.append(asset.origin)

    def of_content(self, content: str, name: str) -> str | None:
        """The name of another asset than ``name`` that was made from the same files."""
        found = self._by_content.get(content)
        return found if found != name else None

    def like(self, asset: Asset) -> tuple[str | None, str | None]:
        """The names of another asset of the same shape and look, and of one of the same shape alone."""
        origin, variant = asset.origin, None
        if origin is None or not self._origins:
            return None, None
        shapes = np.array([one.shape for one in self._origins])
        off = np.abs(shapes - origin.shape) / np.maximum(np.abs(shapes), 1e-12)
        for index in np.flatnonzero(off.max(axis=1) < _SHAPE):
            if self._names[index] == asset.name:
                continue
            look = np.abs(np.subtract(self._origins[index].look, origin.look)).sum()
            if look < _LOOK:
                return self._names[index], None
            variant = variant or self._names[index]
        return None, variant
