"""CLIPort's names for the simulated table: ``Environment``, its action space, and its witness in a worker."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final, Protocol

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.sim.cliport import cameras, end_effectors, pybullet
from grs_agents.sim.cliport.cameras import Observation
from grs_agents.sim.instance.episode import SimulationError, UnsupportedError
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.motion import placement, tool_paths
from grs_agents.sim.motion.pick_place import PickPlaceResult
from grs_agents.sim.rollouts import Rollout, solve_episode
from grs_agents.sim.tabletop import CATEGORIES, TabletopSim, parse_pose
from grs_agents.sim.tabletop_episode import Action, GoalTask, InstanceTask, TabletopEpisode
from grs_agents.sim.world import templates
from grs_agents.sim.world.budget import DEFAULT_BUDGET
from grs_agents.sim.world.context import PROCESS_CONTEXT
from grs_agents.sim.world.recording import MotionRecording

_SPEED: Final = 1.0
"""Speed of the fastest joint in ``movej``, rad/s."""
_REACHED: Final = 0.01
"""Error of a joint that counts as arrived, radians."""
Info = dict[Any, Any]


class Witness(Protocol):
    """Observer of every environment of a process, which may change what was set up."""

    def begin_reset(self, env: "Environment") -> None:
        """A reset begins; the last scene still stands."""
        ...

    def finish_reset(self, env: "Environment") -> None:
        """The task has set its scene up; nothing has settled yet."""
        ...

    def run_or_replay_action(
        self, env: "Environment", pick: Pose, place: Pose, act: Callable[[Pose, Pose], PickPlaceResult]
    ) -> PickPlaceResult:
        """Carry an action out with ``act``, or replay the result of an equal one."""
        ...

    def finish_step(self, env: "Environment") -> None:
        """An action was scored."""
        ...

    def watch_oracle(self, oracle: Any, env: "Environment") -> Any:
        """Replacement for the oracle that a test asks for."""
        ...


class UnreachableError(SimulationError):
    """The arm cannot bring its tip to a pose."""

    outcome = "unreachable"


@dataclass(frozen=True)
class ActionSpace:
    """Actions are ``{'pose0': pose, 'pose1': pose}``, positions within ``low`` and ``high`` (3,), metres."""

    low: FloatArray
    high: FloatArray

    def sample(self, rng: np.random.Generator) -> dict[str, Pose]:
        """A random action, without turning."""
        points = rng.uniform(self.low, self.high, (2, 3)).tolist()
        return {f"pose{index}": parse_pose((point, None), "action") for index, point in enumerate(points)}

    def contains(self, action: Any) -> bool:
        """Whether an action has both poses, within the bounds."""
        try:
            poses = [parse_pose(action[key], key) for key in ("pose0", "pose1")]
        except (SimulationError, KeyError, TypeError):
            return False
        return all((self.low <= pose[0]).all() and (pose[0] <= self.high).all() for pose in poses)


class Environment(TabletopSim):
    """A table with objects and a robot arm whose base is at the origin (x forward, y left, z up, table top z = 0).

    Args:
        assets_root: a folder whose assets are laid over the library; if it does not exist, the library alone is used.
        task: may be given later with ``set_task``.
        disp, shared_memory, hz: accepted and ignored; the time step is the instance's.
        record_cfg: ``save_video_path`` is where ``end_rec`` writes.
        library: 3D assets; None for the shipped ones.
        seed: of ``rng``, which places objects at random; None for the process's default.
        budget: simulated steps this environment may use.
        robot: ``"ur5e"``, ``"panda"`` or the path of an MJCF file; None for the process's default.

    Example::

        env = Environment(assets_root, disp=False, hz=480, record_cfg=[])
        env.set_task(task)
        obs = env.reset()
    """

    witness: ClassVar[Witness | None] = None
    record_cfg: Any = None

    def __init__(
        self,
        assets_root: str | Path | None = "",
        task: GoalTask | None = None,
        disp: bool = False,
        shared_memory: bool = False,
        hz: int = 240,
        record_cfg: Any = None,
        *,
        library: Library | None = None,
        seed: int | None = None,
        budget: int = DEFAULT_BUDGET,
        robot: str | None = None,
        hand: str | None = None,  # a name of ``HANDS``; None for the process's default
    ) -> None:
        self.assets_root = str(assets_root or "")
        self.disp, self.shared_memory, self.hz, self.record_cfg = disp, shared_memory, hz, record_cfg
        library = library or PROCESS_CONTEXT.get_library()
        if self.assets_root and Path(self.assets_root).is_dir():
            library = library.copy_with_overlay_root(Path(self.assets_root))
        super().__init__(library, seed=seed, budget=budget, robot=robot, hand=hand, context=PROCESS_CONTEXT)
        self.pix_size = 0.003125
        self.task: GoalTask | None = None
        self.failed_placements = 0
        self._recording: tuple[str, MotionRecording] | None = None
        pybullet.set_current_environment(self)
        if task is not None:
            self.set_task(task)

    def set_task(self, task: GoalTask) -> None:
        """Choose the task that ``reset`` sets up."""
        self.task = task

    def reset(self, settle: bool = True) -> Observation:
        """Clear the table, let the task set its scene up, and wait until all rests (unless ``settle`` is False).

        Raises:
            SimulationError: there is no task, or the scene cannot be set up.
        """
        if self.task is None:
            raise SimulationError("env.reset() without a task", "call env.set_task(task) first")
        pybullet.set_current_environment(self)
        if self.witness is not None:
            self.witness.begin_reset(self)
        self.failed_placements, self.explain_lack_of_space = 0, None
        episode = TabletopEpisode(self, self.task, end_effectors.find_end_effector(self.task, self.hand))
        episode.set_up_scene()
        if self.witness is not None:
            self.witness.finish_reset(self)
        if settle:
            episode.settle_scene()
        return self.observation

    @property
    def info(self) -> Info:
        """``{id: (position, rotation, size), ..., 'lang_goal': str}``."""
        own = [item.id for item in self._task_objects]
        info: Info = {number: (*self.get_object_pose(number), self.get_object_size(number)) for number in own}
        info["lang_goal"] = self.get_lang_goal()
        return info

    def get_lang_goal(self) -> str:
        """The current goal in words."""
        return self.task.get_lang_goal() if self.task is not None else ""

    def get_task_name(self) -> str:
        """The name of the task's class; empty without a task."""
        return "" if self.task is None else type(self.task).__name__

    def fill_dummy_template(self, template: str) -> str:
        """A template filled with its defaults; the name goes to ``add_object``."""
        return templates.fill_template(self.library, template, {})

    @property
    def observation(self) -> Observation:
        """``{'color': three images, 'depth': three images}``, rendered when they are read."""
        return Observation(self.visible_scene)

    def step(self, action: Action | None = None) -> tuple[Observation, float, bool, Info]:
        """Pick and place once, or push once if that is the task's primitive, then score.

        Args:
            action: ``{'pose0': pick pose, 'pose1': place pose}`` of the tip of the hand, or the poses from and
                towards which to push; None to wait.

        Returns:
            (observation, reward added by this step, done, info). ``done``: all goals met, or ``max_steps`` used.
        """
        if self.task is None:
            raise SimulationError("env.step() without a task", "call env.set_task(task) first")
        _, reward, done, _ = TabletopEpisode(self, self.task, self.end_effector).step(action)
        if self.witness is not None:
            self.witness.finish_step(self)
        return self.observation, reward, done, self.info

    def pick_place(self, pick: Pose, place: Pose) -> PickPlaceResult:
        """Pick at one pose of the tip and place at another; does not score."""
        act = super().pick_place
        return act(pick, place) if self.witness is None else self.witness.run_or_replay_action(self, pick, place, act)

    def find(self, asset: str) -> list[int]:
        """Ids of the task's objects made of an asset, in the order in which they were added.

        ``asset`` is a library name; a template's finds all that were filled from it, what ``task.fill_template``
        returned those filled alike. An unknown name is an ``UnknownNameError``.
        """
        name = templates.resolve_asset_name(asset, self.library)
        filling = templates.find_filling_by_name(name)
        if filling is None:
            self.library.asset(name)
            return [item.id for item in self._task_objects if item.asset == name]
        alike = (filling.template, dict(filling.values))
        return [item.id for item in self._task_objects if (item.asset, item.fill) == alike]

    @property
    def obj_ids(self) -> dict[str, list[int]]:
        """Ids of the task's objects by category: ``fixed``, ``rigid``, ``deformable``."""
        return {kind: [item.id for item in self._task_objects if item.category == kind] for kind in CATEGORIES}

    set_object_color = TabletopSim.set_color

    @property
    def homej(self) -> FloatArray:
        """Joint positions (dof,) of the waiting arm, radians."""
        return self.arm.home_joints.copy()

    @property
    def ee(self) -> end_effectors.Suction | end_effectors.Spatula:
        """Hand at the end of the arm."""
        return end_effectors.Spatula() if self.end_effector.tool == "spatula" else end_effectors.Suction()

    @property
    def agent_cams(self) -> list[cameras.CameraConfig]:
        """The three observation cameras, for ``render_camera``."""
        return [dict(config) for config in cameras.AGENT_CAMERAS]

    @property
    def action_space(self) -> ActionSpace:
        """Bounds of actions."""
        return ActionSpace(self.bounds[:, 0], self.bounds[:, 1])

    def solve_ik(self, pose: Any) -> FloatArray:
        """Joint positions (dof,), near the present ones, that bring the tip to a pose.

        The pose is a position (m) and how the tool is turned (xyzw) from pointing straight down; it may tilt. Raises
        ``UnreachableError`` where limits, the table or the arm itself are in the way.
        """
        position, rotation = parse_pose(pose, "solve_ik")
        _, tilt = tool_paths.split_into_yaw_and_tilt(rotation)
        tilted, physics = bool(np.any(tilt)), self.physics
        if not tilted and not self.arm.can_reach_point(position):
            raise UnreachableError(
                f"{placement.format_point(position)} {placement.describe_out_of_reach(position, self.arm)}",
                "give a pose within reach",
            )
        joints = self.arm.solve_ik_for_poses(
            np.array([position]), transforms.quaternion_to_matrix(rotation)[None], physics.commanded_joint_positions
        )
        how = f"with the tool tilted by {np.linalg.norm(tilt):.2f} rad" if tilted else "with the tool down"
        if not self.arm.is_path_within_limits(joints):
            raise UnreachableError(
                f"{placement.format_point(position)} cannot be reached {how}", "give a pose within reach"
            )
        if (gap := self.arm.first_collision_along(joints)) is not None:
            raise UnreachableError(
                f"{placement.format_point(position)} cannot be reached {how}: {gap}", "give a pose within reach"
            )
        return joints[0]

    def movej(self, targj: Sequence[float] | FloatArray, speed: float = 0.01, timeout: float = 20) -> bool:
        """Move the arm straight to joint positions (dof,), within ``timeout`` seconds; True if it failed to arrive.

        Raises ``UnreachableError``, before it moves, beyond a joint's limits or where it would hit the table or itself.
        """
        del speed
        physics, target = self.physics, np.asarray(targj, dtype=np.float64)
        if target.shape != (self.arm.dof,) or not np.isfinite(target).all():
            count = self.arm.dof
            raise SimulationError(f"movej: {targj!r} are not {count} joint positions", f"give {count} finite numbers")
        if not self.arm.is_path_within_limits(target[None]):
            bounds = [
                f"{low:.2f}..{high:.2f}"
                for low, high in zip(self.arm.lower_joint_limits, self.arm.upper_joint_limits, strict=True)
            ]
            raise UnreachableError(f"movej: {targj!r} is beyond the joints' limits", f"stay within {', '.join(bounds)}")
        start = physics.joint_positions
        seconds = 1.5 * float(np.abs(target - start).max()) / _SPEED
        share = np.linspace(0.0, 1.0, max(2, int(seconds / self.timestep)))[:, None]
        path = start + (3 * share**2 - 2 * share**3) * (target - start)
        path = path[: max(2, int(timeout / self.timestep))]
        if (gap := self.arm.first_collision_along(path)) is not None:
            raise UnreachableError(
                f"movej: on its way {gap}", "give joint positions that keep it clear, e.g. of env.solve_ik(pose)"
            )
        physics.follow_joint_path(path)
        physics.wait_for_joint_positions(path[-1])
        return bool(np.abs(physics.joint_positions - target).max() > _REACHED)

    def movep(self, pose: Any, speed: float = 0.01) -> bool:
        """Move the tip to a pose; returns whether it failed to arrive, as ``movej``."""
        return self.movej(self.solve_ik(pose), speed)

    def render_camera(
        self, config: Mapping[str, Any], *_: Any, **__: Any
    ) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32], npt.NDArray[np.int32]]:
        """Colour (H, W, 3), depth (H, W; m along the optical axis) and object id (H, W; -1 = none) of a camera."""
        picture = cameras.render_from_camera_config(self.visible_scene, config)
        return picture.color, picture.depth, picture.owner

    def render(self, mode: str = "rgb_array") -> npt.NDArray[np.uint8]:
        """Picture (480, 640, 3) of the front camera; raises ``UnsupportedError`` for other modes (no window)."""
        if mode != "rgb_array":
            raise UnsupportedError(f"render(mode={mode!r}): there is no window", "use mode='rgb_array'")
        return self.render_camera(cameras.AGENT_CAMERAS[0])[0]

    def start_rec(self, video_filename: str) -> None:
        """Record the motion of every object and link from now on, until ``end_rec``."""
        if self._recording is not None:
            raise SimulationError("start_rec: a recording is under way", "call env.end_rec() first")
        physics = self.physics
        self._recording = (str(video_filename), MotionRecording(physics, {item.id: item.id for item in self.objects}))

    def end_rec(self) -> Path:
        """End the recording and return its file, ``<save_video_path>/<name>.npz``, by default in the working folder."""
        if self._recording is None:
            raise SimulationError("end_rec: nothing is being recorded", "call env.start_rec(name) first")
        (name, recording), self._recording = self._recording, None
        folder = Path(str(dict(self.record_cfg or {}).get("save_video_path", ".")))
        return recording.save(folder / f"{Path(name).name}.npz")


class _EnvironmentEpisode(TabletopEpisode[InstanceTask]):
    """Episodes of a task instance in an ``Environment``, whose witness sees each reset and step."""

    def __init__(self, env: Environment, task: InstanceTask) -> None:
        super().__init__(env, task, task.end_effector)
        self._env = env

    def set_up_scene(self) -> None:
        self._env.reset(settle=False)

    def reset(self) -> None:
        self._env.reset()

    def step(self, action: Action | None = None) -> tuple[Any, float, bool, dict[str, Any]]:
        observation, reward, done, _ = self._env.step(action)
        return observation, reward, done, {}


def rollout(
    instance: TaskInstance, library: Library | None = None, recording: Path | None = None, trials: int = 0
) -> Rollout:
    """Let the oracle solve an instance; the program it came from is not needed.

    ``recording`` is an .npz file to write: ``times`` (N,), ``positions`` (N, B, 3), ``quaternions`` (N, B, 4, xyzw),
    ``names`` (B,) ("object_<id>" or a robot link), ``tool`` (N, 3). ``trials`` is how often it solves the instance
    again with the least noise of the hand.
    """
    task = InstanceTask(instance)
    env = Environment(task=task, library=library, seed=instance.seed, robot=instance.robot, hand=instance.hand)
    env.timestep = instance.timestep
    return solve_episode(_EnvironmentEpisode(env, task), recording, trials)
