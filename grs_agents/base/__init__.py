"""The base of every value that crosses a border."""

from pydantic import BaseModel, ConfigDict

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]
"""Rotation as (x, y, z, w)."""
Pose = tuple[Vec3, Quat]
"""Position in metres and rotation (xyzw), robot frame unless said otherwise."""


class Frozen(BaseModel):
    """An immutable, serialisable value that refuses unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="strings")
