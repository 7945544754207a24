"""The types of perception: frame and camera, boxes, candidates, the table's frame, the description of the whole scene.
The workspace is where the arm works: on the table in front of its base, within its reach."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, Field, ValidationError, field_validator, model_validator

from grs_agents.base import Frozen, Pose, Quat, Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json
from grs_agents.base.foreign.files import read_json
from grs_agents.base.foreign.run_folder import is_relative_subpath
from grs_agents.sim.instance.task_instance import InstanceTable, TextureName

FARTHEST_CAMERA = 10.0  # a camera that sees the robot's table is at most this far from the robot, in metres
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
    # the arm's joint positions when the photo was taken, rad, base first: tells which pixels show the arm
    joints: tuple[Finite, ...] | None = None

    @property
    def arm_is_known(self) -> bool:
        """Whether it is told where the arm is in the photo."""
        return self.joints is not None and self.T_robot_cam is not None

    @property
    def intrinsics(self) -> Intrinsics:
        """Focal lengths, principal point and size alone."""
        return Intrinsics.model_validate({name: getattr(self, name) for name in Intrinsics.model_fields})

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
    """A photo with depth; two are the same only if they are one."""

    rgb: Image  # (H, W, 3) uint8
    depth: npt.NDArray[np.float32]  # (H, W) float32 metres along the optical axis, 0 where nothing was measured
    camera: Camera  # intrinsics and, if calibrated, pose
    source: Path  # what it was read from: a folder, a file, or ``bop:`` and an image of a data set
    notes: tuple[str, ...] = ()  # what a reader of the scene should know about how it was read

    def camera_frame_point_map(self) -> Array:
        """(H, W, 3) points in the camera frame, metres; (0, 0, 0) where there is no depth."""
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
"""A mesh registered to the points; the asset placed in the measured box; or a solid that is the measured box."""
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
        """The middle."""
        low, high = self.low, self.high
        return ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2)


class UprightBox(Frozen):
    """A box that stands upright: centre (m, robot frame), size along its own axes (m), yaw about z (rad)."""

    center: Vec3
    size: Vec3
    yaw: float


class LevelPlane(Frozen):
    """A level plane of the photo that may be the table."""

    number: int  # from 1, the lowest plane first; ``scene.table`` takes it
    height: float  # of its middle over the plane that was taken for the table, metres
    share: float  # of the measured pixels that lie on it
    taken: bool  # whether it was taken for the table


class TableFrame(Frozen):
    """The robot frame and how it was found."""

    T_robot_cam: Matrix  # 4x4 transform from the camera frame (OpenCV axes) to the robot frame, metres
    # ``calibrated`` (given in camera.json) or ``table_plane`` (on the table found in the photo)
    origin: Literal["calibrated", "table_plane"]
    residual: float  # root mean square distance of the table's points to its plane, metres
    inliers: float  # share of the measured pixels that lie on the table
    height: float = 0.0  # z of the table top in the robot frame, metres; 0 where the frame is on it
    note: str = ""  # what a reader should know
    # the level planes that may be the table, the lowest first; empty where none were looked for
    planes: tuple[LevelPlane, ...] = ()


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
    crop: Image  # (h, w, 3) uint8, the segment with a margin
    box: Aabb  # axis-aligned, robot frame
    upright: UprightBox  # the fitted box with its yaw
    color: Vec3  # mean red, green, blue, 0..1
    shape: Solid  # which solid fits better
    points: int  # how many depth pixels it has
    hollow: bool = False  # open at the top, with an inside that lies deeper than its rim: bowls, boxes, mugs
    given: bool = False  # the user says that it is one object: it is neither dropped, joined nor divided


class CandidateRecord(Frozen):
    """A candidate without its pixels: what is kept in the state. Paths are relative to the run folder."""

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


class Shown(Frozen):
    """An asset as a matcher is shown it; ``size`` in m, upright."""

    name: str
    description: str
    color: str
    category: str
    size: Vec3


class MatchEvidence(Frozen):
    """What a match tool answers about one candidate, and why."""

    # ``asset``; ``no_asset`` for an object that the library lacks; ``no_object`` for what is none
    match: Literal["asset", "no_asset", "no_object"]
    asset: str | None = None  # library name of the match
    method: str = ""  # the tool
    confidence: float | None = None  # how likely the answer is right, 0..1; ``None`` where the tool cannot say
    # of the best few assets, likelihood or similarity in 0..1, by name, the best first
    scores: dict[str, float] = Field(default_factory=dict[str, float])
    runner_up: str | None = None  # the best asset that is not the answer
    reason: str = ""  # in words


class SceneObject(Frozen):
    """An object of the scene, with the asset that stands for it."""

    id: int  # the candidate's
    name: str  # unique in the scene, e.g. ``milk_1``.
    asset: str  # library name, or the proxy's
    matched: bool  # False for a primitive proxy
    description: str  # description, category, color: in words
    category: str
    color: str
    box: Aabb  # axis-aligned, as measured, robot frame; what is not seen of it ends where something else was measured
    position: Vec3  # centre of the asset, metres, robot frame
    orientation: Quat  # of the asset, xyzw
    size: Vec3  # extents of the asset as placed, along the world's axes (before yaw), metres
    reachable: bool  # within the arm's workspace
    evidence: str  # why this asset, in words
    mask: InsideName  # mask, crop: picture files
    crop: InsideName
    method: PoseMethod = "box"  # where the pose comes from
    # how far the object's points are off the asset's surface, m (mean of the nearest 90 %); of a match
    residual: float | None = None
    round: bool = False  # the asset looks the same at any yaw, which therefore says nothing
    settled: Pose | None = None  # where it comes to rest in the twin: centre (m) and rotation (xyzw)
    drift: float | None = None  # how far its centre moves until then, m
    held: bool = False  # it would fall, in the twin or in the world of its tasks, and is kept in the air
    stands_in_robot: bool = False  # the robot stands there in the world of its tasks, which leaves it out
    pick_trouble: str = ""  # why the robot, which tried, could not pick it where it stands; empty where it could
    match: MatchEvidence | None = None  # scores, runner-up and reason of the match
    # the same box along its own axes; ``None`` in descriptions of before there was one
    upright: UprightBox | None = None


class DroppedCandidate(Frozen):
    """A segment that is no object, and why."""

    id: int  # the candidate's; 0 for what was left out before candidates were numbered, as the robot
    reason: str


class Relation(Frozen):
    """How one object lies to another: ``subject`` is on, in or touching ``reference``; both are names."""

    kind: RelationKind
    subject: str
    reference: str


class TwinReport(Frozen):
    """How the described scene stands in MuJoCo."""

    found: float  # deepest penetration as described, m
    penetration: float  # deepest one once it came to rest, m
    drift: float  # of the object that moved farthest, m
    # share of the pixels that rise above the table at which the twin at rest, seen by the photo's camera, is within
    # 2 cm of the measured depth; ``None`` if nothing was measured
    fidelity: float | None
    still: bool  # everything came to rest
    held: int = 0  # so many objects would have fallen: they stay where the photo shows them


class UnownedRegion(Frozen):
    """A connected part of what rises above the table that belongs to no object."""

    share: Share  # of all pixels that rise above the table, measured or not
    box: Aabb  # axis-aligned, robot frame
    reason: str  # why no object owns it, in words


class Coverage(Frozen):
    """Which part of what rises above the table the objects own. The robot and the walls of a bin do not count."""

    share: Share  # of the measured pixels that rise above the table
    unowned: tuple[UnownedRegion, ...] = ()  # the largest first
    picture: InsideName  # the photo with what no object owns marked


class SceneDescription(Frozen):
    """The whole scene (paper, Scene Comprehension); ``background`` is the library name of what is around it, if any."""

    version: int = 1
    source: str
    image: str
    frame: TableFrame
    objects: tuple[SceneObject, ...]
    dropped: tuple[DroppedCandidate, ...] = ()
    warnings: tuple[str, ...] = ()
    background: str | None = None
    relations: tuple[Relation, ...] = ()
    twin: TwinReport | None = None
    # the photo's camera, whose pose is the frame's, and the table's colour (sRGB, 0..1) where the photo shows it; None
    # in descriptions of before there were any
    camera: Intrinsics | None = None
    table_color: tuple[Share, Share, Share] | None = None
    table_texture: TextureName | None = None  # library name of the photo's table, seen straight from above
    coverage: Coverage | None = None  # None in descriptions of before it was measured

    @property
    def instance_table(self) -> InstanceTable:
        """The table top that the photo shows."""
        if self.table_color is None:
            return InstanceTable()
        return InstanceTable(color=(*self.table_color, 1.0), texture=self.table_texture)

    def write(self, file: Path) -> None:
        """Write ``scene.json`` whole."""
        write_json(file, self.model_dump(mode="json"))


def read_scene_description(file: Path) -> SceneDescription:
    """Read ``scene.json``; raises InputError if it cannot be read or does not fit the schema."""
    try:
        return SceneDescription.model_validate(read_json(file, "make it with `grs scene`"))
    except ValidationError as error:
        raise InputError(f"{file}: {error.errors()[0]['msg']}", "make it again with `grs scene`") from error


X = (0.25, 0.75)
Y = (-0.5, 0.5)  # the table's part that tasks use (CLIPort's workspace), metres in the robot frame
NEAREST, FARTHEST = 0.22, 0.85
"""Distance from the base axis, metres: closer the arm would fold into itself, farther a UR5e does not reach."""


def is_reachable_position(position: Vec3) -> bool:
    """Whether something at ``position`` (metres, robot frame) can be picked from above."""
    x, y, _ = position
    return X[0] <= x <= X[1] and Y[0] <= y <= Y[1] and NEAREST <= (x * x + y * y) ** 0.5 <= FARTHEST
