"""GRS from Python: run a graph on a scene, follow its events, check a program, read a run.

Settings are those of ``docs/configuration.md``, nested as there: ``run("groceries", seed=7, models={"default":
"openai:NAME"})``. Nothing is printed without ``progress`` or ``view``.
"""

import asyncio
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, Any

from grs_agents.agents.types import TaskDefinition
from grs_agents.base.config.load import load_config
from grs_agents.base.foreign.files import read_json, read_text
from grs_agents.base.trace.events import Event
from grs_agents.base.trace.log import EventLog, read_events
from grs_agents.perception.reading.scene_source import resolve_scene_path
from grs_agents.perception.types import SceneDescription, read_scene_description
from grs_agents.runs.execution import Views, execute_run
from grs_agents.runs.graph_loading import load_graph
from grs_agents.runs.hashes import add_hash
from grs_agents.runs.program_check import CheckResult, check_user_program, open_check_order
from grs_agents.runs.record import RunRecord, read_record
from grs_agents.runs.run_opening import RunOrder, find_recorded_scene
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.tasks.task_folder import open_task_folder
from grs_agents.views.common.foreign_decoding import decode_in_worker
from grs_agents.views.live_views import attach_live_views

if TYPE_CHECKING:
    from langchain_core.callbacks import BaseCallbackHandler

Callbacks = Sequence["BaseCallbackHandler"]
"""LangChain callback handlers."""
_REMEDY = "name a folder that `grs run` wrote"


class Run:
    """A run's folder: verdict, scene, task, programs and instances. Access to a stage that was not reached raises
    InputError."""

    def __init__(self, folder: Path | str) -> None:
        """Open a run's folder. Raises InputError: it holds no run, or one that is damaged."""
        self.folder = Path(folder)
        self.record: RunRecord = read_record(self.folder)

    def __repr__(self) -> str:
        return f"Run({str(self.folder)!r}): {self.record.status}, {self.record.reason}"

    @property
    def status(self) -> str:
        """``accepted``, ``rejected``, ``failed``, ``interrupted``, ``waiting`` or ``running``."""
        return self.record.status

    @property
    def accepted(self) -> bool:
        """Whether tests and audit accepted the task."""
        return self.record.status == "accepted"

    @property
    def events(self) -> list[Event]:
        """The events in order; their types are in `grs_agents.base.trace`."""
        return read_events(self.folder / "events.jsonl")

    @property
    def scene(self) -> SceneDescription:
        """The objects of the photo, in metres in the robot frame."""
        return read_scene_description(self.folder / "scene.json")

    @property
    def task(self) -> TaskDefinition:
        """The task in words."""
        return TaskDefinition.model_validate(read_json(self.folder / "task.json", _REMEDY))

    @property
    def simulation(self) -> str:
        """The simulation program."""
        return read_text(self.folder / "simulation.py", _REMEDY)

    @property
    def tests(self) -> str:
        """The tests of the program."""
        return read_text(self.folder / "test_simulation.py", _REMEDY)

    @property
    def instances(self) -> dict[int, TaskInstance]:
        """The task as data, by seed: objects, poses and goals, without generated code."""
        task = open_task_folder(self.folder, accepted=False)
        return {seed: task.read_instance(seed) for seed in task.seeds}

    def film(self, path: Path | str, seed: int | None = None) -> Path:
        """Film the rollout of ``seed``, by default the lowest, as .webp, .mp4 or .gif. Returns: the path."""
        from grs_agents.views.film.rollout_film import make_rollout_shot, write_film

        write_film(make_rollout_shot(self.folder, seed), Path(path))
        add_hash(self.folder, Path(path))
        return Path(path)

    def resume(
        self,
        reply: str | None = None,
        *,
        scene: Path | str | None = None,
        config: Path | str | None = None,
        progress: bool = False,
        callbacks: Callbacks = (),
        **settings: Any,
    ) -> "Run":
        """Resume a run that was interrupted, or that waits for a person's reply.

        Args:
            reply: to the question of a waiting run.
            scene: of the run, as for `run`. Required if its photo is not read yet: a folder, which may be foreign, does
                not choose a photo of this machine.
            config: a TOML file.
            progress: show each step on standard error.
            callbacks: as for `run`.
            **settings: of this machine, as for `run`: models, endpoints, files, limits. A run's folder cannot choose
                them; seed, graph, tools, prompts and bounds of the scene stay those of the run.

        Raises:
            ConfigError: a setting of the run must be repeated, or must not change.
            InputError: the folder alone names the photo that is to be read, or ``scene`` is another.
        """
        local = load_config(None if config is None else Path(config), overrides=settings)
        order = RunOrder(
            self.record.command,
            find_recorded_scene(self.folder) if scene is None else resolve_scene_path(Path(scene)),
            local,
            self.folder,
            resume=True,
            reply=reply,
            callbacks=tuple(callbacks),
            recorded_source=scene is None,
        )
        with decode_in_worker(self.folder):  # it may be a foreign folder
            return _execute_run_or_raise(order, partial(attach_live_views, progress=progress))


def run(
    scene: Path | str,
    /,
    *,
    out: Path | str | None = None,
    config: Path | str | None = None,
    progress: bool = False,
    view: bool = False,
    callbacks: Callbacks = (),
    **settings: Any,
) -> Run:
    """Make a validated task from a photo with depth, as ``grs run`` does.

    Args:
        scene: a folder, file or ``bop:`` image as in docs/scenes.md, or the name of a shipped scene.
        out: the run folder, new or empty; by default ``runs/<time>-<scene>-<seed>``.
        config: a TOML file.
        progress: show each step on standard error.
        view: open the rerun viewer.
        callbacks: LangChain callback handlers, of the graph and of each call of a model.
        **settings: of the configuration; they override the file and the environment. ``graph="scene"`` comprehends the
            photo alone, as ``grs scene`` does.

    Returns:
        The run, accepted or not; ``waiting`` if it asks a person (`Run.resume` continues it).

    Raises:
        ConfigError, InputError: scene, folder or settings are refused.
        GrsError: the run failed; its folder holds the stages reached.
        KeyboardInterrupt: it was interrupted; `Run.resume` continues it.
    """
    order = _build_order_from_config(scene, out, config, callbacks, settings)
    return _execute_run_or_raise(order, partial(attach_live_views, view=view, progress=progress))


async def arun(
    scene: Path | str,
    /,
    *,
    out: Path | str | None = None,
    config: Path | str | None = None,
    callbacks: Callbacks = (),
    **settings: Any,
) -> Run:
    """`run` in a thread; cancelling it interrupts the run before its next event."""
    started = stream(scene, out=out, config=config, callbacks=callbacks, **settings)
    try:
        return await asyncio.to_thread(started.wait)
    except asyncio.CancelledError:
        await asyncio.to_thread(started.stop)
        raise


def stream(
    scene: Path | str,
    /,
    *,
    out: Path | str | None = None,
    config: Path | str | None = None,
    callbacks: Callbacks = (),
    **settings: Any,
) -> "RunStream":
    """Start a run and follow its events: ``for event in stream("groceries"): ...``. Arguments as for `run`."""
    return RunStream(_build_order_from_config(scene, out, config, callbacks, settings))


def check(
    program: Path | str,
    /,
    *,
    tests: Path | str | None = None,
    task: Path | str | None = None,
    photo: Path | str | None = None,
    out: Path | str | None = None,
    config: Path | str | None = None,
    **settings: Any,
) -> CheckResult:
    """Check a simulation program in the sandbox, as a run checks its own: its tests, then the audit.

    Args:
        program: a Python file, or the folder of a run.
        tests: pytest file of the program.
        task: a ``task.json``; without it the wording is not judged.
        photo: the reference of the program: a photo, its ``scene.json``, or the folder of a run of it.
        out: a new or empty folder, in which an accepted task is kept for `make_env` and the commands that use tasks.
        config: a TOML file.
        **settings: of the configuration.

    Raises:
        ConfigError, InputError: a file or setting is refused.
    """
    tests, task, photo, out = (None if file is None else Path(file) for file in (tests, task, photo, out))
    chosen = load_config(None if config is None else Path(config), overrides=settings)
    views = partial(attach_live_views, progress=False)
    with open_check_order(Path(program), tests, task, photo, chosen, views, out) as order:
        return check_user_program(order)


class RunStream(Iterator[Event]):
    """Iterator over the events of a run, which goes on in a thread. End it early with `stop`."""

    def __init__(self, order: RunOrder) -> None:
        self._events: SimpleQueue[Event | None] = SimpleQueue()
        self._stopped = False
        self._run: Run | None = None
        self._error: BaseException | None = None
        self._thread = Thread(target=self._run_in_thread, args=(order,), daemon=True)
        self._thread.start()

    def __next__(self) -> Event:
        event = self._events.get()
        if event is not None:
            return event
        self._events.put(None)
        self.wait()
        raise StopIteration

    def wait(self) -> Run:
        """Wait for the end of the run. Raises its error, as `run` does."""
        self._thread.join()
        if self._error is not None:
            raise self._error
        assert self._run is not None
        return self._run

    def stop(self) -> None:
        """Interrupt the run before its next event and wait for its end; an ended run is unchanged."""
        self._stopped = True
        self._thread.join()

    def _run_in_thread(self, order: RunOrder) -> None:
        try:
            self._run = _execute_run_or_raise(order, self._attach_queue)
        except (Exception, KeyboardInterrupt) as error:  # re-raised in `wait`
            self._error = error
        finally:
            self._events.put(None)

    @contextmanager
    def _attach_queue(self, folder: Path, log: EventLog) -> Generator[None]:
        def queue_event_or_stop(event: Event) -> None:
            self._events.put(event)
            if self._stopped and event.kind != "run_ended":
                raise KeyboardInterrupt

        with attach_live_views(folder, log, progress=False):
            log.subscribe(queue_event_or_stop)
            yield


def _build_order_from_config(
    scene: Path | str,
    out: Path | str | None,
    config: Path | str | None,
    callbacks: Callbacks,
    settings: dict[str, Any],
) -> RunOrder:
    chosen = load_config(None if config is None else Path(config), overrides=settings)
    command = "run" if getattr(load_graph(chosen.config.graph), "VERDICT", True) else "scene"
    place = None if out is None else Path(out)
    return RunOrder(command, resolve_scene_path(Path(scene)), chosen, place, callbacks=tuple(callbacks))


def _execute_run_or_raise(order: RunOrder, views: Views) -> Run:
    ended = execute_run(order, views)
    if ended.problem is not None:
        raise ended.problem
    if ended.record.status == "interrupted":
        raise KeyboardInterrupt(f"the run in {ended.folder} was interrupted")
    return Run(ended.folder)
