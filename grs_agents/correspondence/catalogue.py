"""The assets that may be matched, with what is needed to compare them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.correspondence.appearance import Appearance, appearance_of
from grs_agents.correspondence.tone import brighter
from grs_agents.library import Asset, Library
from grs_agents.scene.frame import Array
from grs_agents.scene.points import Tree

SHIFTS = (-4, -3, -2, -1, 0, 1)
"""Light may move brightness by so many levels of a histogram."""


@dataclass(frozen=True)
class Catalogue:
    """Assets with their looks.

    Attributes:
        assets: what may be matched.
        looks: one for each.
        trees: to find the nearest point of each surface.
        views: (S, A, V, B) histograms of each view in the light of each of `SHIFTS`.
        sizes: (A, 3) extents in m, the smallest first.
    """

    assets: tuple[Asset, ...]
    looks: tuple[Appearance, ...]
    trees: tuple[Tree, ...]
    views: npt.NDArray[np.float32]
    sizes: Array


def catalogue_of(assets: Sequence[Asset], library: Library) -> Catalogue:
    """Look at assets.

    Raises:
        InputError: the files of one are faulty.
    """
    looks = tuple(appearance_of(asset.name, library) for asset in assets)
    views = np.stack([look.views for look in looks])
    flat = views.reshape(-1, views.shape[-1])
    return Catalogue(
        assets=tuple(assets),
        looks=looks,
        trees=tuple(Tree(look.points) for look in looks),
        views=np.stack([brighter(flat, shift).reshape(views.shape) for shift in SHIFTS]),
        sizes=np.array([np.sort(2 * look.half) for look in looks]),
    )
