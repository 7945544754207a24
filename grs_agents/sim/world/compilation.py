"""A world's spec is compiled, once for all poses of its objects, and indexed by their ids."""

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
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.task_instance import InstanceObject, InstanceTie
from grs_agents.sim.world.nozzles import CUP, NARROW, Nozzle
from grs_agents.sim.world.spec import (
    LARGEST_BEAD,
    TIMESTEP,
    Tool,
    WorldSpec,
    find_object_ids_in_point_ties,
    objects_to_spec,
)


@dataclass(frozen=True)
class World:
    """A compiled model, its state, and where the objects are in it."""

    model: Any  # ``mujoco.MjModel``
    data: Any  # its one ``mujoco.MjData``
    bodies: dict[int, int]  # object id to body id
    welds: dict[int, int]  # id of a rigid object to the id of its suction weld
    addresses: dict[int, int]  # id of a rigid object to the start of its 7 positions in ``qpos``
    owners: tuple[int, ...]  # geom id to object id, -1 for the table and the robot
    cup_geom: int  # of the suction cup, or of the spatula in its place
    cup_body: int
    tip_site: int
    arm: Arm  # its joints are the first positions, speeds and controls
    # ids of what a point ties to another, as ropes: it gives way to the cup, and hangs freely
    limp: frozenset[int] = frozenset()
    joined: Mapping[int, frozenset[int]] = field(default_factory=dict[int, frozenset[int]])  # ids of rigid compounds
    beads: frozenset[int] = frozenset()  # those of them that are so small that the cup always seals
    small: frozenset[int] = frozenset()  # ids of what has no face on which the cup's lip finds room

    @cached_property
    def owner_of_geom(self) -> npt.NDArray[np.int_]:
        """``owners`` as an array."""
        return np.asarray(self.owners)

    def nozzle_for_object(self, number: int) -> Nozzle:
        """The nozzle with which an object is picked."""
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
    """Compile a world. It does not depend on where the objects stand: ``reset_world_to_poses`` sets that.

    Arguments and errors as ``objects_to_spec``; ``SimulationError`` also for a scene that MuJoCo takes for impossible.
    """
    return compile_world(objects_to_spec(objects, library, timestep, visuals, ties, tool, arm, background))


def _group_rigidly_tied_objects(ties: Sequence[InstanceTie]) -> dict[int, frozenset[int]]:
    """For each object that a tie fixes to another all objects that move as one with it, itself among them."""
    groups: dict[int, frozenset[int]] = {}
    for tie in ties:
        if tie.kind == "fixed":
            whole = groups.get(tie.parent, frozenset({tie.parent})) | groups.get(tie.child, frozenset({tie.child}))
            groups |= dict.fromkeys(whole, whole)
    return groups


def compile_world(made: WorldSpec) -> World:
    """The compiled world with the places of everything in it; errors as ``build_world``.

    Its arm is told how fast the joint positions that it is to keep change: they are ``data.act``, and a command of
    several time steps leads through them evenly. One that jumped from step to step would shake off what is held.
    """
    for actuator in made.spec.actuators:
        actuator.dyntype, actuator.actearly = mujoco.mjtDyn.mjDYN_INTEGRATOR, True
    model, models, ties = _compile_spec(made.spec), made.models, made.ties
    limp = find_object_ids_in_point_ties(ties)
    bodies = {number: int(model.body(f"object_{number}").id) for number in models}
    owner_of = {body: number for number, body in bodies.items()}
    return World(
        model=model,
        data=mujoco.MjData(model),
        bodies=bodies,
        welds={number: int(model.equality(f"suction_{number}").id) for number in made.graspable},
        addresses={number: int(model.joint(f"object_{number}").qposadr[0]) for number in made.free},
        owners=tuple(owner_of.get(int(body), -1) for body in model.geom_bodyid),
        cup_geom=int(model.geom("cup").id),
        cup_body=int(model.body("cup").id),
        tip_site=int(model.site("tip").id),
        arm=made.arm,
        limp=limp,
        joined=_group_rigidly_tied_objects(ties),
        beads=frozenset(number for number in limp if max(models[number].size) <= LARGEST_BEAD),
        small=frozenset(number for number in set(made.graspable) - limp if CUP.is_wider_than(models[number].size)),
    )


def copy_world(built: World) -> World:
    """A world of its own, as it was compiled."""
    model = copy.copy(built.model)
    return replace(built, model=model, data=mujoco.MjData(model))


def _compile_spec(spec: Any) -> Any:
    try:
        return spec.compile()
    except ValueError as error:
        raise SimulationError(f"MuJoCo refuses the scene: {str(error)[:150]}", "change the object it names") from error


def reset_world_to_poses(built: World, objects: Sequence[InstanceObject]) -> None:
    """Set a world back to its beginning, with the objects it was built from at their poses, at rest."""
    # What cannot move is placed first: a state works out once, when it begins, where such bodies are.
    for item in objects:
        if item.id not in built.addresses:
            (position, (x, y, z, w)), body = item.pose, built.bodies[item.id]
            built.model.body_pos[body], built.model.body_quat[body] = position, (w, x, y, z)
    mujoco.mj_resetData(built.model, built.data)
    for item in objects:
        if item.id in built.addresses:
            (position, (x, y, z, w)), start = item.pose, built.addresses[item.id]
            built.data.qpos[start : start + 7] = (*position, w, x, y, z)


def compute_arm_spheres_at_home(robot: str, library: Library) -> npt.NDArray[np.float64]:
    """(N, 4) spheres, centre and radius (m, robot frame), around each part of an arm at its home position.
    Raises ``InputError`` where the arm's file cannot be read or holds no arm."""
    arm = get_arm(robot)
    built = build_world((), library, arm=arm)
    built.data.qpos[: arm.dof] = arm.home_joints
    mujoco.mj_forward(built.model, built.data)
    mine = built.model.geom_bodyid > 0
    return np.column_stack([built.data.geom_xpos[mine], built.model.geom_rbound[mine]])
