"""A task as data: the scene and goals of a simulation program, as typed JSON that trusted code can run.

Instances from untrusted files and processes are bounded, then parsed, then checked.
"""

import hashlib
import json
import math
from pathlib import PurePath
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, ValidationError, model_serializer, model_validator

from grs_agents.base import Frozen, Pose, Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import check_json_limits
from grs_agents.base.geometry import transforms
from grs_agents.sim.hands.hand import DEFAULT_HAND
from grs_agents.sim.instance.faults import describe_first_error
from grs_agents.sim.instance.goal import Goal, Placed, Unit, check_unit_quaternion

Primitive = Literal["pick_place", "push"]
"""Action of the end effector; `grs_agents.sim.end_effectors` has the end effector of each."""
POSITION_TOLERANCE = 0.01
ROTATION_TOLERANCE = math.radians(15)
LARGEST_POS_EPS, LARGEST_ROT_EPS = 0.05, math.radians(30)
"""Widest tolerances of published tasks: CLIPort's bowls, and its easy kits."""
LARGEST_VALUE = 2.0
"""Largest value of a template's placeholder: metres, or a share of a colour."""
LARGEST_TIE_GAP = 0.05
"""Metres between the two places that a tie joins: it holds objects together, it does not pull them there."""
MOST_STEPS = 200
"""Actions of an episode."""
MOST_PAIRS = 10_000
"""Pairs of an object and a target over all goals."""

LIGHTEST, HEAVIEST = 0.001, 20.0
"""Bounds of a mass that the instance gives, kilograms."""
LEAST_FRICTION, MOST_FRICTION = 0.05, 2.0
"""Coefficients of sliding friction: ice on steel, rubber on rubber."""
LONGEST_NAME, LONGEST_INSTRUCTION = 100, 4000
"""Characters of an object's name, and of the sentence that a task comes to."""
WIDEST_PICTURE = 65_536
"""Pixels of a camera's side."""
FARTHEST_VIEW = 100.0
"""Metres along any axis from the robot base to cameras and lights."""

Channel = Annotated[float, Field(allow_inf_nan=False, ge=0, le=1)]
RGBA = tuple[Channel, Channel, Channel, Channel]
Value = (
    Annotated[float, Field(allow_inf_nan=False, ge=-LARGEST_VALUE, le=LARGEST_VALUE)]
    | Annotated[str, Field(max_length=300)]
)
Fill = dict[Annotated[str, Field(max_length=20)], Annotated[tuple[Value, ...], Field(max_length=4)]]
"""Values of a template's placeholders by stem, e.g. ``{"DIM": (0.2, 0.1, 0.05)}``: metres, colours 0..1, file names."""


_Far = Annotated[float, Field(allow_inf_nan=False, ge=-FARTHEST_VIEW, le=FARTHEST_VIEW)]
FarPoint = tuple[_Far, _Far, _Far]


class InstanceObject(Frozen):
    """An object of the scene."""

    id: Annotated[int, Field(ge=0, le=100_000)]
    asset: Annotated[str, Field(min_length=1, max_length=300)]  # library-relative URDF name, e.g. "HOPE/Milk.urdf"
    # values of a template's placeholders; empty for an ordinary asset
    fill: Annotated[Fill, Field(max_length=12)] = Field(default_factory=dict)
    pose: Placed  # of its origin, metres, robot frame, before settling
    # ``fixed`` cannot move; ``deformable`` moves as ``rigid`` does
    category: Literal["fixed", "rigid", "deformable"] = "rigid"
    color: RGBA | None = None  # 0..1, laid over the asset's own
    # a ``bystander`` stands there because the photo shows it: solid, named by no goal, to end where it began
    role: Literal["task", "bystander"] = "task"
    # kilograms, and the coefficient of sliding friction; None: the asset's own. Trusted code sets both of every object
    mass: Annotated[float, Field(allow_inf_nan=False, ge=LIGHTEST, le=HEAVIEST)] | None = None
    friction: Annotated[float, Field(allow_inf_nan=False, ge=LEAST_FRICTION, le=MOST_FRICTION)] | None = None
    # set by trusted code: its everyday name, which equal objects share, and true for an object that the photo lacks
    name: Annotated[str, Field(max_length=LONGEST_NAME)] = ""
    added: bool = False

    @model_serializer(mode="wrap")
    def _leave_out_no_name(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Keep the JSON, and the hash, of an instance without names as before names existed."""
        fields: dict[str, Any] = serialize(self)
        return {key: value for key, value in fields.items() if value or key not in ("name", "added")}

    @model_validator(mode="after")
    def _check_pose_and_fill(self) -> Self:
        check_unit_quaternion(self.pose, f"object {self.id}")
        if self.fill:
            words = {stem for stem, row in self.fill.items() if any(isinstance(value, str) for value in row)}
            if listed := sorted(words - {"FNAME"}):
                raise ValueError(f"object {self.id}: fill of {listed} must be numbers, FNAME alone takes a word")
        return self


class InstanceTie(Frozen):
    """A constraint between two objects: a shared point (a joint of a rope), or a fixed relative pose."""

    kind: Literal["point", "fixed"]  # ``point`` leaves them free to turn
    parent: int
    child: int
    parent_frame: Placed  # shared frame relative to the parent, metres
    child_frame: Placed  # and to the child

    @model_validator(mode="after")
    def _check_distinct_objects(self) -> Self:
        if self.parent == self.child:
            raise ValueError(f"object {self.parent} is tied to itself, a tie needs two")
        return self


class InstanceCamera(Frozen):
    """The photo's camera: a pinhole without distortion, OpenCV axes (x right, y down, z along the optical axis)."""

    width: Annotated[int, Field(ge=1, le=WIDEST_PICTURE)]  # pixels
    height: Annotated[int, Field(ge=1, le=WIDEST_PICTURE)]
    fx: Annotated[float, Field(allow_inf_nan=False, gt=0, le=1e6)]  # fx, fy, cx, cy: pixels
    fy: Annotated[float, Field(allow_inf_nan=False, gt=0, le=1e6)]
    cx: Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e6)]
    cy: Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e6)]
    pose: tuple[FarPoint, tuple[Unit, Unit, Unit, Unit]]  # in the robot frame, metres
    robot_placed: bool = False  # the robot stands where we put it, not where the photo was taken: it may hide the view

    @model_validator(mode="after")
    def _check_rotation(self) -> Self:
        check_unit_quaternion(self.pose, "the camera")
        return self


class InstanceLight(Frozen):
    """A lamp above the table, and ambient light."""

    position: FarPoint = (0.3, -0.5, 2.0)  # metres, robot frame
    target: FarPoint = (0.3, -0.1, 0.0)  # point it shines at
    diffuse: tuple[Channel, Channel, Channel] = (0.7, 0.7, 0.7)
    ambient: tuple[Channel, Channel, Channel] = (0.35, 0.35, 0.35)


TextureName = Annotated[str, Field(max_length=300, pattern=r"^[\w-]+(/[\w-]+)*\.png$")]


class InstanceTable(Frozen):
    """Looks of the table top: plain, a pattern of two colours (sRGB, 0..1), or a texture."""

    color: RGBA = (0.80, 0.72, 0.60, 1.0)
    pattern: Literal["plain", "checker", "speckled"] = "plain"
    second_color: RGBA = (0.70, 0.62, 0.50, 1.0)
    texture: TextureName | None = None  # library name of a square PNG, stretched over the top; it hides the colours

    @model_serializer(mode="wrap")
    def _leave_out_no_texture(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Keep the JSON, and the hash, of an instance without a texture as before textures existed."""
        fields: dict[str, Any] = serialize(self)
        return {key: value for key, value in fields.items() if key != "texture" or value is not None}


class TaskInstance(Frozen):
    """A simulated task for a seed: all that a trusted process needs to build, run and score it."""

    version: Literal[4] = 4
    task: Annotated[str, Field(max_length=200)]  # class name of the program it came from
    seed: Annotated[int, Field(ge=0, lt=2**32)]
    max_steps: Annotated[int, Field(ge=1, le=MOST_STEPS)]
    timestep: Annotated[float, Field(ge=0.0005, le=0.01)]  # of the physics, seconds
    hz: Annotated[int, Field(ge=1, le=100_000)] = 240  # that the program asked for; recorded, not used
    primitive: Primitive = "pick_place"
    sixdof: bool = False
    pos_eps: Annotated[float, Field(gt=0, le=LARGEST_POS_EPS)] = POSITION_TOLERANCE  # of ``pose`` goals, metres
    rot_eps: Annotated[float, Field(gt=0, le=LARGEST_ROT_EPS)] = ROTATION_TOLERANCE  # radians
    objects: Annotated[tuple[InstanceObject, ...], Field(max_length=200)]
    ties: Annotated[tuple[InstanceTie, ...], Field(max_length=400)] = ()
    goals: Annotated[tuple[Goal, ...], Field(max_length=200)]
    # library name of the fixed surroundings of the robot, as photographed; set by trusted code
    background: Annotated[str, Field(min_length=1, max_length=300)] | None = None
    # set by trusted code: the arm ("ur5e", "panda" or the path of an MJCF file, in a saved instance relative to its
    # folder), the photo's camera (None without a photo), the light, and the table in the colour of the photo
    robot: Annotated[str, Field(min_length=1, max_length=4096)] = "ur5e"
    # set by trusted code: the hand at its flange ("suction", "franka_hand", "robotiq_2f85"); the JSON leaves out the
    # suction cup, which instances without the field have
    hand: Annotated[str, Field(min_length=1, max_length=100, exclude_if=DEFAULT_HAND.__eq__)] = DEFAULT_HAND
    camera: InstanceCamera | None = None
    light: InstanceLight = InstanceLight()
    table: InstanceTable = InstanceTable()
    # the sentence that GRS makes of the goals; set by trusted code once the audit has accepted them
    instruction: Annotated[str, Field(max_length=LONGEST_INSTRUCTION)] = ""
    # assumptions of the runtime
    warnings: Annotated[tuple[Annotated[str, Field(max_length=500)], ...], Field(max_length=500)] = ()

    @property
    def mounted_hand(self) -> str:
        """Hand that the arm carries: pushing takes the suction cup's mount, with the spatula on it."""
        return DEFAULT_HAND if self.primitive == "push" else self.hand

    @property
    def task_objects(self) -> tuple[InstanceObject, ...]:
        """Every object but the bystanders."""
        return tuple(item for item in self.objects if item.role == "task")

    @property
    def language(self) -> str:
        """The whole task in words: the sentence of GRS; without an audit those of the program for its goals."""
        by_program = ", then ".join(dict.fromkeys(goal.language for goal in self.goals if goal.language))
        return self.instruction or by_program or self.task

    @model_serializer(mode="wrap")
    def _leave_out_no_instruction(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Keep the JSON, and the hash, of an instance without an instruction as before instructions existed."""
        fields: dict[str, Any] = serialize(self)
        return {key: value for key, value in fields.items() if key != "instruction" or value}

    @model_validator(mode="after")
    def _check_ids_pairs_and_ties(self) -> Self:
        ids = {item.id for item in self.objects}
        if len(ids) != len(self.objects):
            raise ValueError("object ids must differ")
        bystanders = {item.id for item in self.objects if item.role == "bystander"}
        named = {number for goal in self.goals for number in goal.mentioned_object_ids}
        if unknown := named - ids:
            raise ValueError(f"goals name objects {sorted(unknown)} that the instance does not have")
        if named & bystanders:
            raise ValueError(f"goals name objects {sorted(named & bystanders)}, which are bystanders and must stay")
        if unknown := {number for tie in self.ties for number in (tie.parent, tie.child)} - ids:
            raise ValueError(f"ties name objects {sorted(unknown)} that the instance does not have")
        pairs = sum(len(goal.objects) * max(1, len(goal.targets)) for goal in self.goals)
        if pairs > MOST_PAIRS:
            raise ValueError(
                f"the goals pair objects with targets {pairs} times, at most {MOST_PAIRS} times are allowed"
            )
        poses = {item.id: item.pose for item in self.objects}
        for tie in self.ties:
            places = (
                _point_in_robot_frame(poses[tie.parent], tie.parent_frame[0]),
                _point_in_robot_frame(poses[tie.child], tie.child_frame[0]),
            )
            if (gap := math.dist(*places)) > LARGEST_TIE_GAP:
                raise ValueError(
                    f"the tie of objects {tie.parent} and {tie.child} joins places {gap:.2f} m apart, at most "
                    f"{LARGEST_TIE_GAP} m: place the objects as they are tied"
                )
        return self


def _point_in_robot_frame(pose: Pose, point: Vec3) -> Vec3:
    """A point of an object's frame in the robot frame, metres."""
    return transforms.to_vec3(transforms.transform_points(pose, np.reshape(point, (3, 1))).ravel())


MAX_BYTES: Final = 4 << 20
"""Largest text of an instance: 200 objects with goals for all of them take a tenth of it."""


class InstanceError(InputError):
    """A text that is no valid task instance."""


def parse_instance_json(text: str | bytes, objects: int = 200) -> TaskInstance:
    """Parse a task instance from JSON; raises ``InstanceError``, which names the fault."""
    data = text.encode("utf-8", "surrogatepass") if isinstance(text, str) else text
    if len(data) > MAX_BYTES:
        raise InstanceError(f"the instance has {len(data)} bytes, {MAX_BYTES} are the most", "make it smaller")
    try:
        check_json_limits(data, "the instance")
    except InputError as error:
        raise InstanceError(error.message, "write fewer values, less deep") from error
    try:
        json.loads(data, parse_constant=_refuse_nan_and_infinity, object_pairs_hook=_refuse_duplicate_keys)
        instance = TaskInstance.model_validate_json(data, strict=True)
    except ValidationError as error:
        raise InstanceError(describe_first_error(error, data=json.loads(data)), "correct the value") from error
    except (ValueError, RecursionError) as error:
        raise InstanceError(f"the instance is not plain JSON: {str(error)[:200]}", "write JSON") from error
    if len(instance.objects) > objects:
        raise InstanceError(
            f"objects: the instance has {len(instance.objects)}, {objects} are the most (limits.objects)",
            "add fewer objects",
        )
    return instance


def hash_instance(instance: TaskInstance) -> str:
    """SHA-256 of the instance's JSON, hexadecimal: the name of an episode's initial scene in data sets.

    It is independent of the folder of an arm's file.
    """
    named = instance.model_copy(update={"robot": PurePath(instance.robot).name})
    return hashlib.sha256(named.model_dump_json().encode()).hexdigest()


def _refuse_nan_and_infinity(name: str) -> float:
    raise ValueError(f"{name} is not JSON")


def _refuse_duplicate_keys(pairs: list[tuple[str, object]]) -> dict[str, object]:
    entries = dict(pairs)
    if len(entries) < len(pairs):
        raise ValueError(f"an object names a key twice: {', '.join(key for key, _ in pairs)[:100]}")
    return entries
