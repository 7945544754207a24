"""Options, intermediate models and outcomes of the importer."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.library.asset import Asset, Quantity
from grs_agents.library.shapes import Shape

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Image = npt.NDArray[np.uint8]
Unit = Literal["auto", "m", "cm", "mm", "in"]
Up = Literal["auto", "x", "y", "z"]
Kind = Literal["mesh", "urdf", "mjcf", "ycb", "gso", "hope"]
METRES: dict[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
UP_TO_Z: dict[Up, Floats] = {
    "auto": np.eye(3),
    "x": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "z": np.eye(3),
}
"""The rotation that takes an axis to z."""
MIN_UNPACKED_BYTES = 50_000_000
"""Bytes that any archive may unpack to, even a small archive."""
ZIP_ENTRY_BYTES = 250
"""Bytes allowed for a member in a zip file's directory: 46 and its name."""


class RefusedError(InputError):
    """An asset is not imported, since reading or repairing it failed; names the file and the reason."""


class ImportLimits(Frozen):
    """Limits on the cost of a single asset."""

    bytes: int = Field(default=256_000_000, gt=0)  # of a mesh file
    faces: int = Field(default=2_000_000, gt=0)  # of an asset
    pixels: int = Field(default=64_000_000, gt=0)  # of a texture
    seconds: int = Field(default=300, gt=0)  # of processor time for an asset
    memory: int = Field(default=8_000_000_000, gt=0)  # bytes of address space for an asset
    unpacked: int = Field(default=2_000_000_000, gt=0)  # bytes that an archive may unpack to
    ratio: float = Field(default=100.0, gt=0)  # largest ratio of an archive's unpacked size to its size


class ImportOptions(Frozen):
    """Options for reading a source."""

    unit: Unit = "auto"  # of mesh files without a unit; ``auto`` guesses from the size
    up: Up = "auto"  # up axis of mesh files that do not say; ``auto`` takes the format's usual axis
    license: str = Field(default="unknown", max_length=500)  # of the source, unless it states its own
    faces: int = Field(default=12_000, ge=100)  # most triangles of the visual mesh
    texture: int = Field(default=1024, ge=16, le=8192)  # longest side of a texture, px
    parts: int = Field(default=16, ge=1, le=64)  # most convex parts of the colliders
    limits: ImportLimits = ImportLimits()  # on the cost of each asset


class SourceItem(Frozen):
    """An asset of a source."""

    kind: Kind  # kind of reader
    name: str  # slug that it gets in its collection
    title: str = ""  # the source's name, in any script; ``name`` if empty
    file: str  # the file to read, relative to the source folder
    files: tuple[str, ...] = ()  # all that it is made of, relative to the source folder, ``file`` first
    texture: str | None = None  # picture that the file itself does not name
    license: str | None = None  # as the source states it


class ImportJob(Frozen):
    """An item to import."""

    source: Path  # folder of the source
    item: SourceItem
    options: ImportOptions
    root: Path  # of the library
    collection: str  # folder of the library
    content: str  # SHA-256 of the item's files
    license: str
    known: tuple[Asset, ...] = ()  # assets whose size and mass are known; HOPE's kinds are looked up among them


class ImportOutcome(Frozen):
    """Outcome of an item; a line of the journal."""

    item: str  # its name
    source: str  # its file in the source
    status: Literal["imported", "duplicate", "refused", "unread"]  # ``unread``: without a reader
    reason: str = ""  # of a refusal, or the name of the original of a duplicate
    notes: tuple[str, ...] = ()  # guesses, findings and repairs
    key: str = ""  # hash of the inputs: content of the files and options
    asset: Asset | None = None  # its entry in the manifest
    seconds: float = 0.0  # wall time of the import


@dataclass(frozen=True)
class MeshPart:
    """Triangles of a single material, as a file gives them."""

    vertices: Floats  # (N, 3)
    faces: Ints  # (F, 3)
    uvs: Floats | None = None  # (F, 3, 2) texture coordinates of the corners, or None
    image: Image | None = None  # (H, W, 3) RGB, or None
    colors: Image | None = None  # (F, 3) uint8 RGB of the faces, used without an image


@dataclass(frozen=True)
class ConvexHull:
    """A convex solid."""

    vertices: Floats  # (N, 3) m
    faces: Ints  # (F, 3), counter-clockwise from outside


Collider = Shape | ConvexHull


@dataclass
class SourceModel:
    """An asset as its source describes it."""

    parts: list[MeshPart]  # visual geometry
    colliders: list[Collider] | None = None  # in the frame of the parts; None if the source has none
    unit: Unit = "auto"  # ``unit`` and ``up`` if the format states them
    up: Up = "auto"
    mass: Quantity | None = None  # if the source states it
    friction: Quantity | None = None  # if the source states it
    height: float | None = None  # expected height, m, if known
    category: str = ""  # if the source states it
    notes: list[str] = field(default_factory=list[str])  # findings


@dataclass(frozen=True)
class AtlasMesh:
    """A closed or open mesh with a single texture."""

    vertices: Floats  # (N, 3) m, welded: coincident corners share a vertex
    faces: Ints  # (F, 3), counter-clockwise from outside
    uvs: Floats  # (F, 3, 2) in 0..1
    image: Image  # (H, W, 3) uint8 RGB


def sample_texture_colors(image: Image, uvs: Floats) -> Image:
    """(N, 3) colours of a picture (H, W, 3) at texture coordinates (N, 2) in 0..1, origin at the lower left."""
    height, width = image.shape[:2]
    columns = np.clip((uvs[:, 0] * width).astype(np.int64), 0, width - 1)
    return image[np.clip(((1 - uvs[:, 1]) * height).astype(np.int64), 0, height - 1), columns]
