"""The bounds of a variation of a task instance."""

from typing import Annotated

from pydantic import Field

from grs_agents.base import Frozen

Share = Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)]


class Variation(Frozen):
    """How far a varied instance may be from its base; all of it off by default."""

    jitter: Annotated[float, Field(ge=0, le=0.5, allow_inf_nan=False)] = 0.0  # metres along x and y, either way
    yaw: Annotated[float, Field(ge=0, le=3.15, allow_inf_nan=False)] = 0.0  # radians about the vertical, either way
    mass: Share = 0.0  # share of an object's mass, either way
    friction: Share = 0.0  # the same of its sliding friction
    light: bool = False  # where the light is, and how bright
    texture: bool = False  # the pattern and the colours of the table top
    distractors: Annotated[int, Field(ge=0, le=50)] = 0  # objects of the library that no goal speaks of
