"""Entries of the library's manifest, and the physical properties of an asset: each number (mass, friction, restitution)
has a provenance and a standard deviation."""

from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, Field, SerializerFunctionWrapHandler, ValidationError, model_serializer

from grs_agents.base import Frozen, Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import cache_until_modified, read_json

Provenance = Literal["measured", "catalogue", "estimate", "default"]
"""Measured by a scale; from the source of the asset; from a model or from volume and material; by convention."""


class Quantity(Frozen):
    """A physical quantity with its provenance and uncertainty."""

    value: float = Field(ge=0, allow_inf_nan=False)  # in its SI unit
    provenance: Provenance = "default"
    deviation: float = Field(default=0.3, ge=0, le=2, allow_inf_nan=False)  # standard deviation as a share of the value


DEFAULT_FRICTION = Quantity(value=0.6, provenance="default", deviation=0.3)


class PhysicalProperties(Frozen):
    """Mass and contact parameters of an asset."""

    mass: Quantity  # kg
    friction: Quantity = DEFAULT_FRICTION  # coefficient of sliding friction
    restitution: Quantity = Quantity(value=0.2, provenance="default", deviation=0.5)  # speed after over before a bounce


class Origin(Frozen):
    """Source of an imported asset."""

    model_config = ConfigDict(allow_inf_nan=False)

    collection: str  # the folder of the library it is in
    source: str  # path inside the source, or the identifier there
    license: str = "unknown"  # as its source states it; ``unknown`` without a statement
    content: str = ""  # SHA-256 of the source files
    shape: tuple[float, ...] = ()  # sorted extents (m), area (m^2), volume (m^3): copies have the same, turned or not
    look: tuple[float, ...] = ()  # shares of the surface by colour, three levels each of red, green and blue
    files: dict[str, str] = Field(default_factory=dict)  # SHA-256 of every file of the asset, by library-relative name
    notes: tuple[str, ...] = ()  # repairs and findings of the import


MANIFEST = "manifest.json"


class Asset(Frozen):
    """Entry of the manifest: the facts about an object that are known before its URDF is read."""

    model_config = ConfigDict(allow_inf_nan=False)  # a manifest with such a number could not be written again

    name: str  # library-relative URDF name, e.g. ``"HOPE/Milk.urdf"``; the id everywhere
    kind: str  # name of the kind, e.g. ``"Milk"``
    category: str  # can, box, bottle, ..., bowl, zone, proxy or another plain noun
    size: Vec3  # extents along x, y, z in m, upright; for a template: with its defaults
    mass: float = Field(ge=0, allow_inf_nan=False)  # kg; 0 for marks on the table
    friction: float = Field(ge=0, allow_inf_nan=False)  # coefficient of sliding friction
    color: str  # name of its dominant colour
    description: str  # a sentence for people and models
    hollow: bool = False  # other things can be put in it or on it
    fixture: bool = False  # a task may add it without its being in the photo
    everyday: bool = True  # may appear in a photo; false for the toys and fixtures of published programs
    # defaults of its placeholders (``{"DIM": (x, y, z), "COLOR": (r, g, b, a)}``); empty for an ordinary asset
    template: dict[str, tuple[float | str, ...]] = Field(default_factory=dict)
    physics: PhysicalProperties | None = (
        None  # None if only ``mass`` and ``friction`` are known, see `physics_or_defaults`
    )
    origin: Origin | None = None  # source of an imported asset; None for shipped assets and proxies

    @model_serializer(mode="wrap")
    def _serialize_without_none(self, written: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave unknown fields (None) out of manifests."""
        return {name: value for name, value in written(self).items() if value is not None}

    def physics_or_defaults(self) -> PhysicalProperties:
        """Physical properties; mass and friction without them count as estimates."""
        if self.physics is not None:
            return self.physics
        mass = Quantity(value=self.mass, provenance="estimate", deviation=0.3)
        return PhysicalProperties(
            mass=mass, friction=Quantity(value=self.friction, provenance="default", deviation=0.3)
        )


class AssetManifest(Frozen):
    """The manifest of a library root."""

    version: int = 1
    assets: tuple[Asset, ...] = ()


def read_manifest(root: Path) -> AssetManifest:
    """The manifest of a library root, empty without ``manifest.json``; an `InputError` if either is faulty."""
    if not root.is_dir():
        raise InputError(f"asset library {root} does not exist", "name an existing folder")
    path = root / MANIFEST
    return _parse_manifest(path) if path.exists() else AssetManifest()


@cache_until_modified(16)
def _parse_manifest(path: Path) -> AssetManifest:
    try:
        return AssetManifest.model_validate(read_json(path, "correct the manifest"))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InputError(f"cannot read {path}: {where}: {first['msg']}", "correct the manifest") from error
