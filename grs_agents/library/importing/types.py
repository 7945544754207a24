"""What the importer is told, what it finds and what it says."""

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


class RefusedError(InputError):
    """An asset that is not imported, raised by all that reads or mends one; names the file and the reason."""


class ImportLimits(Frozen):
    """What a single asset may cost."""

    bytes: int = Field(default=256_000_000, gt=0)  # of one mesh file
    faces: int = Field(default=2_000_000, gt=0)  # of one asset
    pixels: int = Field(default=64_000_000, gt=0)  # of one texture
    seconds: int = Field(default=300, gt=0)  # of processor time for one asset
    memory: int = Field(default=8_000_000_000, gt=0)  # bytes of address space for one asset
    unpacked: int = Field(default=2_000_000_000, gt=0)  # bytes that an archive may unpack to
    ratio: float = Field(default=100.0, gt=0)  # how many times its own size an archive may unpack to


class ImportOptions(Frozen):
    """How to read a source."""

    unit: Unit = "auto"  # of mesh files that do not say theirs; ``auto`` guesses from the size
    up: Up = "auto"  # axis that points up in mesh files that do not say; ``auto`` takes what the format usually has
    license: str = Field(default="unknown", max_length=500)  # of the source, where it says nothing itself
    faces: int = Field(default=12_000, ge=100)  # most triangles of what is seen
    texture: int = Field(default=1024, ge=16, le=8192)  # longest side of a texture, px
    parts: int = Field(default=16, ge=1, le=64)  # most convex parts of what collides
    limits: ImportLimits = ImportLimits()  # what one asset may cost


class SourceItem(Frozen):
    """One asset of a source."""

    kind: Kind  # how it is read
    name: str  # slug that it gets in its collection
    title: str = ""  # what its source calls it, in any script; ``name`` where it is empty
    file: str  # what is read, relative to the source folder
    files: tuple[str, ...] = ()  # all that it is made of, relative to the source folder, ``file`` first
    texture: str | None = None  # picture that the file itself does not name
    license: str | None = None  # what the source says of it


class ImportJob(Frozen):
    """One item to import."""

    source: Path  # folder of the source
    item: SourceItem
    options: ImportOptions
    root: Path  # of the library
    collection: str  # folder of the library
    content: str  # SHA-256 of the item's files
    license: str
    known: tuple[Asset, ...] = ()  # assets whose size and mass are known; HOPE's kinds are looked up among them


class ImportOutcome(Frozen):
    """What became of one item; a line of the journal."""

    item: str  # its name
    source: str  # its file in the source
    status: Literal["imported", "duplicate", "refused", "unread"]  # ``unread`` is what no reader is for
    reason: str = ""  # why it was refused or is not read, or what it is a copy of
    notes: tuple[str, ...] = ()  # what was guessed, found and mended
    key: str = ""  # what it was made from: content of the files and options
    asset: Asset | None = None  # its entry in the manifest
    seconds: float = 0.0  # that it took


@dataclass(frozen=True)
class MeshPart:
    """Triangles of one look, as a file gives them."""

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
    """One asset as its source describes it."""

    parts: list[MeshPart]  # what is seen
    colliders: list[Collider] | None = None  # in the frame of the parts; None where the source says nothing
    unit: Unit = "auto"  # ``unit`` and ``up`` as far as the format says
    up: Up = "auto"
    mass: Quantity | None = None  # where the source says
    friction: Quantity | None = None  # where the source says
    height: float | None = None  # what it should be high, m, where that is known
    category: str = ""  # where the source says
    notes: list[str] = field(default_factory=list[str])  # what was found


@dataclass(frozen=True)
class TexturedMesh:
    """One closed or open mesh with one picture."""

    vertices: Floats  # (N, 3) m, welded: corners at one place are one vertex
    faces: Ints  # (F, 3), counter-clockwise from outside
    uvs: Floats  # (F, 3, 2) in 0..1
    image: Image  # (H, W, 3) uint8 RGB


def sample_texture_colors(image: Image, uvs: Floats) -> Image:
    """(N, 3) colours of a picture (H, W, 3) at texture coordinates (N, 2) in 0..1, origin at the lower left."""
    height, width = image.shape[:2]
    columns = np.clip((uvs[:, 0] * width).astype(np.int64), 0, width - 1)
    return image[np.clip(((1 - uvs[:, 1]) * height).astype(np.int64), 0, height - 1), columns]
