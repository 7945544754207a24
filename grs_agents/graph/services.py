"""The services of a run, which its nodes share: the context of the graph, which is never checkpointed."""

import os
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from pydantic import ValidationError

from grs_agents.agents.agent import Agents
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import ConfigError, InputError
from grs_agents.base.questions import parse_question
from grs_agents.base.trace.events import NodeEnded, NodeStarted, Note, summarise_value
from grs_agents.base.trace.log import EventLog
from grs_agents.graph.policies.types import Policy
from grs_agents.graph.state import RunState, parse_state
from grs_agents.library.library import Library
from grs_agents.perception.picture_files import load_frame
from grs_agents.perception.types import FARTHEST, RGBDFrame, TableFrame
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.arms.arm_files import ROBOT_FOLDER, copy_arm_files
from grs_agents.sim.arms.registry import ROBOTS, get_arm
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.toolkit import ToolContext, load_tool

if TYPE_CHECKING:  # LangGraph takes long to import, and a check of programs runs no graph
    from langgraph.runtime import Runtime

Update = dict[str, Any]
Photo = tuple[RGBDFrame, TableFrame]
"""An RGB-D frame and the table in it."""
Body = Callable[[RunState, "Services"], Update]
Stamp = tuple[str, int, int, int]
"""Path, inode, time of change (ns) and size of a file; differs once the file is written again."""


class Node(Protocol):
    """A node as LangGraph calls it."""

    def __call__(self, state: RunState, *, runtime: "Runtime[Services]") -> Update:
        """Returns: the changes of the state."""
        ...


@dataclass(frozen=True)
class Services:
    """The services of a run."""

    config: Config
    log: EventLog
    agents: Agents
    policy: Policy
    sandbox: Sandbox  # where generated code runs
    folder: Path
    visits: Counter[str] = field(default_factory=Counter[str])  # of each node
    recorded_source: bool = False  # the run's record names the scene, and the user does not
    assets: Path | None = None  # the folder of the run's own assets; `assets` in `folder` by default
    _overlaid: dict[frozenset[Stamp], Library] = field(
        default_factory=dict[frozenset[Stamp], Library], init=False, repr=False, compare=False
    )
    _photos: list[RGBDFrame] = field(default_factory=list["RGBDFrame"], init=False, repr=False, compare=False)

    @property
    def library(self) -> Library:
        """The shipped assets overlaid with the proxies of the run; read again only when a proxy has changed."""
        proxies = self.assets or self.folder / "assets"
        if not proxies.is_dir():
            return self._shipped_library
        stamps: set[Stamp] = set()
        for folder, _, files in os.walk(proxies):  # each of many steps of a node comes here
            for path in (Path(folder, name) for name in files):
                with suppress(FileNotFoundError):  # the temporary file of a proxy that is written just now
                    status = path.stat()
                    stamps.add((str(path), status.st_ino, status.st_mtime_ns, status.st_size))
        key = frozenset(stamps)
        library = self._overlaid.get(key)
        if library is None:
            library = self._shipped_library.copy_with_overlay_root(proxies)
            for before, earlier in list(self._overlaid.items()):
                changed = {Path(stamp[0]).relative_to(proxies).as_posix() for stamp in key ^ before}
                library.keep_unchanged(earlier, changed)
            self._overlaid.clear()
            self._overlaid[key] = library
        return library

    def cache_photo(self, frame: RGBDFrame) -> None:
        """Keep the photo that the node ``read`` has written, so that `load_photo` need not decode it."""
        self._photos[:] = [frame]

    def load_photo(self, state: RunState) -> RGBDFrame:
        """The photo that the node ``read`` wrote into the run folder; after a resume it is decoded once."""
        if not self._photos:
            self._photos.append(load_frame(self.folder, state["camera"], state["scene_path"]))
        return self._photos[0]

    @cached_property
    def _shipped_library(self) -> Library:
        return Library()

    @cached_property
    def robot_name_or_path(self) -> str:
        """Name of the arm, or absolute path of its file: of the copy in the run folder if it can be copied."""
        robot = self.config.robot
        if robot in ROBOTS:
            return robot
        source = Path(robot).resolve()
        copied = copy_arm_files(source, self.folder.resolve() / ROBOT_FOLDER, self.config.own_hand)
        if copied is None and self.config.own_hand is not None:
            get_arm(str(source))  # its own error, if the file is no arm
            raise ConfigError(
                f"own_hand: the files of {robot} cannot be copied into the run",
                "keep them in one folder, by relative paths",
            )
        return str(copied or source)

    @cached_property
    def farthest(self) -> float:
        """Radius of the workspace in prompts, metres: less for a user's arm that reaches less far."""
        if self.robot_name_or_path in ROBOTS:
            return FARTHEST
        return min(FARTHEST, round(self.arm.farthest, 3))

    @property
    def arm(self) -> Arm:
        """The robot with its hand."""
        return get_arm(self.robot_name_or_path, self.config.hand)

    @property
    def library_root_fields(self) -> dict[str, Any]:
        """The field of a simulating tool's request that names the folders of the assets."""
        return {"library_roots": [str(root) for root in self.library.roots]}

    def __post_init__(self) -> None:
        """Refuse a robot that cannot be used before anything is spent on the run."""
        if self.robot_name_or_path not in ROBOTS:
            try:
                _ = self.arm
            except InputError:
                get_arm(str(Path(self.config.robot).resolve()), self.config.hand)  # which names the user's own file
                raise
            robot = (self.robot_name_or_path, self.config.hand)
            self.sandbox.preload("grs_agents.sim.arms.registry:prepare_arm", robot, [Path(robot[0]).parent])

    def render_instance(self, instance: TaskInstance, output: Path, **view: Any) -> Any:
        """Draw a task instance into the picture ``output``.

        Args:
            view: further fields of the request of the tool ``render``.

        Returns:
            the tool's result, whose ``image`` is None where nothing could be drawn.
        """
        request = {"instance": instance.model_dump(mode="json"), "output": str(output.resolve())}
        return self.run_tool("render", **request, **view, **self.library_root_fields)

    def run_tool(self, name: str, **request: Any) -> Any:
        """Run the tool ``name`` with the fields of its request."""
        tool = load_tool(name)
        try:
            tool_request = tool.Request(**request)
        except (ValidationError, TypeError) as error:
            first = str(error).splitlines()[0]
            remedy = f"name a tool whose Request has {', '.join(request)}"
            raise ConfigError(f"tool {name!r} cannot take the request: {first}", remedy) from error
        context = ToolContext(
            sandbox=self.sandbox,
            library=self.library,
            limits=self.config.limits,
            say=lambda text: self.log.append(Note(level="info", text=text)),
        )
        return tool.run(tool_request, context)


def logged_node(name: str) -> Callable[[Body], Node]:
    """Wrap the body of the node ``name``: its start, end, seconds and errors become events."""

    def wrap(body: Body) -> Node:
        @wraps(body)
        def run(state: RunState, *, runtime: "Runtime[Services]") -> Update:
            from langgraph.errors import GraphInterrupt

            services = runtime.context
            services.visits[name] += 1
            services.log.attempt = state.get("fixes", 0)
            with services.log.step(NodeStarted(node=name, visit=services.visits[name])):
                begin = time.perf_counter()
                update: Update = {}
                error = ""
                try:
                    update = body(parse_state(state), services)
                except GraphInterrupt as interrupt:  # the node begins anew with the reply
                    services.log.append(
                        Note(level="info", text=f"asks: {parse_question(interrupt.args[0][0].value).text}")
                    )
                    raise
                except BaseException as problem:
                    error = f"{type(problem).__name__}: {problem}"
                    raise
                finally:
                    services.log.append(
                        NodeEnded(
                            node=name,
                            seconds=time.perf_counter() - begin,
                            changed=tuple(update),
                            values={key: summarise_value(value) for key, value in update.items()},
                            error=error,
                        )
                    )
                return update

        # LangGraph reads the annotations of a node, and ``wraps`` has put those of the body there.
        run.__annotations__ = {"state": RunState, "runtime": Any, "return": Update}
        del run.__wrapped__
        return run

    return wrap
