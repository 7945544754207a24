"""A user's own arm: an MJCF file with a serial chain of hinges and slides, extended by a hand."""

from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from grs_agents.base.errors import InputError
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.arms.arm_parts import add_position_actuator
from grs_agents.sim.arms.collision_model import delete_unused_meshes, reduce_to_collision_model
from grs_agents.sim.arms.urdf_arm import find_mjcf, read_joint_speeds
from grs_agents.sim.hands.description import read_described_hand
from grs_agents.sim.hands.hand import ROBOT_CONTYPE, Hand
from grs_agents.sim.hands.recognition import OwnHand, name_unnamed, recognise_hand
from grs_agents.sim.hands.suction_cup import SUCTION_CUP
from grs_agents.sim.hands.two_fingers import FINGERS

TIPS: Final = ("tip", "tool0", "attachment_site", "ee", "end_effector", "flange", "tcp")
"""Site names for the hand, in order of preference; without any, the frame of the last body before the fingers."""
_Place = tuple[float, float, float]
"""x, y (m) and turn about the vertical (rad)."""
_MOST_JOINTS: Final = 12
_PREFIX: Final = "arm_"
_STIFFNESS, _TORQUE = 3000.0, 200.0
_QUARTERS: Final = (0.0, np.pi / 2, np.pi, -np.pi / 2)
"""Mounting angles of the hand about its own axis, radians: any of them works."""
_HALVES: Final = (0.0, np.pi)
"""Those of two fingers in the arm's file, which stay where they are there."""
_AT_ORIGIN: Final = 1e-6
"""Distance of a base from the origin that does not count, metres."""
_ROOM: Final = np.pi / 2
"""Distance of the last joint from its limits at home, radians, that ends the search over mounting angles."""


def load_arm(path: Path, hand: Hand | None = SUCTION_CUP) -> Arm:
    """The arm of an MJCF file, with a hand, None for the two fingers of the file.

    Raises ``InputError`` if it is no serial arm, cannot point down at the table, or has no hand that is recognised.
    """
    spec = _parse_mjcf(path)
    chain = _find_joint_chain(spec, path)
    try:
        reduce_to_collision_model(spec)
        model = spec.copy().compile()
    except ValueError as error:
        raise InputError(f"robot {path}: does not compile: {str(error)[:300]}", "mend what it names") from error
    guess = None
    if model.nkey:
        guess = np.array([float(model.key_qpos[0][model.joint(joint.name).qposadr[0]]) for joint in chain])
    place = _find_place_of_base(model, str(chain[0].name))
    stated = read_joint_speeds(spec, str(path))
    slides = [joint.type == mujoco.mjtJoint.mjJNT_SLIDE for joint in chain]
    usual = dict(zip((str(joint.name) for joint in chain), np.where(slides, 1.0, np.pi).tolist(), strict=True))
    speeds = np.array([min(speed, stated.get(name, speed)) for name, speed in usual.items()])
    own = recognise_own_hand(path) if hand is None else None
    mounted = own.hand if own is not None else hand or SUCTION_CUP
    best: Arm | None = None
    refusal: InputError | None = None
    for turn in _QUARTERS if own is None else _HALVES:

        def add(world: Any, moving: bool, turn: float = turn) -> None:
            _attach_arm_to_world(world, spec.copy(), path, place, turn, own or mounted, moving)

        def add_dressed(world: Any, moving: bool, turn: float = turn) -> None:
            spec = _parse_mjcf(path)
            fingers = spec.copy()
            _attach_arm_to_world(world, _strip_to_looks(spec), path, place, turn, own or mounted, moving)
            if own is not None:
                _dress_fingers(world, _strip_to_looks(fingers), own)

        arm = Arm(str(path), add, guess, mounted, add_dressed)
        arm.maker_speeds = speeds
        try:
            arm.home_joints.setflags(write=False)  # computed now, so that an unusable arm is refused early
        except InputError as error:
            refusal = refusal or error
            continue
        if best is None or _last_joint_limit_margin(arm) > _last_joint_limit_margin(best) + 1e-3:
            best = arm
        if _last_joint_limit_margin(best) >= _ROOM:
            break
    if best is None:
        assert refusal is not None, "an arm was neither found nor refused"
        raise refusal
    return best


@lru_cache(maxsize=16)
def recognise_own_hand(path: Path) -> OwnHand:
    """The two fingers in an arm's file; raises ``InputError`` with the reason if there are none."""
    spec = _parse_mjcf(path)
    chain = frozenset(str(joint.name) for joint in _find_joint_chain(spec, path))
    described = read_described_hand(spec, str(path))
    carrier, site = _find_tip_body_and_site(spec, path)
    try:
        return recognise_hand(spec, carrier, chain, str(path), described)
    except InputError as error:
        if site is not None or described is not None or carrier.find_all("joint")[len(carrier.joints) :]:
            raise
        reason = "" if (jaw := _refuse_jaw(path)) is None else jaw.message.rpartition("recognised: ")[2]
        raise InputError(f"{error.message}; as a jaw its last link fails: {reason}", error.remedy) from error


def _last_joint_limit_margin(arm: Arm) -> float:
    """Distance of the last joint at home from the nearer of its limits, radians or metres."""
    return float(
        min(arm.home_joints[-1] - arm.lower_joint_limits[-1], arm.upper_joint_limits[-1] - arm.home_joints[-1])
    )


def _parse_mjcf(path: Path) -> Any:
    try:
        return mujoco.MjSpec.from_file(str(find_mjcf(path).resolve()))
    except OSError as error:
        raise InputError(f"robot {path}: cannot be read: {error}", "give the path of an MJCF file") from error
    except ValueError as error:
        raise InputError(f"robot {path}: is no MJCF: {str(error)[:300]}", "mend what it names") from error


def _find_tip_body_and_site(spec: Any, path: Path) -> tuple[Any, Any | None]:
    """Body that carries the hand, and the site of the hand (None: the frame of the body)."""
    sites = {str(site.name): site for site in spec.sites}
    carrier = _carrier_of_described_fingers(spec, path)
    for name in TIPS:
        if name in sites and carrier in (None, sites[name].parent):
            return sites[name].parent, sites[name]
    if carrier is not None:
        return carrier, None
    bodies: list[Any] = list(spec.bodies)
    if len(bodies) < 2:
        raise InputError(f"robot {path}: there is no body", "give an arm: bodies one inside the other, with joints")
    last = max(bodies, key=_depth)
    carrier = _carrier_of_fingers(last)
    return (_moving_body(last).parent if carrier == last and _refuse_jaw(path) is None else carrier), None


def _carrier_of_described_fingers(spec: Any, path: Path) -> Any | None:
    """The nearest body that carries all fingers which a description names."""
    described = read_described_hand(spec, str(path))
    if described is None:
        return None
    joints = {str(joint.name): joint for joint in spec.joints}
    if missing := [name for name in described.joints if name not in joints]:
        raise InputError(f"robot {path}: there is no joint {missing[0]!r}", f"name joints of {', '.join(joints)}")
    ancestors = [_body_and_ancestors(joints[name].parent)[1:] for name in described.joints]
    shared = [body for body in ancestors[0] if all(body in bodies for bodies in ancestors[1:])]
    if not shared:
        raise InputError(
            f"robot {path}: no body carries the joints of its hand", "put them on bodies of the arm's last"
        )
    return shared[0]


@lru_cache(maxsize=16)
def _refuse_jaw(path: Path) -> InputError | None:
    """The reason why the last joint of the longest chain closes no jaw on the body before it; None if it does."""
    spec = _parse_mjcf(path)
    jaw = _moving_body(max(spec.bodies, key=_depth))
    before = _body_and_ancestors(jaw)[1:]
    chain = frozenset(str(joint.name) for body in before for joint in body.joints)
    if not jaw.joints or not chain:
        return InputError(f"robot {path}: its hand is not recognised: no link moves beyond another")
    try:
        recognise_hand(spec, before[0], chain, str(path))
    except InputError as error:
        return error
    return None


def _depth(body: Any) -> tuple[int, int]:
    """Numbers of moving bodies, and of all, from the base to a body: fingers lie deeper than frames fixed to a palm."""
    bodies = _body_and_ancestors(body)
    return sum(bool(part.joints) for part in bodies), len(bodies)


def _moving_body(last: Any) -> Any:
    """A body, or its nearest ancestor that has a joint, if any."""
    return next((body for body in _body_and_ancestors(last) if body.joints), last)


def _carrier_of_fingers(last: Any) -> Any:
    """The body that carries the fingers on which a chain ends: the last to fork into moving bodies, below a joint.
    Without fingers, the last body."""
    ancestors = _body_and_ancestors(last)
    for index, body in enumerate(ancestors[1:], start=1):
        moving = [child for child in body.bodies if any(part.joints for part in (child, *child.find_all("body")))]
        if len(moving) > 1 and any(part.joints for part in ancestors[index:]):
            return body
    return last


def _body_and_ancestors(body: Any) -> list[Any]:
    """A body and its ancestors, without the world."""
    bodies: list[Any] = []
    while body is not None and str(body.name) != "world":
        bodies.append(body)
        body = body.parent
    return bodies


def _find_joint_chain(spec: Any, path: Path) -> list[Any]:
    """Joints from the base to the tip; raises ``InputError`` if they are no serial arm."""
    carrier, site = _find_tip_body_and_site(spec, path)
    joints = [joint for body in reversed(_body_and_ancestors(carrier)) for joint in body.joints]
    where = f"site {site.name!r}" if site is not None else f"body {carrier.name!r}"
    if not joints:
        remedy = f"put hinge or slide joints on the bodies that carry it; the tip is a site named {', '.join(TIPS[:3])}"
        raise InputError(f"robot {path}: no joint moves the {where}", remedy)
    serves = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    for joint in joints:
        if joint.type not in serves:
            raise InputError(f"robot {path}: joint {joint.name!r} is neither hinge nor slide", "use hinges and slides")
        if not joint.name:
            raise InputError(f"robot {path}: a joint of body {joint.parent.name!r} has no name", "name every joint")
    if len(joints) > _MOST_JOINTS:
        raise InputError(f"robot {path}: {len(joints)} joints, at most {_MOST_JOINTS}", "give a serial arm")
    return joints


def _find_place_of_base(model: Any, first: str) -> _Place:
    """Place on the table of the base below the joint ``first``: x, y (m), and its turn about the vertical (rad)."""
    root = int(model.body_rootid[model.joint(first).bodyid[0]])
    x, y, _ = model.body_pos[root].tolist()
    if model.body_jntnum[root] or np.hypot(x, y) < _AT_ORIGIN:
        return 0.0, 0.0, 0.0
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.body_quat[root])
    return x, y, float(np.arctan2(rotation[3], rotation[0]))


def _strip_to_looks(spec: Any) -> Any:
    """A robot's spec, without what collides on bodies that have looks."""
    for body in spec.bodies:
        solid = [geom for geom in body.geoms if geom.contype or geom.conaffinity]
        if len(solid) < len(body.geoms):
            for geom in solid:
                spec.delete(geom)
    delete_unused_meshes(spec)
    return spec


def _dress_fingers(world: Any, spec: Any, own: OwnHand) -> None:
    """Show the fingers of a robot's spec in place of the hand's boxes, if they slide as these do."""
    if not own.slides or any(spec.body(part.body) is None for finger in own.slides for part in finger):
        return
    for geom in spec.geoms:
        geom.group, geom.contype, geom.conaffinity = 1, 0, 0
    for name in (own.hand.body, *FINGERS):
        for geom in list(world.body(name).geoms):
            world.delete(geom)
    for name, finger in zip(FINGERS, own.slides, strict=True):
        world.body(name).explicitinertial = True  # looks may weigh nothing, and a moving body must not
        world.body(name).mass, world.body(name).inertia = 0.01, (1e-5, 1e-5, 1e-5)
        for part in finger:
            alone = spec.copy()
            body = alone.body(part.body)
            for geom in [geom for geom in alone.geoms if geom.parent != body]:
                alone.delete(geom)
            delete_unused_meshes(alone)
            frame = body.add_frame(pos=part.position, quat=part.quaternion)
            for geom in list(body.geoms):
                (geom.frame or geom).set_frame(frame)
            world.body(name).attach_frame(frame, f"{part.body}_", "")


def _attach_arm_to_world(
    world: Any, spec: Any, path: Path, place: _Place, turn: float, hand: Hand | OwnHand, moving: bool
) -> None:
    """Add the weightless arm, its base moved from ``place`` to the origin, its hand turned by ``turn`` (rad); bodies
    off the chain stay fixed."""
    chain = _find_joint_chain(spec, path)
    carrier, site = _find_tip_body_and_site(spec, path)
    names = [str(joint.name) for joint in chain]
    torques = {  # N m or N: the force limit of the joint's first actuator, else of the joint, else a usual one
        str(joint.name): high if (high := float(joint.actfrcrange[1])) > 0 else _TORQUE for joint in chain
    }
    for actuator in reversed(list(spec.actuators)):
        low, high = (float(bound) for bound in actuator.forcerange)
        if str(actuator.target) in torques and high > max(low, 0.0):
            torques[str(actuator.target)] = high
    flange = (tuple(site.pos), tuple(site.quat)) if site is not None else ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    described = read_described_hand(spec, str(path)) is not None
    if isinstance(hand, OwnHand) or (site is None and (described or _refuse_jaw(path) is None)):
        own = hand if isinstance(hand, OwnHand) else recognise_own_hand(path)
        flange = own.position, own.quaternion
    if isinstance(hand, OwnHand):
        for body in [body for body in carrier.bodies if body.joints or body.find_all("joint")]:
            spec.delete(body)  # slides take its place
    quaternion = np.empty(4)
    mujoco.mju_mulQuat(quaternion, np.array(flange[1]), np.array([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)]))
    name_unnamed(spec, [carrier], "carrier")
    for elements in (spec.keys, spec.actuators, spec.sensors, spec.tendons, spec.equalities, spec.lights, spec.cameras):
        for element in list(elements):
            spec.delete(element)
    for joint in list(spec.joints):
        if str(joint.name) not in names:
            spec.delete(joint)
    for body in spec.bodies:
        body.gravcomp = 1.0
    for geom in spec.geoms:
        solid = bool(geom.contype or geom.conaffinity)
        geom.group, geom.contype, geom.conaffinity = 1, ROBOT_CONTYPE if solid else 0, 0
    full_turn = 360.0 if spec.compiler.degree else 2 * np.pi
    for joint in chain:  # limits and armature where the file gives none
        joint.armature = max(float(joint.armature), 0.05)
        low, high = (float(bound) for bound in joint.range)
        if low >= high:
            slide = joint.type == mujoco.mjtJoint.mjJNT_SLIDE
            joint.range = (-1.0, 1.0) if slide else (-full_turn, full_turn)
        joint.limited = True
    end = f"{_PREFIX}{carrier.name}"
    x, y, yaw = place
    back = (-np.cos(yaw) * x - np.sin(yaw) * y, np.sin(yaw) * x - np.cos(yaw) * y, 0.0)
    frame = world.worldbody.add_frame(pos=back, quat=(np.cos(yaw / 2), 0.0, 0.0, -np.sin(yaw / 2)))
    world.attach(spec, prefix=_PREFIX, frame=frame)
    for name in names:
        add_position_actuator(world, f"{_PREFIX}{name}", _STIFFNESS, torques[name])
    mounted = hand.hand if isinstance(hand, OwnHand) else hand
    mounted.add_to(world, world.body(end), flange[0], tuple(quaternion), moving)
