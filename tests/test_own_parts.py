"""Each part that a user may swap, done as the documentation says: its own examples, in one folder, by its commands."""

import contextlib
import json
import re
import runpy
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import trimesh

from grs_agents.base import content
from grs_agents.base.config.schema import ModelConfig
from grs_agents.base.trace.events import Decision, NodeStarted, ProgramVersion, Prompt
from grs_agents.base.trace.log import read_events
from grs_agents.models.factory import make_chat_model
from tests.chat_server import chat_server
from tests.cli.command import grs
from tests.gantry import GANTRY

DOCS = Path(__file__).parents[1] / "docs"
BROKEN = {
    "simulation": "import numpy as np\n\nraise RuntimeError('no task')\n",
    "tests": "import unittest\n\nclass TestIt(unittest.TestCase):\n    def test_a(self):\n        nowhere()\n",
}
BRICK = """<robot name="brick"><link name="brick"><collision><geometry>
    <box size="0.06 0.04 0.03"/></geometry></collision></link></robot>"""


def write_examples(page: str, folder: Path) -> None:
    """The Python examples of a page, each in the file that its first line names."""
    text = (DOCS / page).read_text("utf-8")
    for name, source in re.findall(r"^```python\n# ([\w/]+\.py)\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(source, encoding="utf-8")


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A user's folder; what was imported from it is forgotten afterwards."""
    monkeypatch.setattr(content, "_overlays", [])
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        if name.startswith(("grs_content.", "my_")):
            del sys.modules[name]


def own_server() -> tuple[Callable[[dict[str, str], str], tuple[int, dict[str, str], bytes]], list[str]]:
    """The rules of the offline model, which break the first program and the first tests; and what roles were asked."""
    model, broken, asked = make_chat_model(ModelConfig(model="offline"), 0), dict(BROKEN), list[str]()

    def answer(body: dict[str, str], _: str) -> tuple[int, dict[str, str], bytes]:
        role = body["prompt"].split("\n", 1)[0].removeprefix("# Role: ")
        asked.append(role)
        source = broken.pop(role, None)
        reply = model.invoke(body["prompt"]).text if source is None else f"```python\n{source}```"
        return 200, {}, json.dumps({"content": reply}).encode()

    return answer, asked


def test_own_model_policy_and_prompt_and_two_authors_in_one_run(work: Path, small_scene: Path) -> None:
    for page in ("models.md", "own_parts.md"):
        write_examples(page, work)
    (work / "mine" / "prompts").mkdir(exist_ok=True)
    shipped = content.content_path("prompts", "task").read_text("utf-8")
    (work / "mine" / "prompts" / "short_task.md").write_text(shipped.replace("## Rules\n", "## Rules\n\n- Be brief.\n"))
    answer, asked = own_server()
    with chat_server(answer) as url:
        options = ["--model", "my_models:MyChatModel", "--set", f"models.arguments.url={url}"]
        options += ["--set", "graph=best_of", "--set", "models.rival=offline"]
        options += ["--set", "policy=my_policies:TestsFirst", "--set", "prompts.task=short_task"]
        done = grs("--content", "mine", "run", str(small_scene), "--out", "r", "--json", *options, folder=work)
    record = json.loads(done.stdout)
    assert record["status"] == "accepted", (record["reason"], done.stderr)
    assert {"describe", "task", "simulation", "tests", "fix_tests"} <= set(asked) and "rival" not in asked
    events = list(read_events(work / "r" / "events.jsonl"))
    assert {"draft_sim", "draft_rival"} <= {event.node for event in events if isinstance(event, NodeStarted)}
    authors = [event.author_role for event in events if isinstance(event, ProgramVersion) and event.parent is None]
    assert authors[0] == "rival"
    assert [(event.policy, event.verdict) for event in events if isinstance(event, Decision)] == [
        ("tests_first", "fix_test")
    ]
    (text,) = [event.text for event in events if isinstance(event, Prompt) and event.role == "task"]
    assert "- Be brief." in text


def test_a_tool_of_ones_own_is_listed_and_called(work: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_examples("own_parts.md", work)
    listed = json.loads(grs("--content", "mine", "list", "--json", folder=work).stdout)["tools"]
    assert listed["heaviest"] == "Name the heaviest of some assets."
    with contextlib.chdir(work):
        called = runpy.run_path("call_it.py")
    assert capsys.readouterr().out.startswith("{'asset': 'HOPE/Milk.urdf', 'mass': ")
    assert called["tool"].args["assets"]["description"] == "Names of assets, such as `HOPE/Milk.urdf`."


def test_a_glb_a_urdf_and_an_arm_of_ones_own_make_a_task(work: Path) -> None:
    write_examples("assets.md", work)
    trimesh.Scene(trimesh.creation.box((0.16, 0.02, 0.16))).export(work / "saucer.glb")  # y is up in glTF
    (work / "brick.urdf").write_text(BRICK)
    (work / "arm.xml").write_text(GANTRY)
    for file in ("saucer.glb", "brick.urdf"):
        done = grs("assets", "import", file, folder=work)
        assert done.returncode == 0 and f"{Path(file).stem}/{Path(file).stem}.urdf: imported" in done.stderr
    for robot in ("ur5e", "arm.xml"):
        options = ["--set", f"robot={robot}", "--seeds", "1", "--json"]
        done = grs("--content", "grs-content", "check", "brick_on_saucer.py", *options, folder=work)
        found = json.loads(done.stdout)
        assert found["status"] == "accepted", (robot, found["audit"]["findings"])
