"""GRS as agents of others meet it: the official client of the Model Context Protocol, on stdio and over HTTP."""

import asyncio
import contextlib
import json
import re
import subprocess
import sys
from collections.abc import AsyncGenerator, Awaitable, Callable, Generator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from mcp import Client, MCPError, StdioServerParameters
from mcp.server.mcpserver.exceptions import ToolError
from mcp.types import BlobResourceContents, ImageContent, TextContent, TextResourceContents

from grs_agents.base import content
from grs_agents.base.config.load import EffectiveConfig, load_config
from grs_agents.base.config.schema import Config
from grs_agents.serving.mcp_server import build_mcp_server
from tests.slow import slow_where
from tests.tasks.envs.conftest import block_instance
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
    """One server for all, since it takes seconds to start."""
    (task.parent / "secret.txt").write_text("canary", "utf-8")
    (task.parent / "runs" / "stray").mkdir(parents=True)

    async def work() -> None:
        async with on_stdio(task.parent) as client:
            await assert_a_run_tells_its_steps_and_its_folder_is_a_resource(client, small_scene, task.parent)
            await assert_a_photo_becomes_a_run(client, small_scene)
            await assert_an_instance_is_solved(client, task)
            await assert_wrong_arguments_are_told_in_one_line(client)
            await assert_prompts_are_resources(client)

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


async def assert_wrong_arguments_are_told_in_one_line(client: Client) -> None:
    """All errors at once, each with its argument; a photo that is none is refused like on the command line."""
    wrong = await client.call_tool("rollout", {"seed": "many"})
    assert wrong.is_error and "\n" not in text_of(wrong)
    assert "rollout: folder: Field required; seed: Input should be a valid integer" in text_of(wrong)
    lacking = await client.call_tool("run", {"photo": "nowhere"})
    assert lacking.is_error and "\n" not in text_of(lacking) and "nowhere does not exist" in text_of(lacking)


async def assert_prompts_are_resources(client: Client) -> None:
    """Each shipped prompt, as it lies in its file."""
    listed = {str(resource.uri) for resource in (await client.list_resources()).resources}
    assert listed == {"grs://runs", *(f"grs://prompts/{name}" for name in content.content_names("prompts"))}
    assert await read(client, "grs://prompts/task") == content.content_path("prompts", "task").read_text("utf-8")


async def read(client: Client, uri: str) -> str:
    (part,) = (await client.read_resource(uri)).contents
    assert isinstance(part, TextResourceContents)
    return part.text


async def assert_a_run_tells_its_steps_and_its_folder_is_a_resource(
    client: Client, small_scene: Path, folder: Path
) -> None:
    """What lies outside of the run's folder, or is linked to from it, is no resource."""
    steps: list[str | None] = []

    async def note(progress: float, total: float | None, message: str | None) -> None:
        steps.append(message)

    made = await client.call_tool("run", {"photo": str(small_scene), "seed": 3}, progress_callback=note)
    assert made.structured_content is not None, text_of(made)
    assert made.structured_content["status"] == "accepted" and made.structured_content["task"]
    name = Path(made.structured_content["folder"]).name
    assert [row["uri"] for row in json.loads(await read(client, "grs://runs"))] == [f"grs://runs/{name}"]
    told = json.loads(await read(client, f"grs://runs/{name}"))
    assert told["run"]["seeds"][0] == 3 and "instances/seed_3.json" in told["files"]
    assert "class " in await read(client, f"grs://runs/{name}/simulation.py")
    assert json.loads(await read(client, f"grs://runs/{name}/instances/seed_3.json"))["seed"] == 3
    (photo,) = (await client.read_resource(f"grs://runs/{name}/scene/rgb.png")).contents
    assert isinstance(photo, BlobResourceContents) and photo.mime_type == "image/png"
    (folder / "runs" / name / "link.txt").symlink_to(folder / "secret.txt")
    for outside in ("../../secret.txt", "%2e%2e/%2e%2e/secret.txt", "link.txt", "none.txt"):
        with pytest.raises(MCPError):
            await read(client, f"grs://runs/{name}/{outside}")
    assert steps[:2] == ["read", "find_table"] and steps[-1] == "conclude"


LEAVING = {
    "before a word": lambda server: server.stdin.close(),
    "without reading the reply": lambda server: (server.stdout.close(), say(server, INITIALIZE)),
    "by SIGTERM": lambda server: (say(server, INITIALIZE), server.stdout.readline(), server.terminate()),
}
INITIALIZE = {
    "id": 1,
    "method": "initialize",
    "params": {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "test", "version": "1"}},
}


def say(server: "subprocess.Popen[bytes]", message: dict[str, Any]) -> None:
    assert server.stdin is not None
    server.stdin.write(json.dumps({"jsonrpc": "2.0", **message}).encode() + b"\n")
    server.stdin.flush()


@contextlib.contextmanager
def server_on_pipes(folder: Path) -> Generator["subprocess.Popen[bytes]"]:
    pipe = subprocess.PIPE
    with subprocess.Popen(GRS, cwd=folder, stdin=pipe, stdout=pipe, stderr=pipe) as server:
        try:
            yield server
        finally:
            server.kill()


@pytest.mark.parametrize("how", slow_where({"without reading the reply"}.__contains__, LEAVING))
def test_a_client_that_leaves_ends_the_server_without_a_word(tmp_path: Path, how: str) -> None:
    with server_on_pipes(tmp_path) as server:
        LEAVING[how](server)
        assert server.wait(100) == (130 if how.startswith("by ") else 0)
        assert server.stderr is not None
        assert server.stderr.read() == b""


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("a" * 5_000, "has 5000 characters; give at most 4096"),
        ("a" * 300, "aaaa"),
        ("a\0b", "holds a NUL: a\\x00b"),
        ("\ud800", "is not UTF-8"),
        ("nowhere", "nowhere"),
    ],
    ids=["5000", "300", "NUL", "surrogate", "missing"],
)
def test_a_path_that_nothing_can_have_is_told_in_one_line(name: str, told: str) -> None:
    server = build_mcp_server(EffectiveConfig(Config()))
    calls: tuple[tuple[str, dict[str, Any]], ...] = (
        ("show", {"folder": name}),
        ("scene", {"photo": name}),
        ("run", {"photo": name}),
        ("check", {"simulation": PROGRAM, "scene": name}),
        ("rollout", {"folder": name, "seed": 0}),
        ("render", {"folder": name, "seed": 0}),
    )
    for tool, arguments in calls:
        with pytest.raises(ToolError) as refused:
            asyncio.run(server.call_tool(tool, arguments))
        assert told in str(refused.value) and "\n" not in str(refused.value), tool
        str(refused.value).encode()


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
            assert tools.keys() == {"scene", "run", "check", "rollout", "render", "show"}
            for tool in tools.values():
                assert tool.description
                assert all(argument.get("description") for argument in tool.input_schema["properties"].values())

        ask(work)
    finally:
        server.terminate()
        server.communicate()


def test_a_server_without_a_sandbox_checks_programs() -> None:
    server = build_mcp_server(load_config(None, (), {}, unsafe=True))
    found: Any = asyncio.run(server.call_tool("check", {"simulation": PROGRAM}))
    assert found.structured_content["accepted"]


def test_an_instance_of_a_rejected_run_is_solved_to_see_what_is_wrong(task: Path) -> None:
    (task / "run.json").write_text('{"status": "rejected"}', encoding="utf-8")
    server = build_mcp_server(load_config(None, (), {}, unsafe=True))
    found: Any = asyncio.run(server.call_tool("rollout", {"folder": str(task), "seed": 0}))
    assert found.structured_content["rollout"]["episode"]["reward"] == pytest.approx(1.0)


NO_MESSAGES = {
    b"no JSON": (-32700, "is not JSON", None),
    b'{"jsonrpc": "2.0", "id": 5, "method": "\\ud800"}': (-32700, "surrogates", None),
    b"[" * 5_000: (-32700, "deeper than", None),
    b"\xff\xfe{}": (-32700, "is not JSON", None),
    b'{"id": 6}': (-32600, "no JSON-RPC message", 6),
    b"7": (-32600, "no JSON-RPC message", None),
    b"a" * ((1 << 23) + 100_000): (-32700, "more than 8388608 bytes", None),
}


def test_a_line_that_is_no_message_is_answered_by_an_error_and_a_run_whose_client_leaves_is_interrupted(
    tmp_path: Path, small_scene: Path
) -> None:
    call = {"name": "run", "arguments": {"photo": str(small_scene)}, "_meta": {"progressToken": "steps"}}
    with server_on_pipes(tmp_path) as server:
        assert server.stdin is not None and server.stdout is not None and server.stderr is not None
        for line, (code, word, number) in NO_MESSAGES.items():
            server.stdin.write(line + b"\n\n")
            server.stdin.flush()
            answer = json.loads(server.stdout.readline())
            assert (answer["jsonrpc"], answer["id"], answer["error"]["code"]) == ("2.0", number, code), answer
            assert word in answer["error"]["message"]
        say(server, INITIALIZE)
        assert json.loads(server.stdout.readline())["result"]["serverInfo"]["name"] == "grs"
        say(server, {"method": "notifications/initialized"})
        say(server, {"id": 2, "method": "tools/call", "params": call})
        assert b'"find_table"' in (server.stdout.readline() + server.stdout.readline())
        server.stdin.close()
        server.stdout.close()
        assert (server.wait(100), server.stderr.read()) == (0, b"")
    (record,) = tmp_path.glob("runs/*/run.json")
    assert json.loads(record.read_text("utf-8"))["status"] == "interrupted"
