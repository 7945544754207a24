"""The types of perception: frame and camera, boxes, candidates, the table's frame, the description of the whole scene.
The workspace is where the arm works: on the table in front of its base, within its reach."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import (
    AfterValidator,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    field_validator,
    model_serializer,
    model_validator,
)

from grs_agents.base import Frozen, Pose, Quat, Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json
from grs_agents.base.foreign.files import read_json
from grs_agents.base.foreign.run_folder import is_relative_subpath
from grs_agents.sim.instance.task_instance import InstanceTable, TextureName

FARTHEST_CAMERA = 10.0  # largest plausible distance of the camera from the robot, m
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Matrix = tuple[tuple[float, ...], ...]
Image = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]
Array = npt.NDArray[np.float64]


class Intrinsics(Frozen):
    """A pinhole camera, OpenCV axes (x right, y down, z forward)."""

    fx: Positive  # fx, fy, cx, cy: intrinsics in pixels
    fy: Positive
    cx: Finite
    cy: Finite
    width: Annotated[int, Field(gt=0)]  # width, height: of the colour image in pixels
    height: Annotated[int, Field(gt=0)]

    @model_validator(mode="after")
    def _check_plausible_intrinsics(self) -> Self:
        longest = max(self.width, self.height)
        for name in ("fx", "fy"):
            if not 0.1 * longest <= getattr(self, name) <= 20 * longest:
                raise ValueError(
                    f"{name} = {getattr(self, name):g} is outside {0.1 * longest:g}..{20 * longest:g} pixels"
                )
        for name, extent in (("cx", self.width), ("cy", self.height)):
            if not -extent <= getattr(self, name) <= 2 * extent:
                raise ValueError(f"{name} = {getattr(self, name):g} is outside {-extent}..{2 * extent} pixels")
        return self


class Camera(Intrinsics):
    """The camera of a photo with depth."""

    depth_scale: Positive  # metres per unit of the depth image
    # 4x4 rigid transform from the camera frame to the robot frame, if it was calibrated
    T_robot_cam: Matrix | None = None
    # the arm's joint positions in the photo, rad, base first; they locate the pixels of the arm
    joints: tuple[Finite, ...] | None = None
    up: Vec3 | None = None  # away from gravity, unit vector in the camera frame, if a sensor measured it

    @property
    def arm_is_known(self) -> bool:
        """Whether the arm's pose in the photo is known."""
        return self.joints is not None and self.T_robot_cam is not None

    @property
    def intrinsics(self) -> Intrinsics:
        """Focal lengths, principal point and size without depth scale and pose."""
        return Intrinsics.model_validate({name: getattr(self, name) for name in Intrinsics.model_fields})

    @field_validator("up")
    @classmethod
    def _normalise_up(cls, up: Vec3 | None) -> Vec3 | None:
        if up is None:
            return None
        length = math.hypot(*up)
        if not 1e-6 < length < 1e6:
            raise ValueError("must be a direction: three finite numbers that are not all 0")
        return (up[0] / length, up[1] / length, up[2] / length)

    @model_serializer(mode="wrap")
    def _leave_out_unknown_up(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {key: value for key, value in dump(self).items() if key != "up" or value is not None}

    @field_validator("T_robot_cam")
    @classmethod
    def _check_rigid_transform(cls, matrix: Matrix | None) -> Matrix | None:
        if matrix is None:
            return None
        try:
            array = np.asarray(matrix, dtype=np.float64)
        except ValueError as error:
            raise ValueError("must be a 4x4 matrix of numbers") from error
        if array.shape != (4, 4) or not np.isfinite(array).all():
            raise ValueError("must be a 4x4 matrix of finite numbers")
        rotation = array[:3, :3]
        proper = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) and np.linalg.det(rotation) > 0
        if not proper or not np.allclose(array[3], (0, 0, 0, 1), atol=1e-6):
            raise ValueError("must be a rigid transform: a rotation, a translation in metres, last row 0 0 0 1")
        distance = float(np.linalg.norm(array[:3, 3]))
        if distance > FARTHEST_CAMERA:
            raise ValueError(
                f"puts the camera {distance:g} m from the robot, more than {FARTHEST_CAMERA:g} m: give it in metres"
            )
        return matrix


@dataclass(frozen=True, eq=False)
class RGBDFrame:
    """An RGB-D photo; compared by identity."""

    rgb: Image  # (H, W, 3) uint8
    depth: npt.NDArray[np.float32]  # (H, W) float32 metres along the optical axis, 0 where nothing was measured
    camera: Camera  # intrinsics and, if calibrated, pose
    source: Path  # a folder, a file, or ``bop:`` and an image of a data set
    notes: tuple[str, ...] = ()  # of the reader of the file, for a reader of the scene

    def camera_frame_point_map(self) -> Array:
        """Points (H, W, 3) in the camera frame, m; (0, 0, 0) without depth."""
        camera = self.camera
        height, width = self.depth.shape
        points = np.empty((height, width, 3))
        points[..., 2] = self.depth
        columns, rows = np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64)[:, None]
        points[..., 0] = (columns - camera.cx) / camera.fx * points[..., 2]
        points[..., 1] = (rows - camera.cy) / camera.fy * points[..., 2]
        return points


Solid = Literal["box", "cylinder"]
PoseMethod = Literal["registered", "box", "proxy"]
"""A mesh registered to the points; the asset placed in the measured box; or a proxy."""
RelationKind = Literal["on", "in", "touching"]


class Aabb(Frozen):
    """An axis-aligned box in the robot frame, metres."""

    low: Vec3
    high: Vec3

    @property
    def size(self) -> Vec3:
        """Extents along x, y, z."""
        return (self.high[0] - self.low[0], self.high[1] - self.low[1], self.high[2] - self.low[2])

    @property
    def center(self) -> Vec3:
        """The centre."""
        low, high = self.low, self.high
        return ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2)


class UprightBox(Frozen):
    """A box that stands upright: centre (m, robot frame), size along its own axes (m), yaw about z (rad)."""

    center: Vec3
    size: Vec3
    yaw: float


class LevelPlane(Frozen):
    """A level plane in the photo, a candidate for the table."""

    number: int  # from 1, the lowest plane first; ``scene.table`` takes it
    height: float  # of its centre over the plane chosen as the table, m
    share: float  # share of the measured pixels on it
    taken: bool  # chosen as the table


class TableFrame(Frozen):
    """The robot frame in the photo, and its origin."""

    T_robot_cam: Matrix  # 4x4 transform from the camera frame (OpenCV axes) to the robot frame, metres
    # ``calibrated`` (given in camera.json) or ``table_plane`` (on the table found in the photo)
    origin: Literal["calibrated", "table_plane"]
    residual: float  # root mean square distance of the table's points from its plane, m
    inliers: float  # share of the measured pixels on the table
    height: float = 0.0  # z of the table top in the robot frame, metres; 0 where the frame is on it
    note: str = ""  # for a reader of the scene
    # candidate planes of the table, the lowest first; empty if none were searched
    planes: tuple[LevelPlane, ...] = ()

    @property
    def camera_position(self) -> Array:
        """The camera's position (3,) in the robot frame, m."""
        return np.asarray(self.T_robot_cam)[:3, 3]


Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]


def _check_inside_run_folder(name: str) -> str:
    if not is_relative_subpath(name):
        raise ValueError(f"{name[:200]!r} is no path inside the run folder")
    return name


InsideName = Annotated[str, AfterValidator(_check_inside_run_folder)]  # a file relative to the run folder, and in it


@dataclass(frozen=True)
class Candidate:
    """A segment that may be an object."""

    id: int  # from 1
    mask: Mask  # (H, W) bool
    crop: Image  # (h, w, 3) uint8, the segment's rectangle with a margin
    box: Aabb  # axis-aligned, robot frame
    upright: UprightBox  # the fitted box
    color: Vec3  # mean red, green, blue, 0..1
    shape: Solid  # the better fitting solid
    points: int  # number of pixels with depth
    hollow: bool = False  # open at the top, with an inside below its rim: bowls, boxes, mugs
    given: bool = False  # its mask was given by the user: it is neither dropped, joined nor divided
    label: str = ""  # name of its given mask


class CandidateRecord(Frozen):
    """A candidate with its mask and crop in files, whose paths are relative to the run folder."""

    id: int
    mask: InsideName
    crop: InsideName
    box: Aabb
    upright: UprightBox
    color: Vec3
    shape: Solid
    points: int
    hollow: bool = False
    given: bool = False
    label: str = ""


class Shown(Frozen):
    """The row of an asset in the prompt of a match; ``size`` in m, upright."""

    name: str
    description: str
    color: str
    category: str
    size: Vec3


class MatchEvidence(Frozen):
    """The answer of a match tool for a candidate, with its reason."""

    # ``asset``; ``no_asset`` for an object that the library lacks; ``no_object`` for anything else
    match: Literal["asset", "no_asset", "no_object"]
    asset: str | None = None  # library name of the match
    method: str = ""  # the tool; `BY_FEATURES` of `perception.matching.types` where no model was asked
    confidence: float | None = None  # probability that the answer is right, 0..1; ``None`` if the tool gives none
    # likelihood or similarity in 0..1 of the best few assets, by name, the best first
    scores: dict[str, float] = Field(default_factory=dict[str, float])
    runner_up: str | None = None  # the best asset that is not the answer
    reason: str = ""  # in words


SEEN_TOO_SPARSELY: Final = "seen too sparsely"
"""Beginning of the `SceneObject.pick_trouble` of an object of which no task can be sure."""


_SET_BY_PERSON: Final = ("mass", "friction")


class SceneObject(Frozen):
    """An object of the scene, with its asset or proxy."""

    id: int  # the candidate's
    name: str  # unique in the scene, e.g. ``milk_1``.
    asset: str  # library name, or the proxy's
    matched: bool  # False for a primitive proxy
    description: str  # description, category, color: in words
    category: str
    color: str
    box: Aabb  # axis-aligned, as measured, robot frame; unseen parts end at other objects
    position: Vec3  # centre of the asset, metres, robot frame
    orientation: Quat  # of the asset, xyzw
    size: Vec3  # extents of the asset as placed, along the world's axes (before yaw), metres
    reachable: bool  # within the arm's workspace
    evidence: str  # why this asset, in words
    mask: InsideName  # mask, crop: picture files
    crop: InsideName
    method: PoseMethod = "box"  # source of the pose
    # distance of the object's points from the asset's surface, m: mean of the nearest 90 %; None for a proxy
    residual: float | None = None
    round: bool = False  # rotationally symmetric about the vertical: the yaw is arbitrary
    settled: Pose | None = None  # rest pose in the twin: centre (m) and rotation (xyzw)
    drift: float | None = None  # distance of its centre from there to ``position``, m
    held: bool = False  # it would fall, in the twin or in the world of its tasks, and is fixed in the air
    stands_in_robot: bool = False  # overlaps the robot in the world of its tasks, and is left out there
    # reason why the robot fails to pick it in a trial, or why no task can be sure of it; empty if it can
    pick_trouble: str = ""
    match: MatchEvidence | None = None  # scores, runner-up and reason of the match
    # the measured box along its own axes; ``None`` in older descriptions
    upright: UprightBox | None = None
    # set by a person: kg, and the coefficient of sliding friction
    mass: Positive | None = None
    friction: Positive | None = None

    @model_serializer(mode="wrap")
    def _leave_out_facts_not_set(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {key: value for key, value in dump(self).items() if value is not None or key not in _SET_BY_PERSON}

    @property
    def is_doubtful(self) -> bool:
        """True for a bystander that no task may use: the photo shows too little of it to tell it from noise."""
        return self.pick_trouble.startswith(SEEN_TOO_SPARSELY)


class DroppedCandidate(Frozen):
    """A segment that is no object."""

    id: int  # the candidate's; 0 for segments dropped before candidates were numbered, such as the robot
    reason: str


class SpatialRelation(Frozen):
    """A relation of two objects, by name: ``subject`` is on, in or touching ``reference``."""

    kind: RelationKind
    subject: str
    reference: str


class TwinReport(Frozen):
    """Figures of the described scene in MuJoCo (the twin)."""

    found: float  # deepest penetration as described, m
    penetration: float  # deepest penetration at rest, m
    drift: float  # largest drift of an object, m
    # share of the raised pixels at which the twin at rest is within 2 cm of the measured depth; ``None`` without any
    fidelity: float | None
    still: bool  # everything came to rest
    held: int = 0  # number of objects that would have fallen and are fixed


class UnownedRegion(Frozen):
    """A connected region of raised pixels (above the table) without an object."""

    share: Share  # of all raised pixels, measured or not
    box: Aabb  # axis-aligned, robot frame
    reason: str  # in words


class Coverage(Frozen):
    """Share of the raised pixels (above the table, without the robot) that belong to objects."""

    share: Share  # of the measured raised pixels
    unowned: tuple[UnownedRegion, ...] = ()  # the largest first
    picture: InsideName  # the photo with the unowned regions marked


class SceneDescription(Frozen):
    """The whole scene (paper, Scene Comprehension)."""

    version: int = 1
    source: str
    image: str
    frame: TableFrame
    objects: tuple[SceneObject, ...]
    dropped: tuple[DroppedCandidate, ...] = ()
    warnings: tuple[str, ...] = ()
    background: str | None = None  # library name of the reconstructed background
    relations: tuple[SpatialRelation, ...] = ()
    twin: TwinReport | None = None
    camera: Intrinsics | None = None  # of the photo, at the frame's pose; None in older descriptions
    table_color: tuple[Share, Share, Share] | None = None  # sRGB, 0..1; None if not visible, or in older descriptions
    table_texture: TextureName | None = None  # library name of the table's rectified texture
    coverage: Coverage | None = None  # None in older descriptions
    edits: tuple[str, ...] = ()  # of a person, in words

    @model_serializer(mode="wrap")
    def _leave_out_no_edits(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {key: value for key, value in dump(self).items() if key != "edits" or value}

    @property
    def instance_table(self) -> InstanceTable:
        """The table top of the photo."""
        if self.table_color is None:
            return InstanceTable()
        return InstanceTable(color=(*self.table_color, 1.0), texture=self.table_texture)

    def write(self, file: Path) -> None:
        """Write ``scene.json`` atomically."""
        write_json(file, self.model_dump(mode="json"))


def read_scene_description(file: Path) -> SceneDescription:
    """Read ``scene.json``; raises InputError if it cannot be read or does not fit the schema."""
    try:
        return SceneDescription.model_validate(read_json(file, "make it with `grs scene`"))
    except ValidationError as error:
        raise InputError(f"{file}: {error.errors()[0]['msg']}", "make it again with `grs scene`") from error


X = (0.25, 0.75)
Y = (-0.5, 0.5)  # the workspace of tasks (CLIPort's), m, robot frame
NEAREST, FARTHEST = 0.22, 0.85
"""Reach from the base axis, m: a UR5e folds into itself nearer and does not reach farther."""


def is_reachable_position(position: Vec3) -> bool:
    """Whether an object at ``position`` (m, robot frame) can be picked from above."""
    x, y, _ = position
    return X[0] <= x <= X[1] and Y[0] <= y <= Y[1] and NEAREST <= (x * x + y * y) ** 0.5 <= FARTHEST
