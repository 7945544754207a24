"""GRS as a server of the Model Context Protocol: agents comprehend photos, check programs and look at runs.

It talks on stdio, or over HTTP on 127.0.0.1 alone. Programs run in the sandbox, as everywhere.
"""

import asyncio
import tempfile
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from grs_agents.api import Run, check, run
from grs_agents.config import Config
from grs_agents.errors import GrsError, InputError
from grs_agents.files import write_text
from grs_agents.runs import open_sandbox
from grs_agents.sandbox import Sandbox
from grs_agents.sim import TaskInstance
from grs_agents.task_folder import open_task_folder
from grs_agents.toolkit import ToolContext, load_tool, open_library
from grs_agents.version import __version__
from grs_agents.views import find_step_by_number, group_events_into_steps, iter_step_sections, step_to_dict

if TYPE_CHECKING:
    from mcp.server.mcpserver import MCPServer

_INSTRUCTIONS = """GRS turns a photo with depth of a table into a simulated robot task that an oracle has solved.
`scene` finds the objects of a photo. Write a simulation program of a task with them (a subclass of CLIPort's Task) and
`check` it. `rollout`, `render` and `show` look at a run. Lengths are metres in the robot frame: x forward, y left, z up
from the table top."""

Photo = Annotated[
    str, Field(description="A folder with rgb.png, depth.png and camera.json, an .npz file, or a shipped scene's name.")
]
Folder = Annotated[str, Field(description="A run folder, as `scene` or `grs run` leaves it.")]
Seed = Annotated[int, Field(description="The seed of the task instance.", ge=0)]
Source = Annotated[str, Field(description="Python source of a simulation program with one Task subclass.")]
Tests = Annotated[str | None, Field(description="Python source of its unit tests, which import `task_code`.")]
Scene = Annotated[str | None, Field(description="The run folder of the scene that the program must keep to.")]
Moment = Annotated[Literal["start", "end"], Field(description="Before or after the robot's work.")]
Step = Annotated[int | None, Field(description="The number of one step, to be shown in full; all steps without one.")]


@dataclass(frozen=True)
class GrsTools:
    """What the server offers. Each raises GrsError, whose text goes to the client."""

    config: Config
    sandbox: Sandbox  # shared by all calls, so that MuJoCo is imported once

    def scene(self, photo: Photo) -> dict[str, Any]:
        """Comprehend a photo with depth: its objects with sizes and positions in metres, and a run folder."""
        settings: dict[str, Any] = {**self.config.model_dump(), "graph": "scene"}
        seen = run(photo, **settings)
        return {"folder": str(seen.folder), **seen.scene.model_dump(mode="json", include={"objects", "warnings"})}

    def check(self, simulation: Source, tests: Tests = None, scene: Scene = None) -> dict[str, Any]:
        """Check a simulation program in the sandbox: its tests, then the audit, in which the oracle solves it."""
        with tempfile.TemporaryDirectory(prefix="grs-mcp-") as folder:
            program = write_text(Path(folder) / "task_code.py", simulation)
            suite = None if tests is None else write_text(Path(folder) / "test_task_code.py", tests)
            found = check(program, tests=suite, photo=scene, **self.config.model_dump())
        return {
            "accepted": found.accepted,
            "tests": found.tests and found.tests.model_dump(mode="json"),
            "audit": found.audit.model_dump(mode="json", include={"accepted", "findings", "rewards"}),
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
            drawn = self._call_tool_by_name("render", output=str(output), **request)
            if drawn["image"] is None:
                raise GrsError(f"seed {seed} of {folder} cannot be drawn: {drawn['error']}", "see it with `rollout`")
            return Image(data=output.read_bytes(), format="png")

    def show(self, folder: Folder, step: Step = None) -> dict[str, Any]:
        """Show a run: its record, its seeds, and its steps; or one step with prompts, replies and changes."""
        shown = Run(folder)
        steps = group_events_into_steps(shown.events)
        if step is not None:
            one = find_step_by_number(steps, step)
            sections = {part.heading: part.text for part in iter_step_sections(one)}
            return {**step_to_dict(one), "sections": sections}
        record = shown.record.model_dump(mode="json", exclude={"config", "versions"})
        return {"run": record, "steps": [step_to_dict(one) for one in steps]}

    def _call_tool_by_name(self, tool: str, **request: Any) -> dict[str, Any]:
        called = load_tool(tool)
        library = open_library(request["library_roots"])
        context = ToolContext(sandbox=self.sandbox, library=library, limits=self.config.limits)
        return called.run(called.Request(**request), context).model_dump(mode="json")


def _read_instance(folder: str, seed: int) -> tuple[TaskInstance, tuple[str, ...]]:
    task = open_task_folder(Path(folder), accepted=False)
    return task.read_instance(seed), tuple(map(str, task.library.roots))


def _convert_grs_errors_to_tool_errors(tool: Callable[..., Any]) -> Callable[..., Any]:
    """The tool, whose GrsError is told to the client; the protocol's package keeps all other errors to itself."""
    from mcp.server.mcpserver.exceptions import ToolError

    @wraps(tool)
    def call(**arguments: Any) -> Any:
        try:
            return tool(**arguments)
        except GrsError as error:
            raise ToolError(str(error)) from error

    return call


def build_mcp_server(config: Config) -> "MCPServer":
    """The server, whose sandbox is warm while it runs. Raises InputError: the package mcp is not installed."""
    try:
        from mcp.server.mcpserver import MCPServer
    except ImportError as error:
        raise InputError("the package mcp is not installed", 'pip install "grs-agents[mcp]"') from error
    sandbox = open_sandbox(config)

    @asynccontextmanager
    async def live(_: Any) -> AsyncGenerator[None]:
        sandbox.warm_up()
        with sandbox:
            yield

    tools = GrsTools(config, sandbox)
    server = MCPServer("grs", instructions=_INSTRUCTIONS, version=__version__, lifespan=live, log_level="WARNING")
    for tool in (tools.scene, tools.check, tools.rollout, tools.show):
        server.add_tool(_convert_grs_errors_to_tool_errors(tool))
    server.add_tool(_convert_grs_errors_to_tool_errors(tools.render), structured_output=False)
    return server


def serve_mcp(config: Config, port: int | None) -> None:
    """Serve until the client leaves: on stdio, or with a port over HTTP at ``http://127.0.0.1:PORT/mcp``."""
    server = build_mcp_server(config)
    if port is None:
        server.run("stdio")
    else:
        server.run("streamable-http", host="127.0.0.1", port=port)


def list_mcp_tools(config: Config) -> list[dict[str, Any]]:
    """The tools that are served, each with its description and the schemas of what it takes and gives."""
    tools = asyncio.run(build_mcp_server(config).list_tools())
    return [tool.model_dump(mode="json", exclude_none=True) for tool in tools]
