"""The environment: typed objects on a table, an arm with a suction cup, rewards from the task."""

import math
from collections.abc import AsyncGenerator, Callable, Coroutine, Generator, Mapping
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from grs_agents.base import Pose, Vec3
from grs_agents.base.errors import GrsError
from grs_agents.library.library import Library
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.cliport import end_effectors, pybullet
from grs_agents.sim.cliport.cameras import Observation
from grs_agents.sim.cliport.workcell import Workcell
from grs_agents.sim.goals.strict_score import StrictScorer
from grs_agents.sim.goals.task_accounting import ScoredTask
from grs_agents.sim.instance.episode import (
    ActionRecord,
    Episode,
    Recorder,
    SimulationError,
    make_stop_from_error,
    set_last_recorder,
)
from grs_agents.sim.instance.task_instance import InstanceObject
from grs_agents.sim.motion import placement
from grs_agents.sim.motion.pick_place import PickPlace, PickPlaceResult
from grs_agents.sim.motion.push import Push, PushResult
from grs_agents.sim.world import templates
from grs_agents.sim.world.budget import DEFAULT_BUDGET, Budget
from grs_agents.sim.world.footprints import Prism, object_prism_at_pose, signed_outline_gaps
from grs_agents.sim.world.spec import load_object_model
from grs_agents.sim.world.tabletop import parse_pose

_SETTLED, _SUNK = 0.01, 0.03
"""What settling moves sideways, or lets fall, by more than this did not stay where the program put it, metres."""
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

    def finish_goals(self, env: "Environment") -> None:
        """Read the goals as they are stated when ``reset`` ends."""
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


class Witness(Protocol):
    """What watches every environment of a process, and may change what was set up."""

    def begin_reset(self, env: "Environment") -> None:
        """A reset begins; the last scene still stands."""
        ...

    def finish_reset(self, env: "Environment") -> None:
        """The task has set its scene up, nothing has settled yet."""
        ...

    def run_or_replay_action(
        self, env: "Environment", pick: Pose, place: Pose, act: Callable[[Pose, Pose], PickPlaceResult]
    ) -> PickPlaceResult:
        """Do an action with ``act``, or what came of the same one."""
        ...

    def finish_step(self, env: "Environment") -> None:
        """An action was scored."""
        ...

    def watch_oracle(self, oracle: Any, env: "Environment") -> Any:
        """The oracle that a test is given in place of one."""
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

    witness: ClassVar[Witness | None] = None

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
            library = library.copy_with_overlay_root(Path(self.assets_root))
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
        if self.witness is not None:
            self.witness.begin_reset(self)
        self.recorder.freeze()
        self.places = {}
        self.remove_all_objects()
        self.failed_placements = 0
        self.recorder = Recorder(parse_max_steps(self.task.max_steps))
        set_last_recorder(self.recorder)
        try:
            self.tool = "spatula" if end_effectors.uses_push_primitive(self.task.ee, self.task.primitive) else "suction"
            _refuse_unfinished_reset(self.task.reset(self))
            self.task.finish_goals(self)
        except GrsError as error:
            self.recorder.stop = make_stop_from_error(error)
            raise
        self.task.grs.finish_reset(self)
        self.restore_bystanders()
        if self.witness is not None:
            self.witness.finish_reset(self)
        if settle:
            placed = {number: self.get_object_pose(number) for number in self._objects}
            self.settle_scene()
            self.places = {number: self.get_object_pose(number) for number in self._objects}
            self.recorder.measure = StrictScorer(self.task, self).measure_scene
            self._warn_about_settling(placed)
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
        if self.witness is not None:
            self.witness.finish_step(self)
        return self.observation, reward, done, self.info

    def _execute_action(self, pose0: Pose, pose1: Pose) -> float:
        """Do what the task's primitive does, score, and write it down; returns the reward that it added."""
        if self.tool == "spatula":
            pushed = self.push(pose0, pose1)
            moved, number, note, trouble = pushed.pushed, next(iter(pushed.pushed), None), pushed.note, None
        else:
            result = self.pick_place(pose0, pose1)
            moved, number, note, trouble = (), result.grasped, result.note, result.trouble
        self.physics.raise_if_diverged()
        reward = self.task.reward()[0] if self.task is not None else 0.0
        asset = "" if number is None else self.object_by_id(number).asset
        self.recorder.actions.append(
            ActionRecord(
                object=number,
                asset=asset,
                pick=pose0[0],
                place=pose1[0],
                reward=reward,
                note=note,
                trouble=trouble,
                pushed=moved,
            )
        )
        set_last_recorder(self.recorder)
        return reward

    def push(self, pose0: Pose, pose1: Pose) -> PushResult:
        """Push along the table from one pose to another with the spatula; does not score."""
        return Push(self.physics, self.collider_prisms, self.object_labels).push(pose0, pose1)

    def pick_place(self, pick: Pose, place: Pose) -> PickPlaceResult:
        """Pick at one pose of the tip and place at another; does not score."""
        act = PickPlace(self.physics, self.collider_prisms, self.object_labels).pick_and_place
        return act(pick, place) if self.witness is None else self.witness.run_or_replay_action(self, pick, place, act)

    def replace_object(self, item: InstanceObject) -> None:
        """Put another object in the place of the one with its id, before anything has moved."""
        self.object_by_id(item.id)
        self._objects[item.id], self._models[item.id] = item, load_object_model(item, self.library)
        self._physics, self._stale = None, False

    @property
    def object_labels(self) -> dict[int, str]:
        """``asset #id`` of each object, as episodes name it."""
        return {number: f"{item.asset} #{number}" for number, item in self._objects.items()}

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

    def _warn_about_settling(self, placed: Mapping[int, Pose]) -> None:
        """Note what did not stay where the program put it, and why not."""
        moved = [n for n, start in placed.items() if _has_moved_while_settling(start[0], self.places[n][0])]
        prisms = {n: object_prism_at_pose(self.object_model(n), placed[n]) for n in placed} if moved else {}
        label = self.object_labels
        for number in moved:
            start, end = placed[number][0], self.places[number][0]
            within = [label[n] for n in placed if n != number and _are_prisms_overlapping(prisms[number], prisms[n])]
            why = f"was put into {' and '.join(within)}" if within else "was put in the air, or did not stand"
            ways = f"from {placement.format_point(start)} to {placement.format_point(end)}"
            self.record_warning(f"{label[number]} {why}: settling moved it {math.dist(start, end):.3f} m, {ways}")


def parse_max_steps(value: Any) -> int:
    """The actions that a task allows; raises ``SimulationError`` for what is no number."""
    try:
        return int(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise SimulationError(f"max_steps is {value!r}"[:150], "give a whole number of actions") from error


def _refuse_unfinished_reset(returned: object) -> None:
    """Refuse a ``reset`` whose body has not run: to call it only makes a coroutine or a generator."""
    if isinstance(returned, Coroutine | Generator | AsyncGenerator):
        if not isinstance(returned, AsyncGenerator):
            returned.close()  # else Python warns that nobody awaited it
        kind = "a generator (it has a yield)" if isinstance(returned, Generator) else "asynchronous (async def)"
        raise SimulationError(
            f"reset is {kind}, so that nothing in it ran when it was called",
            "write `def reset(self, env):` without async or yield",
        )


def _has_moved_while_settling(start: Vec3, end: Vec3) -> bool:
    return math.dist(start[:2], end[:2]) > _SETTLED or abs(start[2] - end[2]) > _SUNK


def _are_prisms_overlapping(first: Prism, second: Prism) -> bool:
    """Whether two objects reach more than 2 mm into each other, upwards and sideways."""
    upwards = min(first.high, second.high) - max(first.low, second.low)
    return upwards > 0.002 and signed_outline_gaps(first.outline, second.outline, np.zeros((1, 2)))[0] < -0.002
