"""Production of demonstrations: an instance, the expert's solution of it, and its replay through the environment."""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import numpy.typing as npt
from pydantic import Field

from grs_agents.base import Frozen
from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray, pose_matrix
from grs_agents.library.library import Library
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.task_instance import TaskInstance, hash_instance
from grs_agents.sim.motion.joint_controller import CONTROL_RATE
from grs_agents.sim.rendering.scene_cameras import Backend
from grs_agents.sim.tabletop_episode import InstanceEpisode, follow_oracle
from grs_agents.sim.variation.types import Variation
from grs_agents.sim.variation.vary import vary_instance
from grs_agents.sim.world.fingers import Fingers
from grs_agents.sim.world.physics import Physics
from grs_agents.tasks.demos.attempt_store import AttemptStore
from grs_agents.tasks.demos.types import (
    CameraModel,
    DemoControl,
    Demonstration,
    Dropped,
    Floats,
    Row,
    installed_versions,
)
from grs_agents.tasks.envs.controls import LARGEST_STEPS, LOWEST_TIP, EeDeltaControl, JointPositionControl
from grs_agents.tasks.envs.pictures import Photographer
from grs_agents.tasks.envs.state import StateReader
from grs_agents.tasks.envs.task_episode import TaskEpisode
from grs_agents.tasks.task_folder import TaskFolder, open_task_folder
from grs_agents.tasks.worker_pool import map_in_processes

Flags = npt.NDArray[np.bool_]
_PACES: Final = (1.0, 0.7)
"""Speeds of a replay relative to the expert: slower if the held object slips off at the control rate."""
_FINGER_PACES: Final = (0.5, 0.43)
"""``_PACES`` for fingers: an object held by friction creeps with the speed of its motion."""
_SPARE: Final = 20
"""Most attempts beyond twice the number of episodes."""
_VARIED: Final = Variation(jitter=0.03, yaw=float(np.deg2rad(30)))
"""Default variation."""
_EARLY: Final = 8
"""Control periods that suction is on before the cup touches: it seals as soon as it does."""
_AFTER_RELEASE: Final = 3
"""Control periods after a release in which suction stays off."""
_PRESS_STEPS: Final = 30
_PRESS: Final = 3
"""Physics steps that the arm presses on after it took hold, by as much as it moved in the last ``_PRESS``, so that a
replay that is half a millimetre too high touches all the same; at three times as much the cup shears off."""
_REST_STEPS: Final = 20
"""Physics steps that the arm waits where it releases."""
_NOISE_WIDTH: Final = 7.0
"""Standard deviation of the kernel that smooths execution noise, control periods: jittery noise shakes objects off."""
_NOISE_TWIST: Final = np.array([1.0, 1.0, 0.7, 0.0, 0.0, 6.25])
"""Execution noise of the tip relative to its horizontal shift (1; rad/m): at 8 mm it turns by 0.05 rad."""
_CAREFUL, _CAREFUL_REACH, _CAREFUL_RAMP = 0.15, 0.03, 0.08
"""Least share of the noise, distance from a grasp or release up to which it holds, and that in which the noise grows to
the whole, metres: an object that is lifted or set down may touch its neighbours."""
_LARGEST_SHARE: Final = 0.8
"""Share of the largest step of ``ee_delta`` that the expert uses: the rest is for corrections of noisy replays."""
_CORRECTED: Final = 0.15
"""Share of the way back to the path in an action of a noisy replay with ``ee_delta``: a chunk of such actions sums up
to about the whole way."""
_UPRIGHT_TOOL: Final = float(np.cos(np.deg2rad(2)))
"""Least cosine of the tool's tilt in demonstrations with ``ee_delta``, which keeps it straight down."""
_TAIL_PERIODS: Final = 15
"""Control periods after the step that solves the task: the hand stays off, and retreats."""
_SETTLE_PERIODS: Final = 50
"""Control periods (2 s) in which the scene may come to rest after the last action."""


class DemoOrder(Frozen):
    """Settings of a production; equal orders give equal demonstrations."""

    episodes: Annotated[int, Field(ge=1, le=1_000_000)] = 200  # without noise
    noise: Annotated[float, Field(ge=0, le=0.05)] = 0.008  # of replays, standard deviation of the tip's shift, m
    control: DemoControl = "joint_position"  # of the actions
    replays: Annotated[int, Field(ge=0, le=1000)] = 0  # of each episode with noise, besides the one without
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0  # of the variations
    variation: Variation = _VARIED
    cameras: tuple[str, ...] = ()
    size: tuple[int, int] = (224, 224)  # rows and columns of the pictures, as SmolVLA and pi0 take them
    renderer: Backend = "auto"

    @property
    def total(self) -> int:
        """Demonstrations wanted, replays included."""
        return self.episodes * (1 + self.replays)

    def attempts(self, number: int) -> range:
        """Attempts of an episode: the one without noise, then its replays."""
        return range(number * (1 + self.replays), (number + 1) * (1 + self.replays))


def make_demonstrations(
    folder: TaskFolder, order: DemoOrder, work: Path, show: Callable[[AttemptStore], None], workers: int = 1
) -> AttemptStore:
    """Complete a working folder to ``order.total`` demonstrations, the same for any number of ``workers`` (processes).

    The first attempts take the folder's instances as they are, later ones vary them in turn. ``show`` is called first,
    and after each episode with its replays.

    Raises:
        InputError: there are fewer instances than episodes without a variation; their objects differ in number; or the
            working folder was begun with another order.
    """
    attempts = _Attempts(folder, order)
    store = AttemptStore(work, attempts.attempt_settings)
    made = store.attempts
    waiting = [number for number in range(attempts.max_episode_count) if not made.issuperset(order.attempts(number))]
    show(store)
    results = map_in_processes(_make_episode, waiting, workers, _set_job, (folder.path, order, work))
    try:
        with closing(results):
            while store.find_end(order.total) is None and (files := next(results, None)) is not None:
                for file in files:
                    store.note(file)
                show(store)
    finally:
        while _job:
            _job.pop()[0].close()
    store.remove_from(store.find_end(order.total))
    return store


_job: list[tuple["_Attempts", AttemptStore]] = []


def _set_job(folder: Path, order: DemoOrder, work: Path) -> None:
    attempts = _Attempts(open_task_folder(folder), order)
    _job[:] = [(attempts, AttemptStore(work, attempts.attempt_settings))]


def _make_episode(number: int) -> list[Path]:
    """Make the attempts of an episode that the working folder lacks; returns their files."""
    attempts, store = _job[0]
    missing = sorted(set(attempts.order.attempts(number)) - store.attempts)
    return [store.add(attempt, attempts.make(attempt)) for attempt in missing]


class _Attempts:
    """The attempts of an order; each gives the same result whenever it is made."""

    def __init__(self, folder: TaskFolder, order: DemoOrder) -> None:
        self._folder, self.order = folder, order
        self._instances = {seed: folder.read_instance(seed) for seed in folder.seeds}
        counts = {
            (len(item.task_objects), item.robot, item.mounted_hand): seed for seed, item in self._instances.items()
        }
        if len(counts) > 1:
            differing = ", ".join(
                f"seed {seed} has {count} and {robot} with {hand}" for (count, robot, hand), seed in counts.items()
            )
            raise InputError(
                f"the instances of {folder.path} differ in how many objects they have, or in the robot: {differing}",
                "keep instances of one kind in one folder: a data set has one column for each joint and object",
            )
        if order.variation == Variation() and order.episodes > len(self._instances):
            message = f"{folder.path} has {len(self._instances)} instances as they are, {order.episodes} are wanted"
            raise InputError(message, "ask for fewer with --episodes, or vary them, e.g. with --jitter 0.03")
        if "photo" in order.cameras and any(item.camera is None for item in self._instances.values()):
            message = f"{folder.path} does not say where its photo was taken from"
            raise InputError(message, "leave the camera photo out")
        ((rows, robot, hand),) = counts
        self._replayer = Replayer(
            folder.library, get_arm(robot, hand), rows, order.control, order.cameras, order.size, order.renderer
        )
        self._clean: tuple[int, Demonstration | Dropped] | None = None  # the last episode, by its number

    @property
    def max_episode_count(self) -> int:
        """Most episodes that are attempted."""
        varied = self.order.variation != Variation()
        return 2 * self.order.episodes + _SPARE if varied else len(self._instances)

    @property
    def attempt_settings(self) -> dict[str, Any]:
        """Settings that attempts depend on; orders of more episodes share attempts."""
        return {
            "instances": {str(seed): hash_instance(instance) for seed, instance in self._instances.items()},
            **self.order.model_dump(exclude={"episodes"}),
            "versions": installed_versions(),
        }

    def make(self, attempt: int) -> Demonstration | Dropped:
        """Make an attempt: vary, let the expert solve, replay; of an episode the first is without noise."""
        number, noisy = divmod(attempt, 1 + self.order.replays)
        if self._clean is None or self._clean[0] != number:
            self._clean = number, self._make_clean(number)
        clean = self._clean[1]
        if isinstance(clean, Dropped) or not noisy:
            return clean if isinstance(clean, Dropped) else replace(clean, attempt=attempt)
        episode = self._replayer.episode
        try:
            episode.begin(TaskInstance.model_validate_json(clean.instance))
            rng = np.random.default_rng((self.order.seed, number, noisy))
            if clean.control == "ee_delta":
                actions, executed = add_step_noise(clean, self.order.noise, rng)
            else:
                actions, executed = clean.actions, add_execution_noise(clean, episode.sim.arm, self.order.noise, rng)
            if demonstration := self._replayer.run(actions, executed):
                return replace(demonstration, attempt=attempt, base_seed=clean.base_seed)
            raise SimulationError(episode.sim.current_episode.detail)
        except GrsError as error:
            return Dropped(stage="replay", why=error.message)

    def _make_clean(self, number: int) -> Demonstration | Dropped:
        seeds = tuple(self._instances)
        base = seeds[number % len(seeds)]
        instance, stage = self._instances[base], "variation"
        try:
            if number >= len(seeds):
                rng = np.random.default_rng((self.order.seed, number))
                instance = vary_instance(instance, self.order.variation, rng, self._folder.library)
            stage, episode = "expert", self._replayer.episode
            episode.begin(instance)
            positions, held, grip = record_expert(episode.current)
            if not episode.is_solved():
                raise SimulationError(episode.sim.current_episode.detail)
            stage = "replay"
            period, arm = round(1 / (CONTROL_RATE * instance.timestep)), episode.sim.arm
            if self.order.control == "ee_delta":
                pace = (_PACES if grip is None else _FINGER_PACES)[0]
                times = pace_within_steps(arm, positions, _LARGEST_SHARE / (pace * period))
                rows = np.floor(times).astype(int)
                before = positions[rows]
                positions = before + (times - rows)[:, None] * (positions[np.minimum(rows + 1, len(held) - 1)] - before)
                held, grip = held[rows], None if grip is None else grip[rows]
            for slower in range(len(_PACES)):
                episode.begin(instance)
                actions = expert_actions(positions, held, grip, period, slower)
                if self.order.control == "ee_delta":
                    actions = joint_actions_to_steps(arm, actions, episode.physics.joint_positions)
                if demonstration := self._replayer.run(actions):
                    return replace(demonstration, base_seed=base)
            raise SimulationError(episode.sim.current_episode.detail)
        except GrsError as error:
            return Dropped(stage=stage, why=error.message)

    def close(self) -> None:
        """Release the renderer."""
        self._replayer.close()


def record_expert(episode: InstanceEpisode) -> tuple[FloatArray, Flags, FloatArray | None]:
    """Let the expert solve an episode that was just reset.

    Returns joint positions (N, dof), linear between two samples, whether the hand holds an object (N,), and of a hand
    with fingers its commands (N,), see ``Fingers.openness``; one row for each physics step.
    ``episode.sim.current_episode`` says how it went.
    """
    physics = episode.sim.physics
    fingers = physics.grip if isinstance(physics.grip, Fingers) else None
    grips = list[float]() if fingers is None else [fingers.openness]
    times, positions, held = [float(physics.data.time)], [physics.joint_positions], [False]

    def sample_arm_state() -> None:
        times.append(float(physics.data.time))
        positions.append(physics.joint_positions)
        held.append(physics.held_object_id is not None)
        if fingers is not None:
            grips.append(fingers.openness)

    physics.observer = sample_arm_state
    try:
        follow_oracle(episode.task.oracle(episode.sim), episode)
    finally:
        physics.observer = None
    steps: FloatArray = np.round((np.array(times) - times[0]) / physics.timestep)
    at = np.linspace(0.0, float(steps[-1]), int(steps[-1]) + 1)
    looks: FloatArray = np.array(positions)
    path = np.column_stack([np.interp(at, steps, looks[:, joint]) for joint in range(looks.shape[1])])
    rows = np.searchsorted(steps, at)
    return path, np.array(held)[rows], None if fingers is None else np.array(grips)[rows]


def expert_actions(
    positions: FloatArray, held: Flags, grip: FloatArray | None, period: int, slower: int = 0
) -> npt.NDArray[np.float32]:
    """Actions (T, dof + 1) that repeat an episode of `record_expert` with its hand, at the pace of that try."""
    if grip is None:
        return path_to_actions(positions, held, period, _PACES[slower])
    return path_to_finger_actions(positions, grip, period, _FINGER_PACES[slower])


def path_to_actions(positions: FloatArray, held: Flags, period: int, pace: float = 1.0) -> npt.NDArray[np.float32]:
    """Actions (T, dof + 1), for each control period of ``period`` physics steps, that follow an expert's path.

    Each is the joint positions at the end of its period, and suction, 1 on and -1 off. The arm pauses where it takes
    hold and releases; ``pace`` below 1 is slower than the expert.
    """
    third = _PRESS_STEPS // 3
    down = np.linspace(0.0, 1.0, third + 1)[1:]
    depth: FloatArray = np.concatenate([down, np.ones(2 * third), down[::-1]])[:, None]  # down, hold, up again
    paths, flags, begin = list[FloatArray](), list[Flags](), 0
    for change in (np.flatnonzero(held[1:] != held[:-1]) + 1).tolist():
        if held[change]:
            pause = positions[change] + (positions[change - 1] - positions[max(0, change - 1 - _PRESS)]) * depth
        else:
            pause = np.repeat(positions[change][None], _REST_STEPS, axis=0)
        paths += [positions[begin : change + 1], pause]
        flags += [held[begin : change + 1], np.full(len(pause), held[change])]
        begin = change + 1
    path, holding = np.concatenate([*paths, positions[begin:]]), np.concatenate([*flags, held[begin:]])
    at = np.minimum(np.arange(1, int(np.ceil((len(path) - 1) / (pace * period))) + 1) * period * pace, len(path) - 1)
    before, share = np.floor(at).astype(int), (at % 1)[:, None]
    after = np.minimum(before + 1, len(path) - 1)
    targets = path[before] * (1 - share) + path[after] * share
    holds = holding[before]
    suction = holds.copy()
    for _ in range(_EARLY):
        suction[:-1] |= suction[1:]
    for last in np.flatnonzero(holds[:-1] & ~holds[1:]).tolist():
        suction[last + 1 : last + 1 + _AFTER_RELEASE] = False
    return np.concatenate([targets, np.where(suction, 1.0, -1.0)[:, None]], axis=1).astype(np.float32)


def path_to_finger_actions(
    positions: FloatArray, grip: FloatArray, period: int, pace: float = 1.0
) -> npt.NDArray[np.float32]:
    """As ``path_to_actions``, for a hand with fingers: the arm stands while they close and open, as the expert's did.

    ``grip`` are the commands of the fingers (N,).
    """
    last = len(positions) - 1
    at = np.minimum(np.arange(1, int(np.ceil(last / (pace * period))) + 1) * period * pace, last)
    before, share = np.floor(at).astype(int), (at % 1)[:, None]
    after = np.minimum(before + 1, last)
    targets = positions[before] * (1 - share) + positions[after] * share
    return np.concatenate([targets, grip[before][:, None]], axis=1).astype(np.float32)


def pace_within_steps(arm: Arm, positions: FloatArray, share: float) -> FloatArray:
    """Row numbers (M,), with fractions, at which joint positions (N, dof) are to be read for a tip that is slow enough.

    Between two of them it moves by at most ``share`` of ``LARGEST_STEPS``, and by at most a row.
    """
    ways = np.abs(np.diff(_level_tips(arm, positions), axis=0)) / (share * LARGEST_STEPS)
    times = np.append(0.0, np.cumsum(np.maximum(ways.max(axis=1), 1.0)))
    rows: FloatArray = np.interp(np.arange(int(np.ceil(times[-1])) + 1), times, np.arange(len(times)))
    return rows


def joint_actions_to_steps(arm: Arm, actions: Floats, start: FloatArray) -> npt.NDArray[np.float32]:
    """Actions (T, 5) of ``ee_delta`` that lead the tip along those of ``joint_position`` (T, dof + 1), from ``start``
    (dof,) on.

    Raises ``SimulationError`` where the tool tilts.
    """
    tips = _level_tips(arm, np.vstack([start, actions[:, :-1].astype(np.float64)]))
    return np.column_stack([np.diff(tips, axis=0) / LARGEST_STEPS, actions[:, -1]]).astype(np.float32)


def _level_tips(arm: Arm, path: FloatArray) -> FloatArray:
    """Position (m) and continuous turn about the vertical (rad) of the tip (N, 4) along joint positions (N, dof)."""
    points, rotations = arm.tip_poses(path)
    upright = float(rotations[:, 2, 2].min())
    if upright < _UPRIGHT_TOOL:
        tilt = np.rad2deg(np.arccos(upright))
        raise SimulationError(f"the expert tilts the tool by {tilt:.0f} degrees, ee_delta keeps it straight down")
    return np.column_stack([points, np.unwrap(np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0]))])


def add_execution_noise(
    clean: Demonstration, arm: Arm, sigma: float, rng: np.random.Generator
) -> npt.NDArray[np.float32]:
    """The actions (T, dof + 1) of a demonstration with smooth noise on the tip: ``sigma`` (m) away from contacts.

    An imitator that has seen them sees how to come back to the path (DART, Laskey et al. 2017).
    """
    executed = clean.actions.copy()
    for row, twist in enumerate(_smooth_twists(clean, sigma, rng)):
        joints = clean.actions[row, :-1].astype(np.float64)
        twist[2] = max(twist[2], min(0.0, LOWEST_TIP - arm.tip_height(joints)))
        executed[row, :-1] = arm.shift_tip(joints, twist)
    return executed


def add_step_noise(clean: Demonstration, sigma: float, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """As ``add_execution_noise`` for ``ee_delta``: the actions (T, 5) that lead back to the path, and those with noise.

    Noise is cut off where a step would be too large.
    """
    actions, executed = clean.actions.copy(), clean.actions.copy()
    shift = np.zeros(4)
    for row, twist in enumerate(_smooth_twists(clean, sigma, rng)):
        wanted = twist[[0, 1, 2, 5]]
        height = float(clean.commanded_tip[row + 1, 2])
        wanted[2] = max(wanted[2], min(0.0, LOWEST_TIP - height))
        step = clean.actions[row, :4] * LARGEST_STEPS
        actions[row, :4] = np.clip((step - _CORRECTED * shift) / LARGEST_STEPS, -1.0, 1.0)
        executed[row, :4] = np.clip((step + wanted - shift) / LARGEST_STEPS, -1.0, 1.0)
        shift += executed[row, :4] * LARGEST_STEPS - step
    return actions, executed


def _smooth_twists(clean: Demonstration, sigma: float, rng: np.random.Generator) -> FloatArray:
    """Twists (T, 6) of the tip, m and rad, of execution noise."""
    steps, holds = clean.steps, clean.suction
    points = clean.commanded_tip[1:, :3].astype(np.float64)
    contacts = points[holds[1:] != holds[:-1]]
    away = np.linalg.norm(points[:, None] - contacts[None], axis=2).min(axis=1, initial=np.inf)
    share: FloatArray = np.clip((away - _CAREFUL_REACH) / _CAREFUL_RAMP, _CAREFUL, 1.0)
    half = 3 * round(_NOISE_WIDTH)
    kernel: FloatArray = np.exp(-0.5 * (np.arange(-half, half + 1) / _NOISE_WIDTH) ** 2)
    kernel /= np.linalg.norm(kernel)  # unit variance
    white = rng.standard_normal((6, steps + 2 * half))
    smooth: FloatArray = np.stack([np.convolve(axis, kernel, "valid") for axis in white], axis=1)
    twists: FloatArray = smooth * share[:, None] * _NOISE_TWIST * sigma
    twists[:, 2] *= (share - _CAREFUL) / (1 - _CAREFUL)  # a cup that presses harder shears off, a higher one misses
    return twists


class Replayer:
    """Replays actions as the environment ``GRS-v0`` does, and records observations.

    Args:
        library: 3D assets.
        arm: of all episodes, with its hand.
        rows: number of objects of the tasks.
        control: of the actions.
        cameras: names of the cameras.
        size: rows and columns of the pictures.
        renderer: of the pictures.
    """

    def __init__(
        self,
        library: Library,
        arm: Arm,
        rows: int,
        control: DemoControl,
        cameras: Sequence[str],
        size: tuple[int, int],
        renderer: Backend,
    ) -> None:
        self.episode = TaskEpisode(library)
        self._control_name: DemoControl = control
        self._control = EeDeltaControl(arm) if control == "ee_delta" else JointPositionControl(arm)
        self._state = StateReader(arm, rows)
        self._photographer = Photographer(cameras, ("rgb",), size, renderer)

    def run(self, actions: Floats, executed: Floats | None = None) -> Demonstration | None:
        """Replay actions (T, D) in the episode that was just begun, until the task is solved and the hand retreated.

        With ``executed`` (T, D) these are carried out, and ``actions`` noted as what was right to do. None if the
        environment's horizon ends first, or the task does not stay solved.
        """
        episode, control = self.episode, self._control
        for part in (control, self._photographer):
            part.begin(episode)
        self._state.begin(episode, control)
        cameras = tuple(self._describe_camera(name, episode.physics) for name in self._photographer.cameras)
        rest = np.zeros_like(actions[-1, :-1]) if self._control_name == "ee_delta" else actions[-1, :-1]
        waiting = np.tile(np.append(rest, np.float32(-1)), (_SETTLE_PERIODS + _TAIL_PERIODS, 1))
        labels = np.concatenate([actions, waiting])
        last = min(len(actions) + _SETTLE_PERIODS, control.horizon(episode.instance.max_steps))
        solved = None
        carried_out = labels.copy()
        if executed is not None:
            carried_out[: len(executed)] = executed[: len(labels)]
        states, pictures = [self._state.read()[0]], [self._photographer.take()]
        for step, action in enumerate(carried_out, 1):
            control.apply(np.clip(action.astype(np.float64), control.low, control.high))
            episode.physics.raise_if_diverged()
            states.append(self._state.read()[0])
            pictures.append(self._photographer.take())
            if solved is None and episode.is_solved():
                solved, last = step, step + _TAIL_PERIODS
            if step == last:
                break
        if solved is None or not episode.is_solved():
            return None
        rewards = (np.arange(1, last + 1) == solved).astype(np.float32)
        return self._make_demonstration(states, pictures, labels[:last], carried_out[:last], rewards, cameras)

    def close(self) -> None:
        """Release the renderer."""
        self._photographer.close()

    def _make_demonstration(
        self,
        states: list[dict[str, Floats]],
        pictures: list[dict[str, npt.NDArray[np.uint8]]],
        actions: Floats,
        executed: Floats,
        rewards: Floats,
        cameras: tuple[CameraModel, ...],
    ) -> Demonstration:
        instance, physics = self.episode.instance, self.episode.physics
        columns = {name: np.array([state[name] for state in states]) for name in states[0]}
        return Demonstration(
            instance=instance.model_dump_json(),
            instance_hash=hash_instance(instance),
            language=instance.language,
            robot=physics.arm.name,
            control=self._control_name,
            joint_names=tuple(str(physics.model.joint(index).name) for index in range(physics.dof)),
            rate=CONTROL_RATE,
            joint_positions=columns["joint_positions"],
            joint_velocities=columns["joint_velocities"],
            tip=columns["tip"],
            commanded_tip=columns["commanded_tip"],
            suction=columns["suction"][:, 0] > 0,
            gripper=columns.get("gripper"),
            objects=columns["objects"],
            object_names=tuple(f"{item.asset}#{item.id}" for item in instance.task_objects),
            targets=columns["targets"],
            held=columns["held"],
            open=columns["open"],
            actions=actions,
            executed_actions=executed,
            rewards=rewards,
            strict=self.episode.strict_score,
            images={
                camera.name: np.array([picture[f"{camera.name}_rgb"] for picture in pictures]) for camera in cameras
            },
            cameras=cameras,
        )

    def _describe_camera(self, name: str, physics: Physics) -> CameraModel:
        """Model of a camera, the arm at rest; a camera on the arm is given in the frame of the tip."""
        scene, on_tip = self._photographer.scene, name == "wrist"
        pose = scene.pose(name, physics)
        if on_tip:
            turn = transforms.quaternion_to_matrix(physics.tip_rotation())
            pose = np.linalg.inv(pose_matrix(turn, np.array(physics.tip_position))) @ pose
        height, width = self._photographer.size
        return CameraModel(
            name=name,
            width=width,
            height=height,
            intrinsics=_matrix_to_row_tuples(scene.intrinsics(name)),
            frame="tip" if on_tip else "robot",
            pose=_matrix_to_row_tuples(pose),
        )


def _matrix_to_row_tuples(matrix: FloatArray) -> tuple[Row, ...]:
    return tuple(tuple(row) for row in matrix.tolist())
