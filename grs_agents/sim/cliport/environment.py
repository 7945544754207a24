"""The environment: typed objects on a table, an arm with a suction cup, rewards from the task."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from grs_agents.base import Pose
from grs_agents.errors import GrsError
from grs_agents.library import Library
from grs_agents.sim.arms import get_arm
from grs_agents.sim.cliport import end_effectors, pybullet
from grs_agents.sim.cliport.cameras import Observation
from grs_agents.sim.cliport.goal_arguments import convert_to_goal
from grs_agents.sim.cliport.workcell import Workcell
from grs_agents.sim.goals import ScoredTask, StrictScorer
from grs_agents.sim.instance import (
    ActionRecord,
    Episode,
    Recorder,
    SimulationError,
    make_stop_from_error,
    set_last_recorder,
)
from grs_agents.sim.motion import PickPlace, PickPlaceResult, Push, PushResult
from grs_agents.sim.world import DEFAULT_BUDGET, Budget, parse_pose, templates

Action = Mapping[str, Any]
Info = dict[Any, Any]


class EpisodeTask(ScoredTask, Protocol):
    """What the environment asks of a task: ``sim.Task`` has it, and programs override parts of it."""

    max_steps: int
    ee: Any
    primitive: Any

    def reset(self, env: "Environment") -> None:
        """Set the scene up and state the goals."""
        ...

    def reward(self) -> tuple[float, dict[str, Any]]:
        """What was gained since the last call."""
        ...

    def done(self) -> bool:
        """Whether every goal is met."""
        ...

    def get_lang_goal(self) -> str:
        """The current goal in words."""
        ...


class Environment(Workcell):
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

    def __init__(
        self,
        assets_root: str | Path | None = "",
        task: EpisodeTask | None = None,
        disp: bool = False,
        shared_memory: bool = False,
        hz: int = 240,
        record_cfg: Any = None,
        *,
        library: Library | None = None,
        seed: int | None = None,
        budget: int = DEFAULT_BUDGET,
        robot: str | None = None,
    ) -> None:
        self.assets_root = str(assets_root or "")
        self.disp, self.shared_memory, self.hz, self.record_cfg = disp, shared_memory, hz, record_cfg
        library = library or templates.default_library()
        if self.assets_root and Path(self.assets_root).is_dir():
            library = library.with_overlay(Path(self.assets_root))
        super().__init__(library, Budget(budget), get_arm(robot or templates.defaults.robot), seed)
        self.pix_size = 0.003125
        self.task: EpisodeTask | None = None
        self.failed_placements = 0
        pybullet.set_current_environment(self)
        if task is not None:
            self.set_task(task)

    def set_task(self, task: EpisodeTask) -> None:
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
        self.remove_all_objects()
        self.failed_placements = 0
        self.warnings.clear()
        self.recorder.look = None  # what it tells of is being cleared away
        self.recorder = Recorder(max_steps=int(self.task.max_steps))
        set_last_recorder(self.recorder)
        try:
            self.tool = "spatula" if end_effectors.uses_push_primitive(self.task.ee, self.task.primitive) else "suction"
            self.task.reset(self)
        except GrsError as error:
            self.recorder.stop = make_stop_from_error(error)
            raise
        self.task.goals = [convert_to_goal(goal) for goal in self.task.goals]
        self.task.grs.finish_reset(self)
        if settle:
            self.settle_scene()
            self.places = {number: self.get_object_pose(number) for number in self._objects}
            self.recorder.look = self._update_recorder_scores
        return self.observation

    @property
    def info(self) -> Info:
        """``{id: (position, rotation, size), ..., 'lang_goal': str}``."""
        info: Info = {number: (*self.get_object_pose(number), self.get_object_size(number)) for number in self._objects}
        info["lang_goal"] = self.get_lang_goal()
        return info

    def get_lang_goal(self) -> str:
        """The current goal in words."""
        return self.task.get_lang_goal() if self.task is not None else ""

    @property
    def observation(self) -> Observation:
        """``{'color': three images, 'depth': three images}``, rendered when they are read."""
        return Observation(self.visible_scene)

    @property
    def current_episode(self) -> Episode:
        """How the current episode stands."""
        return self.recorder.build_episode()

    def step(self, action: Action | None = None) -> tuple[Observation, float, bool, Info]:
        """Pick and place once, or push once if that is the task's primitive, then score.

        Args:
            action: ``{'pose0': pick pose, 'pose1': place pose}`` of the suction cup's tip, or the poses from and
                towards which to push; None to wait.

        Returns:
            (observation, reward added by this step, done, info). ``done``: all goals met, or ``max_steps`` used.
        """
        if self.task is None:
            raise SimulationError("env.step() without a task", "call env.set_task(task) first")
        if action is None:
            self.physics.step(10)
            reward = self.task.reward()[0]
        else:
            missing = {"pose0", "pose1"} - set(action)
            if missing:
                raise SimulationError(
                    f"env.step: the action has no {min(missing)}", "give {'pose0': (xyz, quaternion), 'pose1': ...}"
                )
            reward = self._execute_action(parse_pose(action["pose0"], "pose0"), parse_pose(action["pose1"], "pose1"))
        done = self.task.done() or len(self.recorder.actions) >= self.task.max_steps
        return self.observation, reward, done, self.info

    def _execute_action(self, pose0: Pose, pose1: Pose) -> float:
        """Do what the task's primitive does, score, and write it down; returns the reward that it added."""
        if self.tool == "spatula":
            pushed = self.push(pose0, pose1)
            moved, number, note = pushed.pushed, next(iter(pushed.pushed), None), pushed.note
        else:
            result = self.pick_place(pose0, pose1)
            moved, number, note = (), result.grasped, result.note
        self.physics.raise_if_diverged()
        reward = self.task.reward()[0] if self.task is not None else 0.0
        asset = "" if number is None else self.object_by_id(number).asset
        self.recorder.actions.append(
            ActionRecord(
                object=number, asset=asset, pick=pose0[0], place=pose1[0], reward=reward, note=note, pushed=moved
            )
        )
        return reward

    def push(self, pose0: Pose, pose1: Pose) -> PushResult:
        """Push along the table from one pose to another with the spatula; does not score."""
        return Push(self.physics, self.collider_prisms(), self._asset_names_by_id()).push(pose0, pose1)

    def pick_place(self, pick: Pose, place: Pose) -> PickPlaceResult:
        """Pick at one pose of the tip and place at another; does not score."""
        return PickPlace(self.physics, self.collider_prisms(), self._asset_names_by_id()).pick_and_place(pick, place)

    def _asset_names_by_id(self) -> dict[int, str]:
        return {number: item.asset for number, item in self._objects.items()}

    def _update_recorder_scores(self, recorder: Recorder) -> None:
        if self.task is None:
            return
        recorder.reward, recorder.complete = self.task.grs.total, self.task.done()
        recorder.placed, recorder.wanted = self.task.grs.count_placed_objects()
        score = StrictScorer(self.task, self, self.places).score_scene()
        recorder.strict, recorder.weakest, recorder.shortfalls = score.value, score.weakest, score.shortfalls
