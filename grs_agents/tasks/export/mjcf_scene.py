"""A task instance as a MuJoCo spec for export: settled start, goals as sites, the photo's camera, suction."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from grs_agents.base import Pose, Quat, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.sim.hands.suction_cup import CUP_RADIUS
from grs_agents.sim.hands.two_fingers import FINGERS
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.tabletop_episode import open_instance_episode
from grs_agents.sim.world.spec import WorldSpec, instance_to_spec
from grs_agents.sim.world.suction import HOLDING_FORCE

_BEYOND: Final = 0.25
"""Margin of commands beyond the joints' limits (rad or m): commands of a fast arm lead its position."""
_LIP, _BALLS, _DRAWN_BACK = 0.002, 8, 0.003
"""Portable cup: radius of the lip's balls (m), their number, and the offset of the core behind them (m)."""
_GOAL_GROUP: Final = 1
_TARGET, _ZONE, _RELATION = (0.9, 0.2, 0.2, 0.6), (0.1, 0.8, 0.1, 0.25), (0.2, 0.4, 0.9, 0.2)
_THIN: Final = 0.001
_PIXEL: Final = 1e-5
"""Size of a pixel on the camera's sensor, metres; it cancels out."""
_FLIP: Final[Quat] = (1.0, 0.0, 0.0, 0.0)
"""Rotation from OpenCV's camera axes to MuJoCo's: half a turn about x."""


@dataclass(frozen=True)
class GoalSite:
    """A site at the place of a goal."""

    name: str
    goal: int  # index of the goal
    shows: str  # its meaning in words


@dataclass(frozen=True)
class MjcfScene:
    """The trusted world's spec with the additions of an export."""

    instance: TaskInstance
    world: WorldSpec
    portable: bool
    warp: bool
    sites: tuple[GoalSite, ...]

    @property
    def spec(self) -> Any:
        """The ``mujoco.MjSpec``; its files are still those of the library."""
        return self.world.spec


def build_mjcf_scene(instance: TaskInstance, library: Library, portable: bool, warp: bool = False) -> MjcfScene:
    """The scene of an instance.

    Args:
        instance: the instance.
        library: has its assets.
        portable: for MuJoCo 3.3 too: without sleep, and with an adhesion actuator instead of the suction welds.
        warp: for MuJoCo Warp too: portable, with a sparse Jacobian.

    Raises:
        SimulationError: the scene cannot be set up, or does not come to rest.
    """
    world = instance_to_spec(instance, library, visuals=True)
    world.spec.modelname = re.sub(r"\W", "_", world.spec.modelname) or "scene"
    for actuator in world.spec.actuators:  # ranges, so that a viewer has a slider for each joint
        if actuator.name in FINGERS:  # of their data sheet
            continue
        low, high = (float(bound) for bound in world.spec.joint(actuator.target).range)
        actuator.ctrlrange, actuator.ctrllimited = (low - _BEYOND, high + _BEYOND), True
    if portable or warp:
        _adapt_spec_to_mujoco_3_3(world)
    if warp:  # which refuses a dense one above 60 degrees of freedom
        world.spec.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    sites = _add_goal_sites(instance, world)
    if instance.camera is not None:
        position, rotation = instance.camera.pose
        x, y, z, w = transforms.multiply_quaternions(rotation, _FLIP)
        width, height = instance.camera.width, instance.camera.height
        photo = world.spec.worldbody.add_camera(name="photo", pos=position, quat=(w, x, y, z))
        photo.resolution, photo.sensor_size = (width, height), (width * _PIXEL, height * _PIXEL)
        photo.focal_pixel = (instance.camera.fx, instance.camera.fy)
        # Pixels are counted at their centres; MuJoCo takes the offset of the picture's middle from the optical axis.
        photo.principal_pixel = ((width - 1) / 2 - instance.camera.cx, (height - 1) / 2 - instance.camera.cy)
        offscreen = world.spec.visual.global_
        offscreen.offwidth, offscreen.offheight = max(width, offscreen.offwidth), max(height, offscreen.offheight)
    kind, gradient = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    above, below = (0.93, 0.95, 0.97), (0.75, 0.79, 0.84)
    world.spec.add_texture(name="sky", type=kind, builtin=gradient, rgb1=above, rgb2=below, width=64, height=384)
    world.spec.stat.center, world.spec.stat.extent = (0.45, 0.0, 0.1), 0.9  # first view of a viewer
    world.spec.visual.global_.azimuth, world.spec.visual.global_.elevation = 150.0, -30.0
    # Keyframe ``start``: the settled state of the trusted simulation, the arm at home.
    episode = open_instance_episode(instance, library)
    episode.reset()
    physics, dof = episode.sim.physics, world.arm.dof
    addresses = [physics.world.addresses[episode.task.ids[number]] for number in world.free]
    places = [physics.data.qpos[start : start + 7] for start in addresses]
    free = physics.world.first_free
    speeds = [physics.data.qvel[free + (start - free) // 7 * 6 :][:6] for start in addresses]
    home = np.concatenate([world.arm.home_joints, physics.robot_positions[dof:]])  # the fingers wide open
    start = world.spec.add_key(name="start")
    start.qpos, start.qvel = np.concatenate([home, *places]), np.concatenate([np.zeros(free), *speeds])
    start.ctrl = np.concatenate([home, np.zeros(len(list(world.spec.actuators)) - free)])
    return MjcfScene(instance, world, portable or warp, warp, sites)


def _adapt_spec_to_mujoco_3_3(world: WorldSpec) -> None:
    """Remove elements that MuJoCo 3.3 does not read, and hold objects by adhesion."""
    spec = world.spec
    spec.option.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    spec.option.sleep_tolerance = mujoco.MjSpec().option.sleep_tolerance  # the default is not written
    for actuator in spec.actuators:
        actuator.ctrlspec = 0  # MuJoCo 3.3 does not know the word for the command's meaning
    for joint in spec.joints:
        joint.damping[1:] = joint.stiffness[1:] = 0.0  # nor terms of the square and the cube
    for number in world.graspable:
        spec.delete(spec.equality(f"suction_{number}"))
    if world.graspable:
        # Adhesion is steady if its contacts lie apart; those of a cylinder may all be at one side: a ring of balls
        # collides in place of the cup's cylinder, with a core drawn back behind them.
        cup, body, tip = spec.geom("cup"), spec.body("cup"), float(spec.site("tip").pos[2])
        shared = {"contype": cup.contype, "conaffinity": cup.conaffinity, "group": 3, "mass": 0.0}
        length = 2 * float(cup.size[1]) - _DRAWN_BACK
        body.add_geom(
            name="cup_core",
            type=cup.type,
            size=(CUP_RADIUS, length / 2, 0),
            pos=(0, 0, tip - _DRAWN_BACK - length / 2),
            **shared,
        )
        ball, ring = mujoco.mjtGeom.mjGEOM_SPHERE, CUP_RADIUS - _LIP
        for index, angle in enumerate(np.arange(_BALLS) * (2 * np.pi / _BALLS)):
            place = (ring * float(np.cos(angle)), ring * float(np.sin(angle)), tip - _LIP)
            body.add_geom(name=f"cup_lip_{index}", type=ball, size=(_LIP, 0, 0), pos=place, **shared)
        cup.contype = cup.conaffinity = 0
        suction = spec.add_actuator(name="suction", target="cup", trntype=mujoco.mjtTrn.mjTRN_BODY)
        suction.set_to_adhesion(gain=HOLDING_FORCE)
        suction.ctrlspec, suction.ctrlrange, suction.ctrllimited = 0, (0.0, 1.0), True


def _add_goal_sites(instance: TaskInstance, world: WorldSpec) -> tuple[GoalSite, ...]:
    """Add the sites of all goals, in the goals' order."""
    sites: list[GoalSite] = []
    for index, goal in enumerate(instance.goals):
        for number, target in enumerate(goal.targets if goal.metric == "pose" else ()):
            name = f"goal_{index}_target_{number}"
            _add_site(world.spec.worldbody, name, target, (0.01, 0.01, 0.01), _TARGET)
            sites.append(GoalSite(name, index, "a pose that an object's origin is to have"))
        for number, zone in enumerate(goal.zones if goal.metric == "zone" else ()):
            name = f"goal_{index}_zone_{number}"
            x, y, z = zone.size
            bottom = transforms.compose_poses(zone.pose, ((0.0, 0.0, -z / 2), (0.0, 0.0, 0.0, 1.0)))  # z is not scored
            _add_site(world.spec.worldbody, name, bottom, (x / 2, y / 2, _THIN), _ZONE)
            sites.append(GoalSite(name, index, "a zone that objects are to lie in"))
        kind = goal.relation_kind
        if kind in (None, "aligned", "upright"):
            continue
        # A typed goal with a place: the site is fixed to the goal's reference object.
        number = goal.objects[0] if kind == "stacked" else goal.reference_id
        model = world.models[number]
        low, high = np.asarray(model.bounds[0]), np.asarray(model.bounds[1])
        if kind in ("on", "stacked"):
            low[2] = high[2]
        elif kind == "near":
            reach = np.array([1.0, 1.0, 0.0]) * (goal.required_distance or 0.0)
            low, high = low - reach, high + reach
        center, half = transforms.to_vec3((low + high) / 2), transforms.to_vec3(np.maximum((high - low) / 2, _THIN))
        name = f"goal_{index}_{kind}"
        _add_site(world.spec.body(f"object_{number}"), name, (center, (0.0, 0.0, 0.0, 1.0)), half, _RELATION)
        shows = f"the place {kind} object_{number}" if kind != "stacked" else "the top of the lowest"
        sites.append(GoalSite(name, index, shows))
    _add_goal_tuples(instance, world.spec, sites)
    return tuple(sites)


def _add_goal_tuples(instance: TaskInstance, spec: Any, sites: Sequence[GoalSite]) -> None:
    """Add a tuple for each object that a goal places: its body and the sites of the places that the goal allows it."""
    for index, goal in enumerate(instance.goals):
        for row, number in enumerate(goal.objects):
            barred = {f"goal_{index}_target_{k}" for k, match in enumerate(goal.matches[row]) if not match}
            names = [site.name for site in sites if site.goal == index and site.name not in barred]
            if names and not (goal.relation_kind == "stacked" and row == 0):  # the lowest stays where it is
                kinds = [mujoco.mjtObj.mjOBJ_BODY, *[mujoco.mjtObj.mjOBJ_SITE] * len(names)]
                places = spec.add_tuple(name=f"goal_{index}_places_{row}")
                places.objtype, places.objname = kinds, [f"object_{number}", *names]
                places.objprm = [0.0] * len(kinds)


def _add_site(body: Any, name: str, pose: Pose, half: Vec3, rgba: tuple[float, ...]) -> None:
    position, (x, y, z, w) = pose
    box = mujoco.mjtGeom.mjGEOM_BOX
    body.add_site(name=name, type=box, pos=position, quat=(w, x, y, z), size=half, rgba=rgba, group=_GOAL_GROUP)
