"""What readers of the log rely on inside an event's free-form JSON; all else in it may be anything."""

from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field

_WIDEST = 20_000
"""Pixels of a side of a photo."""
_MOST_OBJECTS = 1_000
Number = Annotated[float, Field(allow_inf_nan=False, ge=-1e9, le=1e9)]
Vector = tuple[Number, Number, Number]
Turn = tuple[Number, Number, Number, Number]
Row = tuple[Number, Number, Number, Number]


class Known(BaseModel):
    """Fields that must fit; others may be there."""

    model_config = ConfigDict(extra="allow", frozen=True)


class KnownCamera(Known):
    """A pinhole camera: pixels, and the rigid transform from its frame to the robot's, if it is known."""

    fx: Annotated[float, Field(gt=0, le=1e6)]
    fy: Annotated[float, Field(gt=0, le=1e6)]
    cx: Number
    cy: Number
    width: Annotated[int, Field(ge=1, le=_WIDEST)]
    height: Annotated[int, Field(ge=1, le=_WIDEST)]
    depth_scale: Annotated[float, Field(gt=0, le=1e3)] | None = None
    T_robot_cam: tuple[Row, Row, Row, Row] | None = None


class KnownBox(Known):
    """An axis-aligned box, metres, robot frame."""

    low: Vector
    high: Vector


class KnownObject(Known):
    """An object of a scene; the pose is that of the centre of its asset, metres and xyzw, robot frame."""

    id: Annotated[int, Field(ge=0, le=100_000)] | None = None
    label: Annotated[int, Field(ge=0, le=100_000)] | None = None
    name: str | None = None
    asset: str | None = None
    description: str | None = None
    box: KnownBox | None = None
    position: Vector | None = None
    orientation: Turn | None = None
    settled: tuple[Vector, Turn] | None = None


class KnownSummary(Known):
    """The summary of a stage of the scene."""

    camera: KnownCamera | None = None
    depth_scale: Annotated[float, Field(gt=0, le=1e3)] | None = None
    objects: Annotated[tuple[KnownObject, ...], Field(max_length=_MOST_OBJECTS)] | None = None
    background: str | None = None


class KnownEpisode(Known):
    """What the oracle did in a test."""

    outcome: str | None = None
    detail: str | None = None


class KnownCase(Known):
    """One test."""

    id: str | None = None
    outcome: str | None = None
    message: str | None = None
    seconds: Number | None = None
    episode: KnownEpisode | None = None


class KnownReport(Known):
    """The report of a run of the tests."""

    outcome: str | None = None
    message: str | None = None
    seconds: Number | None = None
    cases: tuple[KnownCase, ...] | None = None


_Json = TypeVar("_Json", bound=dict[str, Any])


def checked(value: _Json, kind: type[Known]) -> _Json:
    """``value`` as it is.

    Raises:
        ValidationError: what ``kind`` names in it does not fit.
    """
    kind.model_validate(value)
    return value
