"""GRS as a server of the Model Context Protocol: agents comprehend photos, check programs and inspect runs.

It serves on stdio, or over HTTP on 127.0.0.1 only. Programs run in the sandbox.
"""

import asyncio
import json
import os
import signal
import tempfile
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial, wraps
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

from pydantic import Field, ValidationError

from grs_agents.api import Run, RunStream
from grs_agents.base import content, interrupts
from grs_agents.base.config.load import EffectiveConfig, change_config
from grs_agents.base.control_characters import escape_control_chars
from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.files import check_path_name, convert_system_error, write_text
from grs_agents.base.foreign.files import is_folder, list_folder_names, parse_json, read_bytes, read_text
from grs_agents.base.foreign.run_folder import resolve_member_file
from grs_agents.base.version import __version__
from grs_agents.perception.reading.scene_source import resolve_scene_path
from grs_agents.runs.graph_loading import load_graph
from grs_agents.runs.program_check import check_user_program, open_check_order
from grs_agents.runs.record import read_record
from grs_agents.runs.run_opening import RUNS, RunOrder
from grs_agents.runs.sandbox_setup import open_sandbox
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.tasks.task_folder import open_task_folder
from grs_agents.toolkit import ToolContext, load_tool, open_library
from grs_agents.views.common.event_steps import group_events_into_steps
from grs_agents.views.common.step_text import find_step_by_number, iter_step_sections
from grs_agents.views.live_views import attach_live_views
from grs_agents.views.terminal import step_to_dict

if TYPE_CHECKING:
    from mcp.server.mcpserver import MCPServer

_MOST_BYTES = 1 << 23
"""Largest file sent to a client, bytes; the events of the sample run take 1 MB."""
_MOST_LINE = 1 << 23
"""Longest message of a client, bytes; a program and its tests have at most 2 MB."""
_INSTRUCTIONS = """GRS turns a photo with depth of a table into a simulated robot task that an oracle has solved.
`scene` finds the objects of a photo. Write a simulation program of a task with them (a subclass of CLIPort's Task) and
`check` it; or let `run` make the task, its program and its tests, which takes minutes. `rollout`, `render` and `show`
look at a run. The resource grs://runs lists the runs; grs://prompts/NAME is a prompt. Lengths are metres in the robot
frame: x forward, y left, z up from the table top."""

_PATHS = frozenset({"photo", "folder", "scene"})
"""Arguments that are paths."""
Photo = Annotated[
    str, Field(description="A folder with rgb.png, depth.png and camera.json, an .npz file, or a shipped scene's name.")
]
Folder = Annotated[str, Field(description="A run folder, as `scene` or `grs run` leaves it.")]
Seed = Annotated[int, Field(description="The seed of the task instance.", ge=0)]
Source = Annotated[str, Field(description="Python source of a simulation program with one Task subclass.")]
Tests = Annotated[str | None, Field(description="Python source of its unit tests, which import `task_code`.")]
Scene = Annotated[str | None, Field(description="The run folder of the scene that the program must keep to.")]
Moment = Annotated[Literal["start", "end"], Field(description="Before or after the robot's work.")]
RunSeed = Annotated[int | None, Field(description="The seed of everything random; another seed makes another task.")]
Step = Annotated[int | None, Field(description="The number of one step, to be shown in full; all steps without one.")]


@dataclass(frozen=True)
class GrsTools:
    """The tools of the server. Each raises GrsError, whose text is sent to the client."""

    chosen: EffectiveConfig  # of the server's command line
    sandbox: Sandbox  # shared by all calls, so that MuJoCo is imported once

    def scene(self, photo: Photo) -> dict[str, Any]:
        """Comprehend a photo with depth: its objects with sizes and positions in metres, and a run folder."""
        config = replace(self.chosen, config=change_config(self.chosen.config, graph="scene"))
        run = RunStream(RunOrder("scene", resolve_scene_path(Path(photo)), config)).wait()
        return {"folder": str(run.folder), **run.scene.model_dump(mode="json", include={"objects", "warnings"})}

    def check(self, simulation: Source, tests: Tests = None, scene: Scene = None) -> dict[str, Any]:
        """Check a simulation program in the sandbox: its tests, then the audit, in which the oracle solves it."""
        with tempfile.TemporaryDirectory(prefix="grs-mcp-") as folder:
            program = write_text(Path(folder) / "task_code.py", simulation)
            suite = None if tests is None else write_text(Path(folder) / "test_task_code.py", tests)
            photo, views = None if scene is None else Path(scene), partial(attach_live_views, progress=False)
            with open_check_order(program, suite, None, photo, self.chosen, views) as order:
                result = check_user_program(order)
        return {
            "accepted": result.accepted,
            "tests": result.tests and result.tests.model_dump(mode="json"),
            "audit": result.audit.model_dump(mode="json", include={"accepted", "findings", "rewards"}),
        }

    def rollout(self, folder: Folder, seed: Seed) -> dict[str, Any]:
        """Let the oracle solve a task instance of a run: reward, actions, contacts."""
        instance, roots = _read_instance(folder, seed)
        return self._call_tool_by_name("rollout", instance=instance.model_dump(mode="json"), library_roots=roots)

    def render(self, folder: Folder, seed: Seed, moment: Moment = "start") -> Any:
        """Draw a task instance of a run as a picture, before or after the robot's work."""
        from mcp.server.mcpserver import Image

        instance, roots = _read_instance(folder, seed)
        with tempfile.TemporaryDirectory(prefix="grs-mcp-") as temporary:
            output = Path(temporary) / "picture.png"
            request = {"instance": instance.model_dump(mode="json"), "library_roots": roots, "moment": moment}
            result = self._call_tool_by_name("render", output=str(output), **request)
            if result["image"] is None:
                raise GrsError(f"seed {seed} of {folder} cannot be drawn: {result['error']}", "see it with `rollout`")
            return Image(data=output.read_bytes(), format="png")

    def show(self, folder: Folder, step: Step = None) -> dict[str, Any]:
        """Show a run: its record, its seeds, and its steps; or one step with prompts, replies and changes."""
        run = Run(folder)
        steps = group_events_into_steps(run.events)
        if step is not None:
            selected = find_step_by_number(steps, step)
            sections = {section.heading: section.text for section in iter_step_sections(selected)}
            return {**step_to_dict(selected), "sections": sections}
        record = run.record.model_dump(mode="json", exclude={"config", "versions"})
        return {"run": record, "steps": [step_to_dict(item) for item in steps]}

    def _call_tool_by_name(self, name: str, **request: Any) -> dict[str, Any]:
        tool = load_tool(name)
        library = open_library(request["library_roots"])
        context = ToolContext(sandbox=self.sandbox, library=library, limits=self.chosen.config.limits)
        return tool.run(tool.Request(**request), context).model_dump(mode="json")


def _read_instance(folder: str, seed: int) -> tuple[TaskInstance, tuple[str, ...]]:
    task = open_task_folder(Path(folder), accepted=False)
    return task.read_instance(seed), tuple(map(str, task.library.roots))


def list_runs() -> str:
    """The runs below ``runs/``, as JSON: name, status, reason and scene; a folder that holds no run is left out."""
    rows: list[dict[str, str]] = []
    for name in list_folder_names(RUNS) if is_folder(RUNS) else ():
        with suppress(GrsError):
            record = read_record(RUNS / name)
            uri = f"grs://runs/{name}"
            rows.append({"uri": uri, "status": record.status, "reason": record.reason, "scene": record.source})
    return json.dumps(rows, indent=1)


def read_run(run: str) -> str:
    """The record of a run, and the names of its files, as JSON."""
    record = read_record(RUNS / run)
    files = sorted(str(file.relative_to(RUNS / run)) for file in (RUNS / run).rglob("*") if file.is_file())
    return json.dumps({"run": record.model_dump(mode="json"), "files": files}, indent=1)


def read_run_text(run: str, file: str) -> str:
    """A text file of a run: JSON, Python, Markdown."""
    read_record(RUNS / run)
    return read_text(resolve_member_file(RUNS / run, file), "see grs://runs/NAME for the files of a run", _MOST_BYTES)


def read_run_picture(run: str, picture: str) -> bytes:
    """A picture of a run, as PNG."""
    read_record(RUNS / run)
    return read_bytes(resolve_member_file(RUNS / run, f"{picture}.png"), most=_MOST_BYTES)


def read_prompt(name: str) -> str:
    """The prompt of that name, with its front matter."""
    return content.content_path("prompts", name).read_text(encoding="utf-8")


def _describe_error(error: BaseException) -> str:
    """Text of a user's error for the client. Raises the error itself if it is internal."""
    refused = convert_system_error(error) if isinstance(error, OSError) else error
    if refused is None:
        raise error
    return escape_control_chars(str(refused))


def _convert_grs_errors_to_tool_errors(tool: Callable[..., Any]) -> Callable[..., Any]:
    """Send GrsError and file system errors to the client, since the package mcp hides the text of all other errors."""
    from mcp.server.mcpserver.exceptions import ToolError

    @wraps(tool)
    def call(**arguments: Any) -> Any:
        try:
            for name in _PATHS & arguments.keys():
                check_path_name(arguments[name] or "", name)
            return tool(**arguments)
        except (GrsError, KeyboardInterrupt, OSError) as error:
            raise ToolError(_describe_error(error)) from error

    return call


def _convert_grs_errors_to_resource_errors(read: Callable[..., Any]) -> Callable[..., Any]:
    from mcp.server.mcpserver.exceptions import ResourceError

    @wraps(read)
    def call(**arguments: Any) -> Any:
        try:
            return read(**arguments)
        except (GrsError, OSError) as error:
            raise ResourceError(_describe_error(error)) from error

    return call


def build_mcp_server(chosen: EffectiveConfig) -> "MCPServer":
    """The server, with a warm sandbox while it runs. Raises InputError: the package mcp is not installed."""
    try:
        import anyio
        from mcp.server.mcpserver import Context, MCPServer
        from mcp.server.mcpserver.exceptions import ToolError
        from mcp.server.stdio import stdio_server
        from mcp.shared.message import SessionMessage
        from mcp.types import ErrorData, JSONRPCError
    except ImportError as error:
        raise InputError("the package mcp is not installed", 'pip install "grs-agents[mcp]"') from error
    sandbox = open_sandbox(chosen.config)

    class GrsServer(MCPServer):
        """A server that signals can end while it reads, and that reports invalid arguments in a single line."""

        async def run_stdio_async(self) -> None:
            # The package's reader thread ends only with the client, so requests are read here.
            requests, replies = os.dup(0), os.dup(1)
            with Path(os.devnull).open("rb") as null:
                os.dup2(null.fileno(), 0)
            os.dup2(2, 1)  # only replies go to the client
            lower, out = self._lowlevel_server, anyio.wrap_file(os.fdopen(replies, "w", encoding="utf-8"))
            serving, signals = asyncio.current_task(), list[int]()

            def end_serving(number: int) -> None:
                signals.append(number)
                interrupts.request_interrupt()
                cast("asyncio.Task[None]", serving).cancel()

            # An exception raised by a signal handler would surface in an arbitrary callback of the event loop.
            for number in (signal.SIGINT, signal.SIGTERM):
                if signal.getsignal(number) is not signal.SIG_IGN:
                    with suppress(NotImplementedError):  # Windows
                        asyncio.get_running_loop().add_signal_handler(number, end_serving, number)

            async def refuse(code: int, message: str, request: Any = None) -> None:
                given: Any = cast("dict[str, Any]", request).get("id") if isinstance(request, dict) else None
                number = given if isinstance(given, int | str) and not isinstance(given, bool) else None
                refusal = JSONRPCError(jsonrpc="2.0", id=number, error=ErrorData(code=code, message=message))
                await write.send(SessionMessage(refusal))

            try:
                lines = _read_messages(requests, refuse)
                async with stdio_server(cast(Any, lines), out) as (read, write):
                    await lower.run(read, write, lower.create_initialization_options())
            except asyncio.CancelledError:
                if signals:
                    raise KeyboardInterrupt from None
                raise

        async def call_tool(self, name: str, arguments: dict[str, Any], context: Any = None) -> Any:
            try:
                return await super().call_tool(name, arguments, context)
            except ToolError as error:
                if not isinstance(error.__cause__, ValidationError):
                    raise
                problems = (f"{'.'.join(map(str, item['loc']))}: {item['msg']}" for item in error.__cause__.errors())
                raise ToolError(f"{name}: {'; '.join(problems)}") from error.__cause__

    @asynccontextmanager
    async def live(_: Any) -> AsyncGenerator[None]:
        sandbox.warm_up()
        with sandbox:
            yield

    async def run_photo(photo: Photo, context: Context, seed: RunSeed = None) -> dict[str, Any]:
        """Make a validated task of a photo with depth: program, tests, audit, and a run folder. Takes minutes.

        Each step that begins is told as progress.
        """
        try:
            check_path_name(photo, "photo")
            config = chosen if seed is None else replace(chosen, config=change_config(chosen.config, seed=seed))
            command = "run" if getattr(load_graph(config.config.graph), "VERDICT", True) else "scene"
            stream = RunStream(RunOrder(command, resolve_scene_path(Path(photo)), config))
            try:
                for number in count(1):
                    if (node := await anyio.to_thread.run_sync(_await_node_start, stream)) is None:
                        break
                    await context.report_progress(number, message=node)
            finally:  # a client that cancels or leaves ends its run
                with anyio.CancelScope(shield=True):
                    await anyio.to_thread.run_sync(stream.stop)
            run = stream.wait()
        except (GrsError, KeyboardInterrupt, OSError) as error:
            raise ToolError(_describe_error(error)) from error
        record = run.record.model_dump(mode="json", include={"status", "reason", "question", "rewards", "counts"})
        task = run.task.model_dump(mode="json") if (run.folder / "task.json").is_file() else None
        return {"folder": str(run.folder), **record, "task": task}

    tools = GrsTools(chosen, sandbox)
    server = GrsServer("grs", instructions=_INSTRUCTIONS, version=__version__, lifespan=live, log_level="WARNING")
    for tool in (tools.scene, tools.check, tools.rollout, tools.show):
        server.add_tool(_convert_grs_errors_to_tool_errors(tool))
    server.add_tool(_convert_grs_errors_to_tool_errors(tools.render), structured_output=False)
    server.add_tool(run_photo, name="run")
    for uri, kind, read in (
        ("grs://runs", "application/json", list_runs),
        ("grs://runs/{run}", "application/json", read_run),
        ("grs://runs/{run}/{+picture}.png", "image/png", read_run_picture),
        ("grs://runs/{run}/{+file}", "text/plain", read_run_text),
    ):
        server.resource(uri, mime_type=kind)(_convert_grs_errors_to_resource_errors(read))
    for name in content.content_names("prompts"):
        about = f"The prompt {name}, as a model is asked with it."
        resource = server.resource(f"grs://prompts/{name}", name=name, description=about, mime_type="text/markdown")
        resource(partial(read_prompt, name))
    return server


def _await_node_start(stream: RunStream) -> str | None:
    """Block until a node starts. Returns: its name; None at the end of the run."""
    return next((event.node for event in stream if event.kind == "node_started"), None)


def serve_mcp(chosen: EffectiveConfig, port: int | None) -> None:
    """Serve until the client leaves: on stdio, or with a port over HTTP at ``http://127.0.0.1:PORT/mcp``."""
    server = build_mcp_server(chosen)
    if port is not None:
        server.run("streamable-http", host="127.0.0.1", port=port)
        return
    interrupted = False
    try:
        server.run("stdio")
    except* (BrokenPipeError, ConnectionError):  # the client no longer reads
        pass
    except* KeyboardInterrupt:
        interrupted = True
    if interrupted:
        raise KeyboardInterrupt


async def _read_messages(descriptor: int, refuse: Callable[..., Awaitable[None]]) -> AsyncGenerator[str]:
    """Lines of the client that are messages. When it leaves, its runs are interrupted before their next step.

    Args:
        descriptor: the client's stream.
        refuse: called for any other line, with JSON-RPC's error code, the reason, and the line's value if it is JSON.
    """
    from mcp.types import INVALID_REQUEST, PARSE_ERROR, jsonrpc_message_adapter

    try:
        async for line in _read_lines(descriptor):
            if line is None:
                await refuse(PARSE_ERROR, f"the line has more than {_MOST_LINE} bytes; send less at a time")
            elif line.strip():
                try:
                    value = parse_json(line, "the line", "send JSON-RPC 2.0 as a line of UTF-8")
                except InputError as error:
                    await refuse(PARSE_ERROR, str(error))
                    continue
                try:
                    jsonrpc_message_adapter.validate_json(line, by_name=False)
                except ValidationError as error:
                    await refuse(INVALID_REQUEST, f"no JSON-RPC message: {error.errors()[0]['msg']}"[:200], value)
                    continue
                yield line.decode("utf-8")
    finally:
        interrupts.request_interrupt()


async def _read_lines(descriptor: int) -> AsyncGenerator[bytes | None]:
    """Lines of a stream; None in place of each with more than `_MOST_LINE` bytes."""
    import anyio

    rest, too_long = b"", False
    while True:
        with suppress(PermissionError):  # a plain file, which is always readable
            await anyio.wait_readable(descriptor)
        if not (data := os.read(descriptor, 1 << 16)):
            break
        *lines, rest = (rest + data).split(b"\n")
        for line in lines:
            if not too_long:
                yield None if len(line) > _MOST_LINE else line
            too_long = False
        if len(rest) > _MOST_LINE and not too_long:
            too_long = True
            yield None
        rest = b"" if too_long else rest


def list_mcp_tools(chosen: EffectiveConfig) -> list[dict[str, Any]]:
    """The served tools, each with its description and its input and output schemas."""
    tools = asyncio.run(build_mcp_server(chosen).list_tools())
    return [tool.model_dump(mode="json", exclude_none=True) for tool in tools]
