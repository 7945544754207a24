"""Edits of a scene by a person, and the file that keeps them, ``edits.json``.

An object is named by its place, a pixel of the photo inside its mask, so that an edit holds when segmentation changes.
Pixels are (column, row). Positions and lengths are in metres in the robot frame, angles in radians.
"""

import json
import math
from pathlib import Path
from typing import Annotated, Final, Literal, Self

import cv2
import numpy as np
from pydantic import AfterValidator, Field, ValidationError, model_validator

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_text
from grs_agents.base.foreign.files import parse_json, read_bytes
from grs_agents.base.geometry.transforms import to_vec3
from grs_agents.perception.image_geometry import mask_bounding_slices
from grs_agents.perception.types import Mask, RGBDFrame, TableFrame
from grs_agents.sim.instance.task_instance import HEAVIEST, LEAST_FRICTION, LIGHTEST, MOST_FRICTION

FILE: Final = "edits.json"
MOST_EDITS = 500
MOST_FILE_BYTES = 1 << 22
_MOST_SIDE = 1 << 15
"""Largest side of a photo in pixels."""
_REMEDY = "write it with `grs edit`, or see docs/edit.md"
_FARTHEST = 5.0  # m; the simulated table reaches less far
_SMALLEST, _LARGEST = 0.003, 1.5  # extents of an object, m
MOST_OFF_PLANE: Final = 0.1
"""Height (m) over or under a plane within which a pixel names it as the table; far planes tilt by some degrees."""


def _check_printable(text: str) -> str:
    if not text.strip() or not text.isprintable():
        raise ValueError("must be words without control characters")
    return " ".join(text.split())


Coordinate = Annotated[int, Field(ge=0, lt=_MOST_SIDE, strict=True)]
Pixel = tuple[Coordinate, Coordinate]
"""Column and row."""
Metres = Annotated[float, Field(ge=-_FARTHEST, le=_FARTHEST, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi, allow_inf_nan=False)]
Extent = Annotated[float, Field(ge=_SMALLEST, le=_LARGEST, allow_inf_nan=False)]
Words = Annotated[str, Field(min_length=1, max_length=80), AfterValidator(_check_printable)]
AssetName = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_check_printable)]
AS_SEEN: Final = "as_seen"


class Rectangle(Frozen):
    """Pixels from ``left``, ``top`` up to, not including, ``right``, ``bottom``."""

    left: Coordinate
    top: Coordinate
    right: Coordinate
    bottom: Coordinate

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if self.right - self.left < 2 or self.bottom - self.top < 2:
            raise ValueError("needs left < right and top < bottom, at least 2 pixels apart")
        return self

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns inside."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def mask(self, shape: tuple[int, int]) -> Mask:
        """(H, W) pixels inside."""
        inside = np.zeros(shape, np.bool_)
        inside[self.window] = True
        return inside

    def __str__(self) -> str:
        return f"columns {self.left}..{self.right}, rows {self.top}..{self.bottom}"


class Add(Frozen):
    """An object that was missed or badly cut; it replaces the objects that it covers by more than half, and takes its
    pixels from the others."""

    act: Literal["add"] = "add"
    rectangle: Rectangle  # around the object
    # run lengths of the mask in the rectangle, row by row, background first; None: it is segmented in the rectangle
    runs: Annotated[tuple[Coordinate, ...], Field(max_length=200_000)] | None = None


class Merge(Frozen):
    """Objects that are pieces of the same object."""

    act: Literal["merge"] = "merge"
    places: Annotated[tuple[Pixel, ...], Field(min_length=2, max_length=50)]


class Split(Frozen):
    """An object that is two: its part in the rectangle, and the rest."""

    act: Literal["split"] = "split"
    place: Pixel
    rectangle: Rectangle  # around the part


class CorrectMask(Frozen):
    """An object with more or fewer pixels: ``include`` adds what the rectangle shows, ``exclude`` removes the part."""

    act: Literal["mask"] = "mask"
    place: Pixel
    rectangle: Rectangle  # around the part
    kind: Literal["include", "exclude"]


class Delete(Frozen):
    """No object."""

    act: Literal["delete"] = "delete"
    place: Pixel


class Mark(Frozen):
    """An object that is the robot or scenery, and leaves the scene, or a container, open at the top."""

    act: Literal["mark"] = "mark"
    place: Pixel
    kind: Literal["robot", "scenery", "container"]


class Rename(Frozen):
    """An object with another description, from which its name follows, and the category of a reconstructed object."""

    act: Literal["rename"] = "rename"
    place: Pixel
    name: Words


class ChooseAsset(Frozen):
    """An object that is an asset of the library, or is reconstructed ``as_seen``."""

    act: Literal["asset"] = "asset"
    place: Pixel
    asset: AssetName


class ChooseShape(Frozen):
    """An object replaced by a primitive of a size along its own axes, or of its measured size."""

    act: Literal["shape"] = "shape"
    place: Pixel
    shape: Literal["box", "cylinder", "bowl"]
    size: tuple[Extent, Extent, Extent] | None = None


class Move(Frozen):
    """An object at another position, turned about the vertical, and lowered onto the table or the object below."""

    act: Literal["move"] = "move"
    place: Pixel
    position: tuple[Metres, Metres]  # of its centre
    yaw: Angle = 0.0  # turn from its present orientation


class SetMass(Frozen):
    """The mass of an object, kg."""

    act: Literal["mass"] = "mass"
    place: Pixel
    mass: Annotated[float, Field(ge=LIGHTEST, le=HEAVIEST, allow_inf_nan=False)]


class SetFriction(Frozen):
    """The coefficient of sliding friction of an object."""

    act: Literal["friction"] = "friction"
    place: Pixel
    friction: Annotated[float, Field(ge=LEAST_FRICTION, le=MOST_FRICTION, allow_inf_nan=False)]


class ChooseTable(Frozen):
    """The table is the level plane through a pixel; perception begins anew there."""

    act: Literal["table"] = "table"
    point: Pixel


class PlaceRobot(Frozen):
    """The robot's base at a pose in the present robot frame, for photos without calibration."""

    act: Literal["robot_base"] = "robot_base"
    position: tuple[Metres, Metres]
    yaw: Angle = 0.0


Edit = Annotated[
    Add
    | Merge
    | Split
    | CorrectMask
    | Delete
    | Mark
    | Rename
    | ChooseAsset
    | ChooseShape
    | Move
    | SetMass
    | SetFriction
    | ChooseTable
    | PlaceRobot,
    Field(discriminator="act"),
]


class SceneEdits(Frozen):
    """The edits of a scene, in their order."""

    version: Literal[1] = 1
    edits: Annotated[tuple[Edit, ...], Field(max_length=MOST_EDITS)] = ()

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        placed = False
        for edit in self.edits:
            placed |= isinstance(edit, Move | PlaceRobot)
            if placed and isinstance(edit, ChooseTable):
                raise ValueError("choose the table before objects or the robot are moved: positions refer to it")
        return self

    @property
    def table(self) -> ChooseTable | None:
        """The last choice of the table."""
        return next((edit for edit in reversed(self.edits) if isinstance(edit, ChooseTable)), None)


def describe_edit(edit: Edit) -> str:
    """An edit in words, a line for people."""
    place: Pixel | None = getattr(edit, "place", None)
    at = "" if place is None else f"the object at {place[0]}, {place[1]}"
    match edit:
        case Add():
            return f"an object is added at {edit.rectangle}"
        case Merge():
            return f"the objects at {'; '.join(f'{x}, {y}' for x, y in edit.places)} are one"
        case Split():
            return f"{at} is split at {edit.rectangle}"
        case CorrectMask():
            return f"{at} {'gains' if edit.kind == 'include' else 'loses'} its part at {edit.rectangle}"
        case Delete():
            return f"{at} is no object"
        case Mark():
            return f"{at} is {'the robot' if edit.kind == 'robot' else edit.kind.replace('container', 'a container')}"
        case Rename():
            return f"{at} is called {edit.name}"
        case ChooseAsset():
            return f"{at} is {'rebuilt as seen' if edit.asset == AS_SEEN else edit.asset}"
        case ChooseShape():
            size = "" if edit.size is None else " of " + " x ".join(f"{extent:g}" for extent in edit.size) + " m"
            return f"{at} is a {edit.shape}{size}"
        case Move():
            x, y = edit.position
            return f"{at} is moved to x = {x:.3f}, y = {y:.3f} m and turned by {math.degrees(edit.yaw):.0f} degrees"
        case SetMass():
            return f"{at} weighs {edit.mass:g} kg"
        case SetFriction():
            return f"{at} has the friction {edit.friction:g}"
        case ChooseTable():
            return f"the table is the plane at {edit.point[0]}, {edit.point[1]}"
        case PlaceRobot():
            x, y = edit.position
            return f"the robot stands at x = {x:.3f}, y = {y:.3f} m, turned by {math.degrees(edit.yaw):.0f} degrees"


def edits_as_text(edits: SceneEdits) -> str:
    """The content of ``edits.json``: an edit a line."""
    lines = ",\n".join(json.dumps(edit.model_dump(mode="json", exclude_none=True)) for edit in edits.edits)
    return f'{{"version": {edits.version}, "edits": [\n{lines}\n]}}\n'


def write_edits(edits: SceneEdits, file: Path) -> None:
    """Write ``edits.json`` atomically."""
    write_text(file, edits_as_text(edits))


def read_edits(file: Path) -> SceneEdits:
    """Read ``edits.json``, which may be foreign; raises InputError if it cannot be read or an edit is not valid."""
    data = parse_json(read_bytes(file, _REMEDY, MOST_FILE_BYTES), file, _REMEDY)
    try:
        return SceneEdits.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(f"{file}: {place}: {first['msg']}"[:500], _REMEDY) from error


def mask_from_runs(rectangle: Rectangle, runs: tuple[int, ...], shape: tuple[int, int]) -> Mask:
    """(H, W) mask of run lengths in a rectangle, row by row, background first.

    Raises:
        InputError: the lengths do not add up to the rectangle's pixels.
    """
    rows, columns = rectangle.bottom - rectangle.top, rectangle.right - rectangle.left
    if sum(runs) != rows * columns:
        raise InputError(f"runs of {sum(runs)} pixels in a rectangle of {rows * columns}", _REMEDY)
    inside = np.repeat(np.arange(len(runs)) % 2 == 1, runs).reshape(rows, columns)
    mask = np.zeros(shape, np.bool_)
    mask[rectangle.window] = inside
    return mask


def inner_pixel(mask: Mask) -> Pixel:
    """The pixel (column, row) of a nonempty mask (H, W) that is farthest from its outline."""
    window = mask_bounding_slices(mask)
    inner = np.pad(mask[window], 1).astype(np.uint8)
    distance = cv2.distanceTransform(inner, cv2.DIST_L2, 3)
    row, column = np.unravel_index(int(distance.argmax()), distance.shape)
    return int(column) - 1 + window[1].start, int(row) - 1 + window[0].start


def plane_number_at(frame: RGBDFrame, table: TableFrame, point: Pixel) -> int:
    """The number of the level plane of `TableFrame.planes` that a pixel shows.

    Raises:
        InputError: the pixel has no depth, or shows none of the planes.
    """
    column, row = point
    rows, columns = frame.depth.shape
    if column >= columns or row >= rows:
        raise InputError(f"the pixel {column}, {row} is outside of the photo of {columns} x {rows}", _REMEDY)
    around = frame.depth[max(0, row - 2) : row + 3, max(0, column - 2) : column + 3]
    if not (around > 0).any():
        raise InputError(f"the pixel {column}, {row} has no depth", "name a pixel of the table that was measured")
    depth = float(np.median(around[around > 0]))
    local = np.array(((column - frame.camera.cx) / frame.camera.fx, (row - frame.camera.cy) / frame.camera.fy, 1.0))
    transform = np.asarray(table.T_robot_cam)
    height = to_vec3(transform[:3, :3] @ (depth * local) + transform[:3, 3])[2]
    nearest = min(table.planes, key=lambda plane: abs(plane.height - height), default=None)
    if nearest is None or abs(nearest.height - height) > MOST_OFF_PLANE:
        known = ", ".join(f"{plane.height:+.3f}" for plane in table.planes) or "none"
        raise InputError(
            f"the pixel {column}, {row} is {height:+.3f} m above the table and on no level plane",
            f"name a pixel of a plane; their heights in m: {known}",
        )
    return nearest.number
