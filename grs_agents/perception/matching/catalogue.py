"""The assets that may be matched, with what is needed to compare them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.library import Asset, Library
from grs_agents.perception.matching.asset_appearance import Appearance, appearance_of
from grs_agents.perception.types import Array


@dataclass(frozen=True)
class Catalogue:
    """Assets with their looks.

    Attributes:
        assets: what may be matched.
        looks: one for each.
        views: (A, V, B) histograms of each view.
        sizes: (A, 3) extents in m, the smallest first.
    """

    assets: tuple[Asset, ...]
    looks: tuple[Appearance, ...]
    views: npt.NDArray[np.float32]
    sizes: Array


def catalogue_of(assets: Sequence[Asset], library: Library) -> Catalogue:
    """Look at assets.

    Raises:
        InputError: the files of one are faulty.
    """
    looks = tuple(appearance_of(asset.name, library) for asset in assets)
    return Catalogue(
        assets=tuple(assets),
        looks=looks,
        views=np.stack([look.views for look in looks]),
        sizes=np.array([np.sort(2 * look.half) for look in looks], np.float64),
    )
