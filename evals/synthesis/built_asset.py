"""A generated asset: its manifest entry and its files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base.files import write_bytes, write_json, write_text
from grs_agents.library.asset import MANIFEST, Asset, AssetManifest
from grs_agents.library.colors import COLORS
from grs_agents.library.formats.urdf import format_urdf_text
from grs_agents.library.shapes import Rgba, Shape


@dataclass(frozen=True)
class BuiltAsset:
    """An asset, the text of its URDF, and its meshes (OBJ text) and textures (BGR images) by file name."""

    asset: Asset
    urdf: str
    meshes: Mapping[str, str] = field(default_factory=dict[str, str])
    textures: Mapping[str, npt.NDArray[np.uint8]] = field(default_factory=dict[str, npt.NDArray[np.uint8]])

    def files(self) -> tuple[str, ...]:
        """The library-relative names of everything `write` writes."""
        return (self.asset.name, *self.meshes, *self.textures)

    def write(self, root: Path) -> None:
        """Write the asset's files below ``root``."""
        write_text(root / self.asset.name, self.urdf)
        for name, text in self.meshes.items():
            write_text(root / name, text)
        for name, image in self.textures.items():
            write_bytes(root / name, png(image))


def write_assets(root: Path, built: Sequence[BuiltAsset]) -> tuple[str, ...]:
    """Write assets with a manifest into the library folder ``root``; gives their names."""
    for asset in built:
        asset.write(root)
    write_json(root / MANIFEST, AssetManifest(assets=tuple(asset.asset for asset in built)).model_dump(mode="json"))
    return tuple(asset.asset.name for asset in built)


def build_asset(
    asset: Asset, visuals: Sequence[Shape], colliders: Sequence[Shape], meshes: Mapping[str, str] | None = None
) -> BuiltAsset:
    """An asset of these shapes, with the inertia of a solid box of its size and mass."""
    x, y, z = asset.size
    inertia = tuple(asset.mass * (a * a + b * b) / 12 for a, b in ((y, z), (x, z), (x, y)))
    text = format_urdf_text(
        asset.kind,
        visuals,
        colliders,
        mass=asset.mass,
        friction=asset.friction,
        inertia=(inertia[0], inertia[1], inertia[2]),
        folder=asset.name.rsplit("/", 1)[0],
    )
    return BuiltAsset(asset, text, meshes or {})


def opaque(color: str) -> Rgba:
    """The colour of that name, not transparent."""
    red, green, blue = COLORS[color]
    return (red, green, blue, 1.0)


def png(image: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> bytes:
    """The image as PNG, at the highest compression."""
    encoded, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    if not encoded:
        raise ValueError(f"OpenCV cannot encode an image of shape {image.shape}")
    return data.tobytes()
