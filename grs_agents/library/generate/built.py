"""One generated asset: its manifest entry and the files it consists of."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.files import write_bytes, write_text
from grs_agents.library.asset import Asset


@dataclass(frozen=True)
class Built:
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


def png(image: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> bytes:
    """The image as PNG, at the highest compression."""
    encoded, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    if not encoded:
        raise ValueError(f"OpenCV cannot encode an image of shape {image.shape}")
    return data.tobytes()
