"""An entry of the library's manifest."""

from pathlib import Path
from typing import Any

from pydantic import Field, SerializerFunctionWrapHandler, ValidationError, model_serializer

from grs_agents.base import Frozen, Vec3
from grs_agents.errors import InputError
from grs_agents.foreign import read_json
from grs_agents.library.physical_properties import Origin, Physics, Quantity

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
