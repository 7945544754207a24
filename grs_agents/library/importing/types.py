"""What the importer is told, what it finds and what it says."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from grs_agents.base import Frozen
from grs_agents.errors import InputError
from grs_agents.library.asset import Asset, Quantity
from grs_agents.library.shapes import Shape

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Image = npt.NDArray[np.uint8]
Unit = Literal["auto", "m", "cm", "mm", "in"]
Up = Literal["auto", "x", "y", "z"]
Kind = Literal["mesh", "urdf", "mjcf", "ycb", "gso", "hope"]
METRES: dict[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}


class RefusedError(InputError):
    """An asset that is not imported; the message names the file and the reason."""


class ImportLimits(Frozen):
    """What a single asset may cost.

    Attributes:
        bytes: of one mesh file.
        faces: of one asset.
        pixels: of one texture.
        seconds: of processor time for one asset.
        memory: bytes of address space for one asset.
        unpacked: bytes that an archive may unpack to.
        ratio: how many times its own size an archive may unpack to.
    """

    bytes: int = Field(default=256_000_000, gt=0)
    faces: int = Field(default=2_000_000, gt=0)
    pixels: int = Field(default=64_000_000, gt=0)
    seconds: int = Field(default=300, gt=0)
    memory: int = Field(default=8_000_000_000, gt=0)
    unpacked: int = Field(default=2_000_000_000, gt=0)
    ratio: float = Field(default=100.0, gt=0)


class ImportOptions(Frozen):
    """How to read a source.

    Attributes:
        unit: of mesh files that do not say theirs; ``auto`` guesses from the size.
        up: axis that points up in mesh files that do not say; ``auto`` takes what the format usually has.
        license: of the source, where it says nothing itself.
        faces: most triangles of what is seen.
        texture: longest side of a texture, px.
        parts: most convex parts of what collides.
        limits: what one asset may cost.
    """

    unit: Unit = "auto"
    up: Up = "auto"
    license: str = Field(default="unknown", max_length=500)
    faces: int = Field(default=12_000, ge=100)
    texture: int = Field(default=1024, ge=16, le=8192)
    parts: int = Field(default=16, ge=1, le=64)
    limits: ImportLimits = ImportLimits()


class SourceItem(Frozen):
    """One asset of a source.

    Attributes:
        kind: how it is read.
        name: slug that it gets in its collection.
        file: what is read, relative to the source folder.
        files: all that it is made of, relative to the source folder, ``file`` first.
        texture: picture that the file itself does not name.
        license: what the source says of it.
    """

    kind: Kind
    name: str
    file: str
    files: tuple[str, ...] = ()
    texture: str | None = None
    license: str | None = None


class ImportJob(Frozen):
    """One item to import.

    Attributes:
        source: folder of the source.
        item: one of its assets.
        options: how to read it.
        root: of the library.
        collection: folder of the library.
        content: SHA-256 of the item's files.
        license: of the item.
        known: assets whose size and mass are known; HOPE's kinds are looked up among them.
    """

    source: Path
    item: SourceItem
    options: ImportOptions
    root: Path
    collection: str
    content: str
    license: str
    known: tuple[Asset, ...] = ()


class ImportOutcome(Frozen):
    """What became of one item; a line of the journal.

    Attributes:
        item: its name.
        source: its file in the source.
        status: ``imported``, ``duplicate`` of another asset, or ``refused``.
        reason: why it was refused, or what it is a copy of.
        notes: what was guessed, found and mended.
        key: what it was made from: content of the files and options.
        asset: its entry in the manifest.
        seconds: that it took.
    """

    item: str
    source: str
    status: Literal["imported", "duplicate", "refused"]
    reason: str = ""
    notes: tuple[str, ...] = ()
    key: str = ""
    asset: Asset | None = None
    seconds: float = 0.0


@dataclass(frozen=True)
class MeshPart:
    """Triangles of one look, as a file gives them.

    Attributes:
        vertices: (N, 3).
        faces: (F, 3).
        uvs: (F, 3, 2) texture coordinates of the corners, or None.
        image: (H, W, 3) RGB, or None.
        colors: (F, 3) uint8 RGB of the faces, used without an image.
    """

    vertices: Floats
    faces: Ints
    uvs: Floats | None = None
    image: Image | None = None
    colors: Image | None = None


@dataclass(frozen=True)
class ConvexHull:
    """A convex solid.

    Attributes:
        vertices: (N, 3) m.
        faces: (F, 3), counter-clockwise from outside.
    """

    vertices: Floats
    faces: Ints


Collider = Shape | ConvexHull


@dataclass
class SourceModel:
    """One asset as its source describes it.

    Attributes:
        parts: what is seen.
        colliders: what touches, in the frame of the parts, where the source says so; else None.
        unit, up: as far as the format says; ``auto`` where it does not.
        mass, friction: where the source says.
        height: what it should be high, m, where that is known.
        category: where the source says.
        notes: what was found.
    """

    parts: list[MeshPart]
    colliders: list[Collider] | None = None
    unit: Unit = "auto"
    up: Up = "auto"
    mass: Quantity | None = None
    friction: Quantity | None = None
    height: float | None = None
    category: str = ""
    notes: list[str] = field(default_factory=list[str])


@dataclass(frozen=True)
class TexturedMesh:
    """One closed or open mesh with one picture.

    Attributes:
        vertices: (N, 3) m, welded: corners at one place are one vertex.
        faces: (F, 3), counter-clockwise from outside.
        uvs: (F, 3, 2) in 0..1.
        image: (H, W, 3) uint8 RGB.
    """

    vertices: Floats
    faces: Ints
    uvs: Floats
    image: Image


def texture_colors(image: Image, uvs: Floats) -> Image:
    """(N, 3) colours of a picture (H, W, 3) at texture coordinates (N, 2) in 0..1, origin at the lower left."""
    height, width = image.shape[:2]
    columns = np.clip((uvs[:, 0] * width).astype(np.int64), 0, width - 1)
    rows = np.clip(((1 - uvs[:, 1]) * height).astype(np.int64), 0, height - 1)
    return image[rows, columns]
