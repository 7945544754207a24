"""Evaluation of a policy on a suite: episodes in processes, resumed where interrupted, each with a typed outcome."""

import importlib.metadata
import json
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NoReturn

import numpy as np
import numpy.typing as npt
from pydantic import Field, ValidationError

from grs_agents.base import Frozen, Pose
from grs_agents.base.errors import GrsError, InputError, UnknownNameError
from grs_agents.base.files import write_json, write_text
from grs_agents.base.foreign.files import MOST_BYTES, read_json, read_text
from grs_agents.base.geometry import transforms
from grs_agents.base.ray_cluster import Engine, map_on_cluster
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.goals.scores import DISTURBED, MET
from grs_agents.sim.hands.two_fingers import TwoFingerHand
from grs_agents.sim.rendering.scene_cameras import Backend
from grs_agents.sim.world.recording import MotionRecording
from grs_agents.tasks.envs.gym_environment import GrsEnv
from grs_agents.tasks.suites.layouts import CAMERA, ActionLayout, Layout
from grs_agents.tasks.suites.perturbation import Effect, Factor, PerturbedEpisode, Trial, fit_effects, perturb_episode
from grs_agents.tasks.suites.policies import (
    OWN_UNITS,
    EpisodeStart,
    Policy,
    PolicyFailure,
    check_policy,
    fit_layout_to_policy,
    make_policy,
)
from grs_agents.tasks.suites.statistics import (
    Interval,
    PairedComparison,
    clustered_interval,
    compare_pairs,
    wilson_interval,
)
from grs_agents.tasks.suites.suite import FILE, TASKS, Suite, Tag, Wording, find_word_tags, read_suite
from grs_agents.tasks.worker_pool import map_in_processes

EPISODES, ORDER, SUMMARY, LATENCIES, MOTIONS = (
    "episodes.jsonl",
    "order.json",
    "evaluation.json",
    "latencies.jsonl",
    "motions",
)
Outcome = Literal["success", "horizon", "simulation_error", "policy_error", "bad_reply", "timeout", "server_lost"]
_FALLEN: Final = 0.03
"""Least height (m) that a released object falls if it was dropped."""
_WATCHED: Final = 25
"""Actions after a release in which a fall counts as its."""
_TIPPED: Final = math.radians(15)


def _is_empty(value: object) -> bool:
    """Whether to leave a field out of the JSON: evaluations without perturbations have none."""
    return value is None or value == ()


class EvaluationOrder(Frozen):
    """Settings of an evaluation; equal orders of a deterministic policy give equal episodes."""

    suite: str  # SHA-256 of its file
    policy: str
    layout: Layout
    episodes: Annotated[int, Field(ge=1, le=100_000)] = 10  # of each task and wording
    words: tuple[Wording, ...] = ("default",)
    tasks: tuple[str, ...] = ()  # names; empty for all of the suite
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    timeout: Annotated[float, Field(gt=0, le=3600)] = 30.0  # of each reply of the policy, s
    latency: Annotated[float, Field(ge=0, le=60)] | Literal["measured"] = 0.0  # s that the robot waits for a reply
    renderer: Backend = "auto"
    # episodes are repeated with each factor by itself, and with all of them
    perturb: Annotated[tuple[Factor, ...], Field(exclude_if=_is_empty)] = ()

    @property
    def conditions(self) -> tuple[tuple[Factor, ...], ...]:
        """Factors that are drawn together: none, each by itself, all."""
        together = (self.perturb,) if len(self.perturb) > 1 else ()
        return ((), *((factor,) for factor in self.perturb), *together)


class EpisodeKey(Frozen):
    """Identity of an episode in an evaluation."""

    task: str
    words: Wording
    episode: int  # 0, 1, ...
    perturb: Annotated[tuple[Factor, ...], Field(exclude_if=_is_empty)] = ()  # to be drawn


class EpisodeResult(EpisodeKey):
    """An episode and its figures."""

    instance: int  # seed of the task instance
    instruction: str
    outcome: Outcome
    detail: str = ""
    success: bool  # solved at the end, by the strict score with nothing held
    strict: float  # strict score at the end, 0..1
    progress: float  # share of goals met at the end
    best_progress: float  # share of goals met at any release, or at the end
    steps: int  # actions
    seconds: float  # simulated
    path: float  # of the tip, m
    disturbed: tuple[str, ...] = ()  # bystanders that ended elsewhere
    dropped: int = 0  # releases from which an object fell
    factors: Annotated[tuple[Factor, ...], Field(exclude_if=_is_empty)] = ()  # drawn, see ``perturb_episode``
    camera: Annotated[Pose | None, Field(exclude_if=_is_empty)] = None  # shift of the cameras

    @property
    def key(self) -> EpisodeKey:
        """The identity alone."""
        return EpisodeKey(task=self.task, words=self.words, episode=self.episode, perturb=self.perturb)


class TaskSummary(Frozen):
    """Figures of the episodes of a task."""

    task: str
    tags: tuple[Tag, ...]
    success: Interval
    progress: float
    best_progress: float


class EvaluationSummary(Frozen):
    """Contents of ``evaluation.json``; all figures but the effects are of episodes without perturbation."""

    version: Literal[1] = 1
    policy: str
    suite: str  # its name
    success: Interval  # clustered by task
    progress: float
    best_progress: float
    tasks: tuple[TaskSummary, ...]
    by_tag: dict[str, Interval]
    by_words: dict[str, Interval]
    outcomes: dict[str, int]
    disturbed: float  # share of episodes with a bystander moved
    dropped: float  # objects dropped in an episode, mean
    seconds: float | None  # simulated time to success, mean
    path: float | None  # of the tip to success, m, mean
    latency: float | None  # of the policy's replies, s, mean
    effects: tuple[Effect, ...] = ()  # of perturbations and of words on success
    together: Interval | None = None  # success with all factors drawn, clustered by task


def evaluate(
    folder: Path,
    order: EvaluationOrder,
    out: Path,
    workers: int = 2,
    show: Callable[[int, int], None] = lambda done, total: None,
    engine: Engine = "local",
    address: str | None = None,
) -> EvaluationSummary:
    """Evaluate a policy on the suite in ``folder``; rows and motions go to ``out``, where an interrupted call resumes.

    Args:
        folder: of the suite.
        order: of the evaluation.
        out: folder of the results.
        workers: processes on this machine.
        show: gets the numbers of finished and of all episodes.
        engine: ``local`` starts processes on this machine, ``ray`` tasks on the cluster at ``address`` (None: a
            local cluster), whose CPUs bound the number of parallel episodes.
        address: of the cluster.

    Raises:
        InputError: the suite, the policy or the folder ``out`` cannot be used, or there is no cluster.
        GrsError: a process was killed, e.g. for lack of memory.
    """
    suite = read_suite(folder)
    keys = list(_list_episodes(suite, order))
    check_policy(order.policy, order.layout, order.timeout)  # before anything is written
    rows = _open_results(out, order)
    waiting = [key for key in keys if key not in rows]
    show(len(rows), len(keys))
    arguments = (folder.resolve(), order, out.resolve(), str(Path.cwd()))
    if engine == "ray":
        work = map_on_cluster(_run_episode, waiting, address, _lose_episode, _set_job, arguments)
    else:
        work = map_in_processes(_run_episode, waiting, workers, _set_job, arguments)
    with (
        closing(work),
        (out / EPISODES).open("a", encoding="utf-8") as file,
        (out / LATENCIES).open("a", encoding="utf-8") as times,
    ):
        for result, latencies in work:
            rows[result.key] = result
            rounded = json.dumps([round(seconds, 6) for seconds in latencies])
            for stream, text in ((file, result.model_dump_json()), (times, rounded)):
                stream.write(f"{text}\n")
                stream.flush()
                os.fsync(stream.fileno())
            show(len(rows), len(keys))
    results = [rows[key] for key in keys]
    write_text(out / EPISODES, "".join(f"{result.model_dump_json()}\n" for result in results), durable=True)
    summary = summarize(suite, order, results, _read_latencies(out))
    write_json(out / SUMMARY, summary.model_dump(mode="json"), durable=True)
    return summary


def make_order(folder: Path, policy: str, layout: Layout, **settings: Any) -> EvaluationOrder:
    """The order for the suite in ``folder``.

    Raises:
        InputError: the suite cannot be used, a task or wording is not in it, or the layout lacks observations of the
            policy.
    """
    suite = read_suite(folder)
    digest = sha256((folder / FILE).read_bytes()).hexdigest()
    layout = fit_layout_to_policy(policy, layout)
    try:
        order = EvaluationOrder(suite=digest, policy=policy, layout=layout, **settings)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise InputError(f"{'.'.join(map(str, first['loc']))}: {first['msg']}", "see grs evaluate --help") from error
    for name in order.tasks:
        suite.task(name)
    for task in suite.tasks:
        for words in order.words if not order.tasks or task.name in order.tasks else ():
            if words not in task.words:
                raise UnknownNameError("wording", words, task.words)
    return order


def read_results(out: Path) -> list[EpisodeResult]:
    """The episodes of an evaluation; a half-written last line is left out.

    Raises:
        InputError: the folder holds no evaluation.
    """
    file = out / EPISODES
    if not file.is_file():
        raise InputError(f"{out} holds no evaluation", "name a folder that `grs evaluate` wrote")
    rows: list[EpisodeResult] = []
    lines = read_text(file, most=MOST_BYTES).splitlines()
    for number, line in enumerate(lines, 1):
        try:
            rows.append(EpisodeResult.model_validate_json(line))
        except ValidationError as error:
            if number == len(lines):
                break  # the process was killed while it wrote
            raise InputError(f"{file}, line {number} is no episode", "evaluate again into another folder") from error
    return rows


def read_summary(out: Path) -> EvaluationSummary:
    """The figures of an evaluation. Raises InputError: the folder holds no finished evaluation."""
    try:
        return EvaluationSummary.model_validate(read_json(out / SUMMARY, "finish it with `grs evaluate`"))
    except ValidationError as error:
        raise InputError(f"{out / SUMMARY} is damaged", "evaluate again into another folder") from error


def motion_file_name(episode: EpisodeKey) -> str:
    """Name of the recorded motion of an episode, in the folder ``motions``."""
    return f"{'-'.join([episode.task, episode.words, str(episode.episode), *episode.perturb])}.npz"


def drawn_instance_name(episode: EpisodeKey) -> str:
    """Name of the instance of a perturbed episode, relative to the folder."""
    return f"instances/{Path(motion_file_name(episode)).stem}.json"


def compare_evaluations(first: Path, second: Path) -> PairedComparison:
    """Compare two policies on the episodes that both were evaluated on.

    Raises:
        InputError: a folder holds no evaluation, they are of different suites, or share no episodes.
    """
    suites = {read_json(folder / ORDER, "evaluate again").get("suite") for folder in (first, second)}
    if len(suites) > 1:
        raise InputError(f"{first} and {second} are evaluations on different suites", "name two of one suite")
    rows = {row.key: row for row in read_results(first)}
    pairs: dict[str, list[tuple[bool, bool]]] = {}
    for row in read_results(second):
        if (other := rows.get(row.key)) is not None and other.instance == row.instance:
            pairs.setdefault(row.task, []).append((other.success, row.success))
    if not pairs:
        raise InputError(f"{first} and {second} share no episodes", "evaluate with the same --episodes and --words")
    return compare_pairs(list(pairs.values()))


def summarize(
    suite: Suite, order: EvaluationOrder, results: Sequence[EpisodeResult], latencies: Sequence[float]
) -> EvaluationSummary:
    """The figures of an evaluation."""
    everything = results
    results = [row for row in everything if not row.perturb]
    together = [row for row in everything if order.perturb and row.factors == order.perturb]
    by_task = {task.name: [row for row in results if row.task == task.name] for task in suite.tasks}
    by_task = {name: rows for name, rows in by_task.items() if rows}
    tags = {task.name: task.tags for task in suite.tasks}

    def cluster(rows: Sequence[EpisodeResult]) -> Interval:
        tasks = {row.task: [float(other.success) for other in rows if other.task == row.task] for row in rows}
        return clustered_interval(list(tasks.values()))

    solved = [row for row in results if row.success]
    return EvaluationSummary(
        policy=order.policy,
        suite=suite.name,
        success=cluster(results),
        progress=_mean([row.progress for row in results]) or 0.0,
        best_progress=_mean([row.best_progress for row in results]) or 0.0,
        tasks=tuple(
            TaskSummary(
                task=name,
                tags=tags[name],
                success=wilson_interval(sum(row.success for row in rows), len(rows)),
                progress=_mean([row.progress for row in rows]) or 0.0,
                best_progress=_mean([row.best_progress for row in rows]) or 0.0,
            )
            for name, rows in by_task.items()
        ),
        by_tag={
            tag: cluster([row for row in results if tag in tags[row.task]])
            for tag in sorted({tag for name in by_task for tag in tags[name]})
        },
        by_words={words: cluster([row for row in results if row.words == words]) for words in order.words},
        outcomes={
            name: sum(row.outcome == name for row in results) for name in sorted({row.outcome for row in results})
        },
        disturbed=_mean([float(bool(row.disturbed)) for row in results]) or 0.0,
        dropped=_mean([float(row.dropped) for row in results]) or 0.0,
        seconds=_mean([row.seconds for row in solved]),
        path=_mean([row.path for row in solved]),
        latency=_mean(latencies),
        effects=fit_effects([_describe_trial(row) for row in everything]) if order.perturb else (),
        together=cluster(together) if together else None,
    )


def _describe_trial(row: EpisodeResult) -> Trial:
    return Trial(task=row.task, factors=row.factors, tags=find_word_tags(row.instruction), success=row.success)


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _list_episodes(suite: Suite, order: EvaluationOrder) -> Iterator[EpisodeKey]:
    for task in suite.tasks:
        if not order.tasks or task.name in order.tasks:
            for words in order.words:
                for factors in order.conditions:
                    for episode in range(order.episodes):
                        yield EpisodeKey(task=task.name, words=words, episode=episode, perturb=factors)


def _open_results(out: Path, order: EvaluationOrder) -> dict[EpisodeKey, EpisodeResult]:
    """The episodes that ``out`` holds of this order; a new folder is begun."""
    value = {**order.model_dump(mode="json"), "grs-agents": importlib.metadata.version("grs-agents")}
    if (out / ORDER).is_file():
        if read_json(out / ORDER, "name another folder") != json.loads(json.dumps(value)):
            raise InputError(f"{out} holds an evaluation with other settings", "name another folder with --out")
        rows = read_results(out) if (out / EPISODES).is_file() else []
        write_text(out / EPISODES, "".join(f"{row.model_dump_json()}\n" for row in rows), durable=True)
        return {row.key: row for row in rows}
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out} is there and holds no evaluation", "name another folder with --out")
    (out / MOTIONS).mkdir(parents=True, exist_ok=True)
    write_json(out / ORDER, value, durable=True)
    return {}


def _read_latencies(out: Path) -> list[float]:
    values: list[float] = []
    for line in read_text(out / LATENCIES, most=MOST_BYTES).splitlines():
        try:
            values += json.loads(line)
        except ValueError:  # half-written when the process was killed
            continue
    return values


# --- episodes, in worker processes


class _Job:
    """State of a process between episodes: the policy, and the environment of the last task."""

    def __init__(self, folder: Path, order: EvaluationOrder, out: Path) -> None:
        self.folder, self.order, self.out = folder, order, out
        self.suite = read_suite(folder)
        self.policy: Policy = make_policy(order.policy, order.layout, order.timeout)
        self._task, self._env, self._layout = "", None, order.layout

    def environment(self, task: str) -> tuple[GrsEnv, Layout]:
        """The environment of a task, and the layout with cameras that it has."""
        if self._env is None or self._task != task:
            if self._env is not None:
                self._env.close()
            place, seeds = self.folder / TASKS / task, self.suite.task(task).seeds
            layout = self.order.layout
            if self.order.policy in OWN_UNITS:
                layout = layout.model_copy(update={"action": ActionLayout()})
            probe = GrsEnv(place, seeds=seeds[:1], control=layout.control, normalized=False)
            instance = probe.instances[seeds[0]]
            if instance.camera is None:  # a task without a photo has no camera of it
                renamed = {
                    name: f"{CAMERA}front" if source == f"{CAMERA}photo" else source
                    for name, source in layout.observation.items()
                }
                layout = layout.model_copy(update={"observation": renamed})
            dof = get_arm(instance.robot, instance.mounted_hand).dof
            if layout.joints is not None and layout.joints != dof:
                raise InputError(
                    f"the layout is for an arm of {layout.joints} joints, the robot {instance.robot} has {dof}",
                    "evaluate on a suite of another robot, or give a layout of your own",
                )
            self._env, self._task, self._layout = (
                GrsEnv(
                    place,
                    control=layout.control,
                    cameras=layout.cameras,
                    image_size=layout.image_size,
                    reward="sparse",
                    normalized=False,
                    seeds=seeds,
                    renderer=self.order.renderer,
                ),
                task,
                layout,
            )
        return self._env, self._layout


_job: list[_Job] = []


def _set_job(folder: Path, order: EvaluationOrder, out: Path, here: str) -> None:
    if here not in sys.path:  # a policy's module may lie beside the command
        sys.path.insert(0, here)
    _job[:] = [_Job(folder, order, out)]


def _run_episode(key: EpisodeKey) -> tuple[EpisodeResult, list[float]]:
    job = _job[0]
    task = job.suite.task(key.task)
    env, layout = job.environment(key.task)
    instance = task.seeds[key.episode % len(task.seeds)]
    seed = int.from_bytes(sha256(f"{job.order.seed} {key.model_dump_json()}".encode()).digest()[:4], "big")
    perturbed = PerturbedEpisode(instance=env.folder.read_instance(instance), factors=())
    if key.perturb:
        perturbed = perturb_episode(perturbed.instance, key.perturb, seed, env.folder.library)
        write_json(job.out / drawn_instance_name(key), perturbed.instance.model_dump(mode="json"))
    env.instances[instance] = drawn = perturbed.instance  # whose distances are its own
    instruction = drawn.instruction if key.words == "specific" and drawn.instruction else task.words[key.words]
    instruction = perturbed.instruction or instruction
    observed, _ = env.reset(options={"instance": instance, "camera": perturbed.camera})
    hand = env.episode.physics.arm.hand
    stroke = hand.stroke if isinstance(hand, TwoFingerHand) else None
    watch = _Watch(env)
    recording = MotionRecording(env.episode.physics, env.episode.task.ids)
    low, high = env.action_bounds
    start = EpisodeStart(instruction, drawn, env.folder.library, low, high, seed)
    outcome, detail, latencies = "horizon", "", list[float]()
    ended = False
    try:
        with _time_limit(job.order.timeout):
            job.policy.reset(start)
        while not ended:
            begin = time.perf_counter()
            with _time_limit(job.order.timeout):
                reply = job.policy.act(layout.rename_observation(observed, instruction, stroke))
            latencies.append(time.perf_counter() - begin)
            try:
                actions = layout.read_actions(reply, len(low))
            except (ValueError, TypeError) as error:
                raise PolicyFailure("bad_reply", str(error)) from error
            wait = latencies[-1] if job.order.latency == "measured" else job.order.latency
            for action in (*watch.holding_actions(wait), *actions):
                observed, _, terminated, truncated, info = env.step(action.astype(np.float32))
                watch.after(action)
                ended = terminated or truncated
                if ended:
                    outcome = "success" if terminated else "simulation_error" if "error" in info else "horizon"
                    detail = str(info.get("error", ""))
                    break
    except PolicyFailure as error:
        outcome, detail = error.outcome, error.message
    except TimeoutError:
        outcome, detail = "timeout", f"no action within {job.order.timeout:g} s"
    recording.save(job.out / MOTIONS / motion_file_name(key))
    result = watch.result(key, instance, instruction, outcome, detail[:500])
    return result.model_copy(update={"factors": perturbed.factors, "camera": perturbed.camera}), latencies


def _lose_episode(key: EpisodeKey, why: str) -> NoReturn:
    raise GrsError(f"episode {key.episode} of {key.task}: {why}", "run the command again, it goes on")


@contextmanager
def _time_limit(seconds: float) -> Generator[None]:
    """Raise TimeoutError in Python code that takes longer; nothing happens outside the main thread of POSIX systems."""
    if not hasattr(signal, "setitimer"):
        yield
        return

    def stop(*_: object) -> None:
        raise TimeoutError

    try:
        before = signal.signal(signal.SIGALRM, stop)
    except ValueError:  # not the main thread
        yield
        return
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


class _Watch:
    """Measures an episode: the tip's path, goals met, falls, and bystanders."""

    def __init__(self, env: GrsEnv) -> None:
        self._env, episode = env, env.episode
        self._begin = float(episode.physics.data.time)
        self._tip = np.array(episode.physics.tip_position)
        self._path, self._best, self._steps, self._dropped = 0.0, 0.0, 0, 0
        self._held: int | None = None
        self._released: tuple[int, float, int] | None = None  # object, its height then, actions left to watch it
        self._last: npt.NDArray[np.float64] | None = None
        self._bystanders = self._bystander_poses()

    def _bystander_poses(self) -> dict[str, Pose]:
        episode = self._env.episode
        return {
            f"{item.asset} #{item.id}": episode.sim.get_object_pose(episode.task.ids[item.id])
            for item in episode.instance.objects
            if item.role == "bystander"
        }

    def holding_actions(self, seconds: float) -> list[npt.NDArray[np.float64]]:
        """Actions that keep the arm where it is for a time, with the gripper as it was."""
        rate = self._env.control_rate
        if not seconds or rate is None:
            return []
        hold = np.zeros(len(self._env.action_bounds[0])) if self._last is None else self._last.copy()
        if self._env.control_name == "joint_position":
            hold[:-1] = self._env.episode.physics.joint_positions if self._last is None else self._last[:-1]
        else:
            hold[:-1] = 0.0
        hold[-1] = -1.0 if self._last is None else self._last[-1]
        return [hold] * round(seconds * rate)

    def after(self, action: npt.NDArray[np.float64]) -> None:
        """An action was carried out."""
        physics = self._env.episode.physics
        tip = np.array(physics.tip_position)
        self._path += float(np.linalg.norm(tip - self._tip))
        self._tip, self._steps, self._last = tip, self._steps + 1, np.asarray(action, dtype=np.float64)
        held = physics.held_object_id
        if self._released is not None:
            number, height, left = self._released
            fallen = height - physics.object_pose(number)[0][2] > _FALLEN
            self._dropped += fallen
            self._released = None if fallen or not left else (number, height, left - 1)
        if self._held is not None and held != self._held:
            self._released = (self._held, physics.object_pose(self._held)[0][2], _WATCHED)
            self._best = max(self._best, self._progress())
        self._held = held

    def _progress(self) -> float:
        goals = self._env.episode.measure_goals()
        return float(np.mean([goal.strict >= MET for goal in goals])) if goals else 0.0

    def result(self, key: EpisodeKey, instance: int, instruction: str, outcome: Any, detail: str) -> EpisodeResult:
        """The figures at the end."""
        episode = self._env.episode
        diverged = outcome == "simulation_error"
        progress = 0.0 if diverged else self._progress()
        moved: list[str] = []
        if not diverged:
            for name, (position, rotation) in self._bystander_poses().items():
                before, turned_before = self._bystanders[name]
                tilt = transforms.angle_between_up_axes(turned_before, rotation)
                if math.dist(before, position) > DISTURBED or tilt > _TIPPED:
                    moved.append(name)
        return EpisodeResult(
            **key.model_dump(),
            instance=instance,
            instruction=instruction,
            outcome=outcome,
            detail=detail,
            success=outcome == "success",
            strict=0.0 if diverged else episode.strict_score,
            progress=progress,
            best_progress=max(self._best, progress),
            steps=self._steps,
            seconds=round(float(episode.physics.data.time) - self._begin, 6),
            path=self._path,
            disturbed=tuple(moved),
            dropped=self._dropped,
        )
