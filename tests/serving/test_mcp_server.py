"""GRS as agents of others meet it: the official client of the Model Context Protocol, on stdio and over HTTP."""

import asyncio
import json
import re
import subprocess
import sys
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from mcp import Client, StdioServerParameters
from mcp.types import ImageContent, TextContent

from tests.envs.conftest import block_instance
from tests.views.looking import free_port

DOCS = (Path(__file__).parents[2] / "docs" / "python.md").read_text("utf-8")
TOLD = json.loads(re.findall(r"```json\n(.*?)```", DOCS, re.DOTALL)[-1])["mcpServers"]["grs"]
GRS = [sys.executable, "-m", "grs_agents", *TOLD["args"]]  # as the documentation has clients start it
PROGRAM = """
from cliport.tasks.task import Task

class BlockLeft(Task):
    def reset(self, env):
        super().reset(env)
        block = env.add_object("block/block.urdf", ((0.5, -0.1, 0.02), (0, 0, 0, 1)))
        self.add_goal([block], None, [((0.5, 0.15, 0.02), (0, 0, 0, 1))], False, True, "pose", None, 1.0)
        self.lang_goals.append("put the block at the left")
"""


@pytest.fixture
def task(tmp_path: Path) -> Path:
    """A folder with one task instance."""
    (tmp_path / "task" / "instances").mkdir(parents=True)
    (tmp_path / "task" / "instances" / "seed_0.json").write_text(block_instance(0).model_dump_json(), encoding="utf-8")
    return tmp_path / "task"


@asynccontextmanager
async def on_stdio(folder: Path) -> AsyncGenerator[Client]:
    async with Client(StdioServerParameters(command=GRS[0], args=GRS[1:], cwd=folder)) as client:
        yield client


def text_of(result: Any) -> str:
    return "".join(part.text for part in result.content if isinstance(part, TextContent))


def ask(work: Callable[[], Awaitable[None]]) -> None:
    async def bounded() -> None:
        await asyncio.wait_for(work(), 120)

    asyncio.run(bounded())


def test_on_stdio_a_photo_becomes_a_run_and_an_instance_is_solved(small_scene: Path, task: Path) -> None:
    """One server for both, since it takes seconds to start."""

    async def work() -> None:
        async with on_stdio(task.parent) as client:
            await assert_a_photo_becomes_a_run(client, small_scene)
            await assert_an_instance_is_solved(client, task)

    ask(work)


async def assert_a_photo_becomes_a_run(client: Client, photo: Path) -> None:
    """A photo becomes a run that is shown."""
    seen = (await client.call_tool("scene", {"photo": str(photo)})).structured_content
    assert seen is not None and len({item["name"] for item in seen["objects"]}) == 3
    shown = (await client.call_tool("show", {"folder": seen["folder"]})).structured_content
    assert shown is not None and shown["run"]["status"] == "accepted"
    number = next(step["number"] for step in shown["steps"] if step["node"] == "describe")
    step = (await client.call_tool("show", {"folder": seen["folder"], "step": number})).structured_content
    assert step is not None and step["sections"]


async def assert_an_instance_is_solved(client: Client, task: Path) -> None:
    """An instance is solved, drawn and its program checked, and an error is told."""
    solved = (await client.call_tool("rollout", {"folder": str(task), "seed": 0})).structured_content
    assert solved is not None and solved["rollout"]["episode"]["reward"] == pytest.approx(1.0)
    drawn = await client.call_tool("render", {"folder": str(task), "seed": 0, "moment": "end"})
    assert isinstance(drawn.content[0], ImageContent) and drawn.content[0].mime_type == "image/png"
    checked = (await client.call_tool("check", {"simulation": PROGRAM})).structured_content
    assert checked is not None and checked["audit"]["rewards"] == [1.0, 1.0, 1.0]
    lacking = await client.call_tool("rollout", {"folder": str(task), "seed": 7})
    assert lacking.is_error and "'7'" in text_of(lacking) and "0" in text_of(lacking)


def test_over_http_only_this_machine_is_served(tmp_path: Path) -> None:
    port = free_port()
    server = subprocess.Popen([*GRS, "--http", str(port)], cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    try:
        assert server.stderr is not None

        async def work() -> None:
            address = f"http://127.0.0.1:{port}/mcp"
            async with httpx.AsyncClient() as http:
                while True:
                    assert server.poll() is None
                    try:
                        foreign = await http.post(address, headers={"Host": "evil.example"}, json={})
                        break
                    except httpx.ConnectError:
                        await asyncio.sleep(0.05)
                assert foreign.status_code == 421
            async with Client(address) as client:
                tools = {tool.name: tool for tool in (await client.list_tools()).tools}
            assert tools.keys() == {"scene", "check", "rollout", "render", "show"}
            for tool in tools.values():
                assert tool.description
                assert all(argument.get("description") for argument in tool.input_schema["properties"].values())

        ask(work)
    finally:
        server.terminate()
        server.communicate()
