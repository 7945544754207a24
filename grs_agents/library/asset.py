"""An entry of the library's manifest, and the physical properties of an asset.

Each property (mass, friction, restitution) says where its number comes from and how far off it may be.
"""

from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, ValidationError, model_serializer

from grs_agents.base import Frozen, Vec3
from grs_agents.errors import InputError
from grs_agents.foreign import read_json

Provenance = Literal["measured", "catalogue", "estimate", "default"]
"""By a scale; by the source of the asset; by a model or from volume and material; by nothing but custom."""


class Quantity(Frozen):
    """One physical number.

    Attributes:
        value: in its SI unit.
        provenance: where it comes from.
        deviation: standard deviation as a share of the value.
    """

    value: float = Field(ge=0, allow_inf_nan=False)
    provenance: Provenance = "default"
    deviation: float = Field(default=0.3, ge=0, le=2, allow_inf_nan=False)

    def draw(self, rng: np.random.Generator) -> float:
        """A value for one randomised scene: log-normal around ``value``, within a factor of 4."""
        spread = float(np.log1p(self.deviation))
        if spread == 0:
            return self.value
        return self.value * float(np.exp(np.clip(rng.normal(0.0, spread), -np.log(4), np.log(4))))


class Physics(Frozen):
    """What an asset's contact and motion depend on.

    Attributes:
        mass: kg.
        friction: coefficient of sliding friction.
        restitution: speed after a bounce over the speed before it, 0..1.
    """

    mass: Quantity
    friction: Quantity = Quantity(value=0.6, provenance="default", deviation=0.3)
    restitution: Quantity = Quantity(value=0.2, provenance="default", deviation=0.5)


class Origin(Frozen):
    """Where an imported asset comes from.

    Attributes:
        collection: the folder of the library it is in.
        source: path inside the source, or the identifier there.
        license: what its source says; ``unknown`` where it says nothing.
        content: SHA-256 of the source files.
        shape: numbers that copies and turned copies of a shape share: sorted extents (m), area (m^2), volume (m^3).
        look: shares of the surface by colour, three levels each of red, green and blue.
        files: SHA-256 of every file of the asset, by library-relative name.
        notes: what was found and mended.
    """

    collection: str
    source: str
    license: str = "unknown"
    content: str = ""
    shape: tuple[float, ...] = ()
    look: tuple[float, ...] = ()
    files: dict[str, str] = Field(default_factory=dict)
    notes: tuple[str, ...] = ()


MANIFEST = "manifest.json"


class Asset(Frozen):
    """What the library knows of one object, before its URDF is read.

    Attributes:
        name: library-relative URDF name, e.g. ``"HOPE/Milk.urdf"``; the id everywhere.
        kind: what it is called, e.g. ``"Milk"``.
        category: can, box, bottle, jar, carton, tub, canister, cube, container, bowl, mug, plate, zone, proxy
            or another plain noun.
        size: extents along x, y, z in m, upright; for a template: with its defaults.
        mass: kg; 0 for marks on the table.
        friction: coefficient of sliding friction.
        color: name of its dominant colour.
        description: one sentence for people and models.
        hollow: other things can be put in it or on it.
        fixture: a task may add it without its being in the photo.
        everyday: it may be what a photo shows; the toys and fixtures of published programs are not.
        template: defaults of its placeholders (``{"DIM": (x, y, z), "COLOR": (r, g, b, a)}``); empty for an
            ordinary asset.
        physics: mass, friction and restitution with their provenance; None where only ``mass`` and ``friction`` are
            known, see `physical`.
        origin: where an imported asset comes from; None for those that GRS ships and for proxies.
    """

    name: str
    kind: str
    category: str
    size: Vec3
    mass: float = Field(ge=0, allow_inf_nan=False)
    friction: float = Field(ge=0, allow_inf_nan=False)
    color: str
    description: str
    hollow: bool = False
    fixture: bool = False
    everyday: bool = True
    template: dict[str, tuple[float | str, ...]] = Field(default_factory=dict)
    physics: Physics | None = None
    origin: Origin | None = None

    @model_serializer(mode="wrap")
    def _brief(self, written: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """What is not known is left out of manifests."""
        return {name: value for name, value in written(self).items() if value is not None}

    def physical(self) -> Physics:
        """Its physics; where only mass and friction are known, they are taken for estimates."""
        if self.physics is not None:
            return self.physics
        return Physics(
            mass=Quantity(value=self.mass, provenance="estimate", deviation=0.3),
            friction=Quantity(value=self.friction, provenance="default", deviation=0.3),
        )


class Manifest(Frozen):
    """The assets of one library root."""

    version: int = 1
    assets: tuple[Asset, ...] = ()


def read_manifest(root: Path) -> Manifest:
    """The manifest of a library root; a folder without ``manifest.json`` holds no assets.

    Raises:
        InputError: the folder does not exist, or its manifest cannot be read or does not fit the schema.
    """
    if not root.is_dir():
        raise InputError(f"asset library {root} does not exist", "name an existing folder")
    path = root / MANIFEST
    if not path.exists():
        return Manifest()
    try:
        return Manifest.model_validate(read_json(path, "correct the manifest"))
    except ValidationError as error:
        raise InputError(f"cannot read {path}: {_first_line(error)}", "correct the manifest") from error


def _first_line(error: ValidationError) -> str:
    first = error.errors()[0]
    return f"{'.'.join(str(part) for part in first['loc'])}: {first['msg']}"
