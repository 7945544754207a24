"""Compiled worlds: a spec becomes a MuJoCo model, once for all poses of its objects, indexed by their ids."""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.hands.hand import Hand
from grs_agents.sim.hands.suction_cup import CUP, NARROW, Nozzle
from grs_agents.sim.hands.two_fingers import FINGERS, PADS, TwoFingerHand
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.task_instance import InstanceObject, InstanceTie
from grs_agents.sim.world.spec import (
    LARGEST_BEAD,
    TIMESTEP,
    Tool,
    WorldSpec,
    find_object_ids_in_point_ties,
    objects_to_spec,
)


@dataclass(frozen=True)
class FingerIndex:
    """Indices of the fingers of a hand, the left first: positions, speeds and controls follow those of the arm."""

    hand: TwoFingerHand
    positions: npt.NDArray[np.int_]  # (2,) in ``qpos``
    velocities: npt.NDArray[np.int_]  # (2,) in ``qvel``
    actuators: npt.NDArray[np.int_]  # (2,) in ``ctrl``
    pads: tuple[int, int]  # geoms


@dataclass(frozen=True)
class World:
    """A compiled model, its state, and the indices of the objects in it."""

    model: Any  # ``mujoco.MjModel``
    data: Any  # its one ``mujoco.MjData``
    bodies: dict[int, int]  # object id to body id
    welds: dict[int, int]  # id of a rigid object to the id of its suction weld
    addresses: dict[int, int]  # id of a rigid object to the start of its 7 positions in ``qpos``
    owners: tuple[int, ...]  # geom id to object id, -1 for the table and the robot
    cup_geom: int  # of the suction cup, or of the spatula that replaces it; -1 for a hand with fingers
    hand_body: int  # body at the flange: of the cup, or of the hand
    tip_site: int
    arm: Arm  # its joints are the first positions, speeds and controls
    # ids of objects in point ties, as in ropes: they hang freely from the cup
    limp: frozenset[int] = frozenset()
    # for each rigidly tied object the ids of its compound
    joined: Mapping[int, frozenset[int]] = field(default_factory=dict[int, frozenset[int]])
    beads: frozenset[int] = frozenset()  # limp objects so small that the cup always seals
    fingers: FingerIndex | None = None
    # facts of its objects alone, found once and shared by copies
    memory: dict[tuple[Any, ...], Any] = field(default_factory=dict[tuple[Any, ...], Any])
    small: frozenset[int] = frozenset()  # ids of objects without a face large enough for the cup's lip

    @property
    def first_free(self) -> int:
        """First position and speed of the free bodies, after those of the robot."""
        return self.arm.dof + (0 if self.fingers is None else len(FINGERS))

    @cached_property
    def owner_of_geom(self) -> npt.NDArray[np.int_]:
        """``owners`` as an array."""
        return np.asarray(self.owners)

    def nozzle_for_object(self, number: int) -> Nozzle:
        """The nozzle that picks an object."""
        return NARROW if number in self.small else CUP


def build_world(
    objects: Sequence[InstanceObject],
    library: Library,
    timestep: float = TIMESTEP,
    visuals: bool = False,
    ties: Sequence[InstanceTie] = (),
    tool: Tool = "suction",
    arm: Arm | None = None,
    background: str | None = None,
) -> World:
    """Compile a world, independent of the objects' poses: ``reset_world_to_poses`` sets them.

    Arguments and errors as ``objects_to_spec``; ``SimulationError`` also for a scene that MuJoCo refuses.
    """
    return compile_world(objects_to_spec(objects, library, timestep, visuals, ties, tool, arm, background))


def compile_world(made: WorldSpec) -> World:
    """Compile a spec and index it; errors as ``build_world``.

    The actuators integrate speed commands into joint targets (``data.act``), so that a command of several time steps
    moves the targets evenly. Targets that jumped from step to step would shake off a held object.
    """
    for actuator in made.spec.actuators:
        if actuator.name in FINGERS:  # they go to a width by themselves
            continue
        actuator.dyntype, actuator.actearly = mujoco.mjtDyn.mjDYN_INTEGRATOR, True
    try:
        model: Any = made.spec.compile()
    except ValueError as error:
        raise SimulationError(f"MuJoCo refuses the scene: {str(error)[:150]}", "change the object it names") from error
    models, limp = made.models, find_object_ids_in_point_ties(made.ties)
    joined: dict[int, frozenset[int]] = {}
    for tie in made.ties:
        if tie.kind == "fixed":
            whole = joined.get(tie.parent, frozenset({tie.parent})) | joined.get(tie.child, frozenset({tie.child}))
            joined |= dict.fromkeys(whole, whole)
    bodies = {number: int(model.body(f"object_{number}").id) for number in models}
    owner_of = {body: number for number, body in bodies.items()}
    return World(
        model=model,
        data=mujoco.MjData(model),
        bodies=bodies,
        welds={number: int(model.equality(f"suction_{number}").id) for number in made.graspable},
        addresses={number: int(model.joint(f"object_{number}").qposadr[0]) for number in made.free},
        owners=tuple(owner_of.get(int(body), -1) for body in model.geom_bodyid),
        cup_geom=int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "cup")),
        hand_body=int(model.body(made.arm.hand.body).id),
        tip_site=int(model.site("tip").id),
        arm=made.arm,
        fingers=_index_fingers(model, made.arm.hand),
        limp=limp,
        joined=joined,
        beads=frozenset(number for number in limp if max(models[number].size) <= LARGEST_BEAD),
        small=frozenset(number for number in set(made.graspable) - limp if CUP.is_wider_than(models[number].size)),
    )


def _index_fingers(model: Any, hand: Hand) -> FingerIndex | None:
    if not isinstance(hand, TwoFingerHand):
        return None
    joints = [model.joint(name) for name in FINGERS]
    left, right = (int(model.geom(name).id) for name in PADS)
    return FingerIndex(
        hand,
        np.array([int(joint.qposadr[0]) for joint in joints]),
        np.array([int(joint.dofadr[0]) for joint in joints]),
        np.array([int(model.actuator(name).id) for name in FINGERS]),
        (left, right),
    )


def copy_world(built: World) -> World:
    """A copy of a compiled world with a state of its own."""
    model = copy.copy(built.model)
    return replace(built, model=model, data=mujoco.MjData(model))


def reset_world_to_poses(built: World, objects: Sequence[InstanceObject]) -> None:
    """Reset a world with the objects it was built from at their poses, at rest."""
    # Fixed bodies are placed first: MuJoCo computes their poses once, when a state begins.
    for item in objects:
        if item.id not in built.addresses:
            (position, (x, y, z, w)), body = item.pose, built.bodies[item.id]
            built.model.body_pos[body], built.model.body_quat[body] = position, (w, x, y, z)
    mujoco.mj_resetData(built.model, built.data)
    for item in objects:
        if item.id in built.addresses:
            (position, (x, y, z, w)), start = item.pose, built.addresses[item.id]
            built.data.qpos[start : start + 7] = (*position, w, x, y, z)


def compute_arm_spheres_at_home(robot: str, hand: str, library: Library) -> npt.NDArray[np.float64]:
    """Spheres (N, 4) around each part of an arm with its hand at its home: centre and radius, metres, robot frame.

    Raises ``InputError`` for a file that cannot be read or holds no arm.
    """
    arm = get_arm(robot, hand)
    built = build_world((), library, arm=arm)
    built.data.qpos[: arm.dof] = arm.home_joints
    mujoco.mj_forward(built.model, built.data)
    arm_geoms = built.model.geom_bodyid > 0
    return np.column_stack([built.data.geom_xpos[arm_geoms], built.model.geom_rbound[arm_geoms]])
