"""An entry of the library's manifest, and the physical properties of an asset.
Each property (mass, friction, restitution) says where its number comes from and how far off it may be."""

from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, ValidationError, model_serializer

from grs_agents.base import Frozen, Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import read_json

Provenance = Literal["measured", "catalogue", "estimate", "default"]
"""By a scale; by the source of the asset; by a model or from volume and material; by nothing but custom."""


class Quantity(Frozen):
    """One physical number."""

    value: float = Field(ge=0, allow_inf_nan=False)  # in its SI unit
    provenance: Provenance = "default"
    deviation: float = Field(default=0.3, ge=0, le=2, allow_inf_nan=False)  # standard deviation as a share of the value


class Physics(Frozen):
    """What an asset's contact and motion depend on."""

    mass: Quantity  # kg
    friction: Quantity = Quantity(value=0.6, provenance="default", deviation=0.3)  # of sliding
    restitution: Quantity = Quantity(value=0.2, provenance="default", deviation=0.5)  # speed after over before a bounce


class Origin(Frozen):
    """Where an imported asset comes from."""

    collection: str  # the folder of the library it is in
    source: str  # path inside the source, or the identifier there
    license: str = "unknown"  # what its source says; ``unknown`` where it says nothing
    content: str = ""  # SHA-256 of the source files
    shape: tuple[float, ...] = ()  # sorted extents (m), area (m^2), volume (m^3): copies have the same, turned or not
    look: tuple[float, ...] = ()  # shares of the surface by colour, three levels each of red, green and blue
    files: dict[str, str] = Field(default_factory=dict)  # SHA-256 of every file of the asset, by library-relative name
    notes: tuple[str, ...] = ()  # what was found and mended


MANIFEST = "manifest.json"


class Asset(Frozen):
    """What the library knows of one object, before its URDF is read."""

    name: str  # library-relative URDF name, e.g. ``"HOPE/Milk.urdf"``; the id everywhere
    kind: str  # what it is called, e.g. ``"Milk"``
    category: str  # can, box, bottle, ..., bowl, zone, proxy or another plain noun
    size: Vec3  # extents along x, y, z in m, upright; for a template: with its defaults
    mass: float = Field(ge=0, allow_inf_nan=False)  # kg; 0 for marks on the table
    friction: float = Field(ge=0, allow_inf_nan=False)  # coefficient of sliding friction
    color: str  # name of its dominant colour
    description: str  # one sentence for people and models
    hollow: bool = False  # other things can be put in it or on it
    fixture: bool = False  # a task may add it without its being in the photo
    everyday: bool = True  # it may be what a photo shows; the toys and fixtures of published programs are not
    # defaults of its placeholders (``{"DIM": (x, y, z), "COLOR": (r, g, b, a)}``); empty for an ordinary asset
    template: dict[str, tuple[float | str, ...]] = Field(default_factory=dict)
    physics: Physics | None = None  # None where only ``mass`` and ``friction`` are known, see `physics_or_defaults`
    origin: Origin | None = None  # where an imported asset comes from; None for those that GRS ships and for proxies

    @model_serializer(mode="wrap")
    def _serialize_without_none(self, written: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """What is not known is left out of manifests."""
        return {name: value for name, value in written(self).items() if value is not None}

    def physics_or_defaults(self) -> Physics:
        """Its physics; where only mass and friction are known, they are taken for estimates."""
        if self.physics is not None:
            return self.physics
        mass = Quantity(value=self.mass, provenance="estimate", deviation=0.3)
        return Physics(mass=mass, friction=Quantity(value=self.friction, provenance="default", deviation=0.3))


class Manifest(Frozen):
    """The assets of one library root."""

    version: int = 1
    assets: tuple[Asset, ...] = ()


def read_manifest(root: Path) -> Manifest:
    """The manifest of a library root, empty without ``manifest.json``; an `InputError` where either is faulty."""
    if not root.is_dir():
        raise InputError(f"asset library {root} does not exist", "name an existing folder")
    path = root / MANIFEST
    if not path.exists():
        return Manifest()
    status = path.stat()
    return _read_manifest_file(path, (status.st_ino, status.st_mtime_ns, status.st_size))


@lru_cache(maxsize=16)
def _read_manifest_file(path: Path, stamp: tuple[int, int, int]) -> Manifest:
    """What a manifest says; it is read anew once its ``stamp`` has changed."""
    del stamp
    try:
        return Manifest.model_validate(read_json(path, "correct the manifest"))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InputError(f"cannot read {path}: {where}: {first['msg']}", "correct the manifest") from error
