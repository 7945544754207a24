"""Recognition of a two-finger hand in a user's MJCF: movable bodies below a carrier that close on each other.

The hand is swept from open to closed; its surfaces there give the stroke, the pads and the outline of a parallel
gripper. A linkage counts as slides: at time steps of a task it would creep.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, count, product
from typing import Any, Final

import numpy as np

from grs_agents.base import Vec3
from grs_agents.base.config.schema import OwnHandConfig
from grs_agents.base.errors import InputError
from grs_agents.base.geometry.transforms import FloatArray, pose_matrix
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.hands.finger_surfaces import (
    FACE,
    GREY,
    PAD_HEIGHT,
    Fingers,
    bounding_boxes,
    sample_surface,
    snap_to_axis,
)
from grs_agents.sim.hands.two_fingers import Block, TwoFingerHand

_MOST_JOINTS: Final = 12
_MOST_FREE: Final = 3
"""Most independent joints whose limits are combined; more are driven by their actuators, as those of a linkage."""
_DRIVEN: Final = 1.5
"""Time that the actuators have to open or close a hand, seconds."""
_TIMESTEP: Final = 0.002
"""Of that simulation, seconds, whatever the file says: linkages are steady, and the number of steps is bounded."""
_MOST_TURN: Final = np.deg2rad(60)
"""Of a jaw from closed, radians; farther open it does not face the fixed jaw."""
_WAY: Final = 9
"""States along the way of a jaw."""
_LEAST_STROKE, _MOST_STROKE = 0.01, 0.3
_FARTHEST: Final = 100.0
"""Greatest joint position at an end of motion, radians or metres: 16 turns."""
_LEAST_SHARE: Final = 0.3
"""Part of the greatest displacement from which on a geom belongs to a finger."""
_JAW_SKEW: Final = np.cos(np.deg2rad(30))
"""As ``_SKEW``, of a jaw, whose middle is beside that axis."""
_PAD_HALF: Final = 0.004
"""Half thickness of a pad, metres."""
_LEAST_DEPTH: Final = 0.015
_FORCES: Final = (5.0, 40.0)
"""Least and greatest force where the file limits none, N: a firm grip."""
_SPEED, _PAYLOAD = 0.05, 1.0
"""Typical values of a light hand, m/s and kg: MJCF has none."""
_MASSES: Final = (0.4, 0.03)


@dataclass(frozen=True)
class FingerPart:
    """A body of a robot's file that a slide moves, closed: position (m) and quaternion (wxyz) in the flange's frame."""

    body: str
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]


@dataclass(frozen=True)
class OwnHand:
    """A hand of a robot's file, reduced to a parallel gripper.

    Attributes:
        hand: the gripper.
        position: (3,) of its flange in the frame of the carrier, metres.
        quaternion: (w, x, y, z) of its flange in the frame of the carrier.
        joints: names of the joints that move the fingers.
        slides: parts of the fingers at +y and -y, if a slide moves each of them.
    """

    hand: TwoFingerHand
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    joints: tuple[str, ...]
    slides: tuple[tuple[FingerPart, ...], ...] = ()

    def __str__(self) -> str:
        names = ", ".join(self.joints)
        return f"hand: two fingers, opens {1000 * self.hand.stroke:.0f} mm, by joints {names}"


def recognise_hand(
    spec: Any, carrier: Any, chain: frozenset[str], robot: str, described: OwnHandConfig | None = None
) -> OwnHand:
    """The two fingers below the body ``carrier`` of a robot's spec; the joints ``chain`` of the arm are fixed.

    A description names their joints and how these stand.
    Raises ``InputError`` with the reason if nothing there is a hand of two fingers.
    """
    fingers = [joint for joint in carrier.find_all("joint") if str(joint.name) not in chain]
    if described is not None:
        fingers = [joint for joint in fingers if str(joint.name) in described.joints]
    if not fingers:
        raise _refusal(robot, f"nothing moves beyond its body {carrier.name!r}")
    if len(fingers) > _MOST_JOINTS:
        raise _refusal(robot, f"{len(fingers)} joints beyond its body {carrier.name!r}, at most {_MOST_JOINTS}")
    name_unnamed(spec, fingers, "finger")
    name_unnamed(spec, [carrier], "carrier")
    names = tuple(str(joint.name) for joint in fingers)
    model = _compile_hand(spec, carrier, frozenset(names), robot)
    sweep = _Sweep(model, int(model.body(str(carrier.name)).id), robot)
    return sweep.reduce(names, described)


def name_unnamed(spec: Any, elements: Sequence[Any], word: str) -> None:
    """Name the unnamed joints or bodies of a spec: ``word``, or with a number where that is taken."""
    taken = {str(element.name) for element in (*spec.joints, *spec.bodies)}
    free = (name for number in count() if (name := f"{word}_{number}" if number else word) not in taken)
    for element in elements:
        element.name = element.name or next(free)


def _refusal(robot: str, reason: str) -> InputError:
    return InputError(f"robot {robot}: its hand is not recognised: {reason}", "name a hand, such as franka_hand")


def _compile_hand(spec: Any, carrier: Any, names: frozenset[str], robot: str) -> Any:
    """The model of the hand alone, in which the joints of the fingers move, without gravity and contacts."""
    within: list[Any] = carrier.find_all("geom")
    for element in [*spec.keys, *spec.sensors, *spec.pairs, *(geom for geom in spec.geoms if geom not in within)]:
        spec.delete(element)
    tendons = {str(tendon.name) for tendon in spec.tendons}
    for actuator in list(spec.actuators):
        if str(actuator.target) not in names | tendons:
            spec.delete(actuator)
    for joint in list(spec.joints):
        if str(joint.name) not in names:
            spec.delete(joint)
    spec.option.gravity, spec.option.timestep = (0, 0, 0), _TIMESTEP
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    moving: list[Any] = [geom for joint in carrier.find_all("joint") for geom in joint.parent.find_all("geom")]
    try:
        if any(geom.contype or geom.conaffinity for geom in moving):
            spec.discard_visual()
        return spec.compile()
    except ValueError as error:
        raise _refusal(robot, f"it does not compile alone: {str(error)[:200]}") from error


class _Sweep:
    """A hand alone, from open to closed; points are in the frame of the carrier, metres."""

    def __init__(self, model: Any, carrier: int, robot: str) -> None:
        self._model, self._carrier, self._robot = model, carrier, robot
        self._data: Any = mujoco.MjData(model)
        within = {carrier}
        for body in range(carrier + 1, model.nbody):
            if int(model.body_parentid[body]) in within:
                within.add(body)
        moving = {body for body in within if int(model.body_weldid[body]) != int(model.body_weldid[carrier])}
        geoms = [geom for geom in range(model.ngeom) if int(model.geom_bodyid[geom]) in within]
        solid = [geom for geom in geoms if model.geom_contype[geom] or model.geom_conaffinity[geom]]
        if not any(int(model.geom_bodyid[geom]) in moving for geom in solid):
            solid = geoms
        self._moving = [geom for geom in solid if int(model.geom_bodyid[geom]) in moving]
        self._fixed = [geom for geom in solid if int(model.geom_bodyid[geom]) not in moving]
        self._bodies = model.body_weldid[model.geom_bodyid]  # moving body of each geom
        self._surfaces = {geom: sample_surface(model, geom) for geom in solid}

    def reduce(self, names: tuple[str, ...], described: OwnHandConfig | None = None) -> OwnHand:
        """The parallel gripper that closes as the fingers do."""
        if not self._moving:
            raise _refusal(self._robot, f"joints {', '.join(names)} move no geom")
        states = list(self._end_states()) if described is None else self._described_states(described)
        if not all(float(np.abs(state).max()) <= _FARTHEST for state in states):  # False for NaN
            raise _refusal(self._robot, f"joints {', '.join(names)} move farther than {_FARTHEST:.0f} rad or m")
        pairs = [pair for ends in combinations(states, 2) if (pair := self._find_fingers(*ends)) is not None]
        if not pairs:
            ways = self._jaw_ways() if described is None else [(states[1], states[0])]
            pairs = [pair for ends in ways if (pair := self._close_jaw(*ends)) is not None]
        if not pairs:
            raise _refusal(self._robot, f"joints {', '.join(names)} close no two surfaces on each other")
        wide, narrow = max(pairs, key=lambda pair: pair[0].gap - pair[1].gap)
        stroke = wide.gap - max(narrow.gap, 0.0)
        if not _LEAST_STROKE <= stroke <= _MOST_STROKE:
            bounds = f"{1000 * _LEAST_STROKE:.0f} to {1000 * _MOST_STROKE:.0f} mm"
            raise _refusal(self._robot, f"it opens {1000 * stroke:.0f} mm, not {bounds}")
        return self._build(wide, narrow, names, None if described is None else described.tcp)

    def _jaw_ways(self) -> list[tuple[FloatArray, FloatArray]]:
        """Ends (nq,) of motion, closed and wide open, of one jaw that a joint closes on a fixed one."""
        model = self._model
        if model.njnt != 1 or not model.jnt_limited[0]:
            return []
        low, high = model.jnt_range[0].tolist()
        hinge = int(model.jnt_type[0]) == int(mujoco.mjtJoint.mjJNT_HINGE)
        most = min(high - low, _MOST_TURN) if hinge else high - low
        return [(np.array([low]), np.array([low + most])), (np.array([high]), np.array([high - most]))]

    def _close_jaw(self, closed: FloatArray, opened: FloatArray) -> tuple[Fingers, Fingers] | None:
        """A jaw on a fixed one, wide open and closed, on the way between two states (nq,)."""
        if not self._fixed:
            return None
        states = list(np.linspace(closed, opened, _WAY))
        moving = [np.vstack(self._points(state, self._moving)) for state in states]
        fixed = np.vstack(self._points(states[0], self._fixed))
        reach = moving[0].mean(axis=0)
        depth = moving[0] @ reach / np.linalg.norm(reach)
        tip = depth > depth.max() - PAD_HEIGHT
        opening = (moving[1] - moving[0])[tip].mean(axis=0)
        z = snap_to_axis(reach / np.linalg.norm(reach), _JAW_SKEW)
        opening -= (opening @ z) * z
        if float(np.linalg.norm(opening)) < 1e-4:
            return None
        y = snap_to_axis(opening / np.linalg.norm(opening), _JAW_SKEW)
        y -= (y @ z) * z
        y /= np.linalg.norm(y)
        axes = np.column_stack([np.cross(y, z), y, z])
        if abs(float((fixed @ z).max() - (moving[0] @ z).max())) > PAD_HEIGHT:
            return None
        ways = [Fingers(axes, points @ axes, fixed @ axes) for points in moving]
        gaps = np.array([fingers.gap for fingers in ways])
        touching, widest = int(np.abs(gaps).argmin()), int(gaps.argmax())  # the file may close it farther
        if abs(gaps[touching]) > _LEAST_STROKE or touching >= widest or (np.diff(gaps[: widest + 1]) <= 0).any():
            return None
        return ways[widest], ways[touching]

    def _described_states(self, described: OwnHandConfig) -> list[FloatArray]:
        """Joint positions (nq,) wide open and closed."""
        model = self._model
        states: list[FloatArray] = []
        for values in (described.open, described.closed):
            positions = np.array(model.qpos0)
            for name, value in zip(described.joints, values, strict=True):
                positions[int(model.joint(name).qposadr[0])] = value
            states.append(positions)
        return states

    def _end_states(self) -> Iterator[FloatArray]:
        """Joint positions (nq,) at the ends of motion."""
        model, data = self._model, self._data
        joined = [number for number in range(model.neq) if int(model.eq_type[number]) == int(mujoco.mjtEq.mjEQ_JOINT)]
        led = {int(model.eq_obj1id[number]): number for number in joined if int(model.eq_obj2id[number]) >= 0}
        free = [joint for joint in range(model.njnt) if joint not in led]
        if len(free) <= _MOST_FREE and len(joined) == model.neq and all(model.jnt_limited[joint] for joint in free):
            for values in product(*(model.jnt_range[joint] for joint in free)):
                positions = np.array(model.qpos0)
                positions[free] = values
                for joint, number in led.items():
                    leader = int(model.eq_obj2id[number])
                    offset = positions[leader] - model.qpos0[leader]
                    positions[joint] = model.qpos0[joint] + np.polyval(model.eq_data[number, :5][::-1], offset)
                yield positions
            return
        if not 0 < model.nu <= _MOST_FREE:
            count = f"{model.nu} actuators" if model.nu else "no actuator"
            raise _refusal(self._robot, f"{len(free)} joints beyond the arm are driven by {count}")
        ranges = [
            model.actuator_ctrlrange[number] if model.actuator_ctrllimited[number] else (-1.0, 1.0)
            for number in range(model.nu)
        ]
        for controls in product(*ranges):
            mujoco.mj_resetData(model, data)
            data.ctrl[:] = controls
            for _ in range(round(_DRIVEN / _TIMESTEP)):
                mujoco.mj_step(model, data)
            if not np.isfinite(data.qpos).all():
                raise _refusal(self._robot, "its simulation diverges")
            yield np.array(data.qpos)

    def _points(self, state: FloatArray, geoms: list[int]) -> list[FloatArray]:
        data = self._data
        data.qpos[:] = state
        mujoco.mj_kinematics(self._model, data)
        origin, axes = data.xpos[self._carrier], np.array(data.xmat[self._carrier]).reshape(3, 3)
        return [
            (data.geom_xpos[geom] + self._surfaces[geom] @ np.array(data.geom_xmat[geom]).reshape(3, 3).T - origin)
            @ axes
            for geom in geoms
        ]

    def _find_fingers(self, first: FloatArray, second: FloatArray) -> tuple[Fingers, Fingers] | None:
        """The fingers wide open and closed, from two states."""
        before, after = self._points(first, self._moving), self._points(second, self._moving)
        shifts = np.array([(end - start).mean(axis=0) for start, end in zip(before, after, strict=True)])
        if float(np.abs(shifts).max()) < _LEAST_STROKE / 4:
            return None
        closing = snap_to_axis(np.linalg.svd(shifts)[2][0])
        along = shifts @ closing
        least = _LEAST_SHARE * float(np.abs(along).max())
        positive, negative = np.flatnonzero(along > least), np.flatnonzero(along < -least)
        if not len(positive) or not len(negative):
            return None
        reach = np.vstack([before[index] for index in (*positive, *negative)]).mean(axis=0)
        reach -= (reach @ closing) * closing
        if float(np.linalg.norm(reach)) < 1e-3:
            return None
        z = snap_to_axis(reach / np.linalg.norm(reach))
        axes = np.column_stack([np.cross(closing, z), closing, z])
        pair: list[Fingers] = []
        for state, points in ((first, before), (second, after)):
            sides = [(np.vstack([points[index] for index in side]) @ axes, side) for side in (positive, negative)]
            sides.sort(key=lambda side: -float(side[0][:, 1].mean()))
            bodies = [{int(self._bodies[self._moving[index]]) for index in side} for _, side in sides]
            pair.append(Fingers(axes, sides[0][0], sides[1][0], state, bodies))
        pair.sort(key=lambda fingers: -fingers.gap)
        return pair[0], pair[1]

    def _build(self, wide: Fingers, narrow: Fingers, names: tuple[str, ...], tcp: Vec3 | None) -> OwnHand:
        axes, length = wide.axes, max(wide.end, narrow.end)
        (x, y), half_x, half_z = narrow.middle, *narrow.pad
        if tcp is not None:
            x, y, length = (np.array(tcp) @ axes).tolist()
        middle = np.array([x, y, 0.0])
        fixed = [points @ axes - middle for points in self._points(self._data.qpos.copy(), self._fixed)]
        body = np.vstack([np.empty((0, 3)), *fixed])
        low, high = np.array(wide.inner) - y
        between = (body[:, 1] > low + FACE) & (body[:, 1] < high - FACE) & (np.abs(body[:, 0]) < half_x + 0.02)
        top = max(0.0, float(body[between, 2].max(initial=0.0)))
        if length - top < _LEAST_DEPTH:
            raise _refusal(self._robot, f"its fingers reach {1000 * (length - top):.0f} mm beyond the palm")
        half_z = min(half_z, (length - top) / 2 - 0.002)
        fingers = [(side - middle) * (1, sign, 1) for side, sign in ((narrow.left, 1), (narrow.right, -1))]
        behind = np.vstack(fingers) - (0, max(narrow.gap, 0.0) / 2, 0)
        sweep = [side - middle for fingers in (wide, narrow) for side in (fingers.left, fingers.right)]
        palm = np.vstack([body, *sweep])
        stroke = wide.gap - max(narrow.gap, 0.0)
        start = length - 2 * half_z
        hand = TwoFingerHand(
            name="own",
            maker="hand",
            length=length,
            stroke=stroke,
            forces=_FORCES,
            speed=_SPEED,
            payload=_PAYLOAD,
            masses=_MASSES,
            pad=(half_x, _PAD_HALF, half_z),
            palm=tuple(bounding_boxes(palm, 0.0, top)) or (Block((0.0, 0.0, 0.002), (half_x, half_x, 0.002), GREY),),
            finger=(
                *bounding_boxes(behind, top, start, 0.0),
                *bounding_boxes(behind, start, length, 2 * _PAD_HALF, slabs=1),
            ),
        )
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(axes).ravel())
        px, py, pz = (axes @ middle).tolist()
        w, i, j, k = quaternion.tolist()
        flange = pose_matrix(axes, axes @ middle)
        return OwnHand(hand, (px, py, pz), (w, i, j, k), names, tuple(self._sliding_fingers(narrow, flange)))

    def _sliding_fingers(self, closed: Fingers, flange: FloatArray) -> Iterator[tuple[FingerPart, ...]]:
        """The bodies of either finger, if a slide moves each; ``flange`` (4, 4) is in the frame of the carrier."""
        model, data = self._model, self._data
        slides = set(model.jnt_bodyid[model.jnt_type == int(mujoco.mjtJoint.mjJNT_SLIDE)].tolist())
        if closed.state is None or not all(len(side) == 1 and side <= slides for side in closed.bodies):
            return
        data.qpos[:] = closed.state
        mujoco.mj_kinematics(model, data)
        poses = [pose_matrix(data.xmat[body].reshape(3, 3), data.xpos[body]) for body in range(model.nbody)]
        to_flange, quaternion = np.linalg.inv(poses[self._carrier] @ flange), np.empty(4)
        for (finger,), sign in zip(closed.bodies, (1, -1), strict=True):
            parts: list[FingerPart] = []
            for body in np.flatnonzero(model.body_weldid == finger).tolist():
                pose = to_flange @ poses[body]
                mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(pose[:3, :3]).ravel())
                x, y, z = pose[:3, 3].tolist()
                w, i, j, k = quaternion.tolist()
                parts.append(
                    FingerPart(str(model.body(body).name), (x, y - sign * max(closed.gap, 0.0) / 2, z), (w, i, j, k))
                )
            yield tuple(parts)
