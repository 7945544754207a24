"""What an asset weighs and how it slides and bounces, with where each number comes from and how far off it may be."""

from typing import Literal

import numpy as np
from pydantic import Field

from grs_agents.base import Frozen

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
        return (
            self.value * float(np.exp(np.clip(rng.normal(0.0, spread), -np.log(4), np.log(4))))
            if spread
            else self.value
        )


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
