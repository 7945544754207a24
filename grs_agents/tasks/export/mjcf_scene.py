"""A task instance as a MuJoCo spec that others can use: settled start, goals as sites, the photo's camera, suction."""

import re
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from grs_agents.base import Pose, Quat, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.library.shapes import ObjectModel
from grs_agents.sim.arms.arm_parts import CUP_RADIUS
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import InstanceCamera, TaskInstance
from grs_agents.sim.rollouts import InstanceTask
from grs_agents.sim.world.spec import WorldSpec, instance_to_spec
from grs_agents.sim.world.suction import HOLDING_FORCE

_BEYOND: Final = 0.25
"""How far (rad or m) commands may lead the joints' limits: what makes a fast arm keep up is commanded ahead of it."""
_LIP, _BALLS, _DRAWN_BACK = 0.002, 8, 0.003
"""Of the portable cup: radius of the balls of its lip (m), how many there are, how far back (m) its core is."""
_GOAL_GROUP: Final = 1
_TARGET, _ZONE, _RELATION = (0.9, 0.2, 0.2, 0.6), (0.1, 0.8, 0.1, 0.25), (0.2, 0.4, 0.9, 0.2)
_THIN: Final = 0.001
_PIXEL: Final = 1e-5
"""Metres of a pixel on the camera's sensor: any length serves, since it cancels out."""
_FLIP: Final[Quat] = (1.0, 0.0, 0.0, 0.0)
"""From OpenCV's axes of a camera to MuJoCo's: half a turn about x."""


@dataclass(frozen=True)
class GoalSite:
    """A site that shows where a goal wants things."""

    name: str
    goal: int  # index of the goal
    shows: str  # what it shows, in words


@dataclass(frozen=True)
class MjcfScene:
    """A spec with all that an export adds to the trusted world."""

    instance: TaskInstance
    made: WorldSpec
    portable: bool
    sites: tuple[GoalSite, ...]

    @property
    def spec(self) -> Any:
        """The ``mujoco.MjSpec``; its files are still where the library has them."""
        return self.made.spec


def build_mjcf_scene(instance: TaskInstance, library: Library, portable: bool) -> MjcfScene:
    """The scene of an instance.

    Args:
        instance: the instance.
        library: has its assets.
        portable: for MuJoCo 3.3 too: without sleep, and with an adhesion actuator in the place of the suction welds.

    Raises:
        SimulationError: the scene cannot be set up, or does not come to rest.
    """
    made = instance_to_spec(instance, library, visuals=True)
    made.spec.modelname = re.sub(r"\W", "_", made.spec.modelname) or "scene"
    _set_actuator_ranges(made)
    if portable:
        _adapt_spec_to_mujoco_3_3(made)
    sites = _add_goal_sites(instance, made)
    if instance.camera is not None:
        _add_photo_camera(made.spec, instance.camera)
    _add_sky_and_viewpoint(made.spec)
    _add_start_keyframe(instance, library, made)
    return MjcfScene(instance, made, portable, sites)


def _set_actuator_ranges(made: WorldSpec) -> None:
    """Give each joint's actuator a range, so that a viewer's slider has one."""
    for actuator in made.spec.actuators:
        low, high = (float(bound) for bound in made.spec.joint(actuator.target).range)
        actuator.ctrlrange, actuator.ctrllimited = (low - _BEYOND, high + _BEYOND), True


def _adapt_spec_to_mujoco_3_3(made: WorldSpec) -> None:
    """Leave out what MuJoCo 3.3 does not read, and hold objects by adhesion."""
    spec = made.spec
    spec.option.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    spec.option.sleep_tolerance = mujoco.MjSpec().option.sleep_tolerance  # as it is by default, it is not written
    for actuator in spec.actuators:
        actuator.ctrlspec = 0  # what the command means is a word that MuJoCo 3.3 does not know
    for joint in spec.joints:
        joint.damping[1:] = joint.stiffness[1:] = 0.0  # nor of what grows with the square and the cube
    for number in made.graspable:
        spec.delete(spec.equality(f"suction_{number}"))
    if made.graspable:
        _replace_cup_by_contact_ring(spec)
        suction = spec.add_actuator(name="suction", target="cup", trntype=mujoco.mjtTrn.mjTRN_BODY)
        suction.set_to_adhesion(gain=HOLDING_FORCE)
        suction.ctrlspec, suction.ctrlrange, suction.ctrllimited = 0, (0.0, 1.0), True


def _replace_cup_by_contact_ring(spec: Any) -> None:
    """Have a ring of balls and a drawn-back core touch in the place of the cup's cylinder, which is seen and weighs as
    before: adhesion holds as steadily as its contacts lie apart, and those of a cylinder may all be at one side."""
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


def _add_goal_sites(instance: TaskInstance, made: WorldSpec) -> tuple[GoalSite, ...]:
    """Add the sites of all goals, in the goals' order."""
    sites: list[GoalSite] = []
    for index, goal in enumerate(instance.goals):
        for number, target in enumerate(goal.targets if goal.metric == "pose" else ()):
            name = f"goal_{index}_target_{number}"
            _add_site(made.spec.worldbody, name, target, (0.01, 0.01, 0.01), _TARGET)
            sites.append(GoalSite(name, index, "a pose that an object's origin is to have"))
        for number, zone in enumerate(goal.zones if goal.metric == "zone" else ()):
            name = f"goal_{index}_zone_{number}"
            x, y, z = zone.size
            bottom = transforms.compose_poses(zone.pose, ((0.0, 0.0, -z / 2), (0.0, 0.0, 0.0, 1.0)))  # z is not scored
            _add_site(made.spec.worldbody, name, bottom, (x / 2, y / 2, _THIN), _ZONE)
            sites.append(GoalSite(name, index, "a zone that objects are to lie in"))
        sites += _add_relation_site(index, goal, made)
    return tuple(sites)


def _add_relation_site(index: int, goal: Goal, made: WorldSpec) -> list[GoalSite]:
    """Add the site of a typed goal that has a place: it moves with the object that the goal refers to."""
    kind = goal.relation_kind
    if kind in (None, "aligned", "upright"):
        return []
    number = goal.objects[0] if kind == "stacked" else goal.reference_id
    center, half = _compute_relation_goal_box(goal, made.models[number])
    name = f"goal_{index}_{kind}"
    _add_site(made.spec.body(f"object_{number}"), name, (center, (0.0, 0.0, 0.0, 1.0)), half, _RELATION)
    return [
        GoalSite(name, index, f"the place {kind} object_{number}" if kind != "stacked" else "the top of the lowest")
    ]


def _compute_relation_goal_box(goal: Goal, model: ObjectModel) -> tuple[Vec3, Vec3]:
    """Centre and half extents (m, frame of the object) of what a relation to an object speaks of."""
    low, high = np.asarray(model.bounds[0]), np.asarray(model.bounds[1])
    if goal.relation_kind in ("on", "stacked"):
        low[2] = high[2]
    elif goal.relation_kind == "near":
        reach = np.array([1.0, 1.0, 0.0]) * (goal.required_distance or 0.0)
        low, high = low - reach, high + reach
    return transforms.to_vec3((low + high) / 2), transforms.to_vec3(np.maximum((high - low) / 2, _THIN))


def _add_site(body: Any, name: str, pose: Pose, half: Vec3, rgba: tuple[float, ...]) -> None:
    position, (x, y, z, w) = pose
    box = mujoco.mjtGeom.mjGEOM_BOX
    body.add_site(name=name, type=box, pos=position, quat=(w, x, y, z), size=half, rgba=rgba, group=_GOAL_GROUP)


def _add_photo_camera(spec: Any, camera: InstanceCamera) -> None:
    position, rotation = camera.pose
    x, y, z, w = transforms.multiply_quaternions(rotation, _FLIP)
    width, height = camera.width, camera.height
    photo = spec.worldbody.add_camera(name="photo", pos=position, quat=(w, x, y, z))
    photo.resolution, photo.sensor_size = (width, height), (width * _PIXEL, height * _PIXEL)
    photo.focal_pixel = (camera.fx, camera.fy)
    # Pixels are counted at their centres; MuJoCo asks how far the middle of the picture is from the optical axis.
    photo.principal_pixel = ((width - 1) / 2 - camera.cx, (height - 1) / 2 - camera.cy)
    offscreen = spec.visual.global_
    offscreen.offwidth, offscreen.offheight = max(width, offscreen.offwidth), max(height, offscreen.offheight)


def _add_sky_and_viewpoint(spec: Any) -> None:
    """A sky, and where a viewer looks at first; neither is felt."""
    kind, gradient = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    above, below = (0.93, 0.95, 0.97), (0.75, 0.79, 0.84)
    spec.add_texture(name="sky", type=kind, builtin=gradient, rgb1=above, rgb2=below, width=64, height=384)
    spec.stat.center, spec.stat.extent = (0.45, 0.0, 0.1), 0.9
    spec.visual.global_.azimuth, spec.visual.global_.elevation = 150.0, -30.0


def _add_start_keyframe(instance: TaskInstance, library: Library, made: WorldSpec) -> None:
    """Add the keyframe ``start``: what the trusted environment has settled to, with its speeds, the arm at home."""
    task = InstanceTask(instance)
    env = Environment(task=task, library=library, seed=instance.seed, robot=instance.robot)
    env.timestep = instance.timestep
    env.reset()
    physics, dof = env.physics, made.arm.dof
    addresses = [physics.world.addresses[task.ids[number]] for number in made.free]
    places = [physics.data.qpos[start : start + 7] for start in addresses]
    speeds = [physics.data.qvel[dof + (start - dof) // 7 * 6 :][:6] for start in addresses]
    home = made.arm.home_joints
    start = made.spec.add_key(name="start")
    start.qpos, start.qvel = np.concatenate([home, *places]), np.concatenate([np.zeros(dof), *speeds])
    start.ctrl = np.concatenate([home, np.zeros(len(list(made.spec.actuators)) - dof)])
