"""A recorded run repeats without network and keys; what its recording does not hold is an error or asked for."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from grs_agents.agents.recorded import read_cassette
from grs_agents.base import content
from grs_agents.base.trace.events import Prompt, Reply
from grs_agents.base.trace.log import read_events
from tests.cli.command import grs
from tests.cli.conftest import ScriptedServer, serve_script
from tests.slow import slow_where

BROKEN = "```python\nimport unittest\n\nclass T(unittest.TestCase):\n    def test_a(self):\n        nowhere()\n```"
KEY = "sk-0123456789-of-mine"
MADE = ("task.json", "simulation.py", "test_simulation.py", "audit.json", "scene.json", "instances/seed_0.json")


def exchanges(run: Path) -> list[tuple[object, ...]]:
    """What was asked and answered, whichever candidate was described first."""
    events = read_events(run / "events.jsonl")
    replies = {event.call: event for event in events if isinstance(event, Reply)}
    told = {"role", "model", "text", "input_tokens", "output_tokens", "cached_tokens", "cost", "finish_reason", "error"}
    return sorted(
        (event.digest, *replies[event.call].model_dump(include=told).values())
        for event in events
        if isinstance(event, Prompt)
    )


class Recorded(NamedTuple):
    """An accepted run with an unusable reply and a fix.

    Attributes:
        cassette: its recording, in a folder that holds the run as ``first``.
        options: what made it.
        server: what was asked.
    """

    cassette: Path
    options: list[str]
    server: ScriptedServer


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory, known_scene: Path) -> Iterator[Recorded]:
    """One for all tests, of a scene that is known: those that ship are of a photo."""
    pytest.importorskip("langchain_openai")
    folder = tmp_path_factory.mktemp("recorded")
    with serve_script() as server, pytest.MonkeyPatch.context() as patch:
        patch.setenv("OPENAI_API_KEY", KEY)
        server.spoilt = {"task": ["none of your business"], "tests": [BROKEN]}
        asking = ["--set", "models.default=openai:some/model", "--set", f"models.base_url={server.url}"]
        options = ["run", str(known_scene), "--set", "policy=rules", *asking]
        done = grs(*options, "--out", "first", "--record", "cassette.json", "--json", folder=folder)
        assert json.loads(done.stdout)["status"] == "accepted", done.stderr
        patch.delenv("OPENAI_API_KEY")
        yield Recorded(folder / "cassette.json", options, server)


def test_a_recorded_run_repeats_without_network_and_keys(recorded: Recorded, known_scene: Path) -> None:
    asked, folder = len(recorded.server.bodies), recorded.cassette.parent
    done = grs("run", str(known_scene), "--cassette", "cassette.json", "--out", "again", "--json", folder=folder)
    record = json.loads(done.stdout)
    assert record["status"] == "accepted" and record["reason"].endswith("; equal to the recording"), done.stderr
    assert (record["config"]["policy"], record["counts"]["test_fixes"]) == ("rules", 1)
    assert len(recorded.server.bodies) == asked
    assert exchanges(folder / "again") == exchanges(folder / "first")
    for file in MADE:
        assert (folder / "again" / file).read_bytes() == (folder / "first" / file).read_bytes()


def test_a_cassette_is_readable_and_holds_no_keys_and_paths(recorded: Recorded) -> None:
    text = recorded.cassette.read_text("utf-8")
    assert '\n    "class T(unittest.TestCase):",\n' in text
    assert max(map(len, text.splitlines())) < 1_000
    assert not [word for word in (KEY, str(recorded.cassette.parent), str(Path.home()), "127.0.0.1") if word in text]
    cassette = read_cassette(str(recorded.cassette))
    assert cassette.settings == {"policy": "rules", "models.default.model": "openai:some/model"}


def test_a_prompt_that_was_not_recorded_ends_the_run_or_is_asked(
    recorded: Recorded, known_scene: Path, tmp_path: Path
) -> None:
    shutil.copy(recorded.cassette, tmp_path)
    (tmp_path / "mine" / "prompts").mkdir(parents=True)
    prompt = tmp_path / "mine" / "prompts" / "tests.md"
    shutil.copy(content.content_path("prompts", "tests"), prompt)
    prompt.write_text(prompt.read_text("utf-8").replace("## Rules\n", "## Rules\n\n- Be brief.\n"))
    mine = ["--content", str(prompt.parent.parent)]
    done = grs(*mine, "run", str(known_scene), "--cassette", "cassette.json", "--out", "other", folder=tmp_path)
    number = [item.role for item in read_cassette(str(recorded.cassette)).exchanges].index("tests") + 1
    assert done.returncode == 2
    assert f"role tests; the nearest, exchange {number}, differs in Rules; " in done.stderr
    assert "grs run SCENE --record FILE" in done.stderr
    asked = len(recorded.server.roles)
    again = ["--cassette", "cassette.json", "--record", "second.json", "--out", "second", "--json"]
    done = grs(*mine, *recorded.options, *again, folder=tmp_path)
    assert json.loads(done.stdout)["status"] == "accepted", done.stderr
    assert recorded.server.roles[asked:] == ["tests"]
    before, after = (read_cassette(str(tmp_path / name)).exchanges for name in ("cassette.json", "second.json"))
    assert {item.digest for item in before} - {item.digest for item in after}
    done = grs(*mine, "run", str(known_scene), "--cassette", "second.json", "--out", "third", "--json", folder=tmp_path)
    assert json.loads(done.stdout)["reason"].endswith("; equal to the recording"), done.stdout


def test_a_run_that_reaches_its_budget_is_rejected_with_what_it_has(
    tmp_path: Path, known_scene: Path, scripted_server: Any
) -> None:
    pytest.importorskip("langchain_openai")
    scripted_server.spoilt = {"tests": [BROKEN]}
    asking = ["--set", "models.default=openai:any", "--set", f"models.base_url={scripted_server.url}"]
    options = ["run", str(known_scene), *asking, "--set", "budget.cost=1", "--out", "run", "--json"]
    done = grs(*options, folder=tmp_path)
    record = json.loads(done.stdout)
    spent = 0.25 * len(scripted_server.bodies)
    assert (done.returncode, record["status"]) == (1, "rejected"), done.stderr
    assert record["reason"].startswith(f"budget: {spent:.2f} of 1.00 US dollars used") and spent == 1
    assert (tmp_path / "run" / "simulation.py").is_file()
    assert "nowhere" in (tmp_path / "run" / "test_simulation.py").read_text()
    assert grs(*options[:2], "--out", "run", "--resume", "--json", folder=tmp_path).returncode == 1
    assert len(scripted_server.bodies) == 4


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{}", "is not a cassette: version"),
        ("[1]", "is not a JSON object"),
        (None, "unknown cassette"),
    ],
)
def test_what_is_no_cassette_is_refused(tmp_path: Path, text: str | None, told: str) -> None:
    if text is not None:
        (tmp_path / "tape").write_text(text)
    done = grs("run", "groceries", "--cassette", "tape", "--out", "run", folder=tmp_path)
    assert done.returncode == 2 and told in done.stderr
    assert not (tmp_path / "run").exists()


def test_a_recording_replaces_no_other_file(tmp_path: Path) -> None:
    (tmp_path / "notes.json").write_text('{"mine": 1}')
    done = grs("run", "groceries", "--record", "notes.json", "--out", "run", folder=tmp_path)
    assert done.returncode == 2 and "notes.json is not a cassette" in done.stderr
    assert (tmp_path / "notes.json").read_text() == '{"mine": 1}' and not (tmp_path / "run").exists()


def test_a_cassette_of_somebody_else_names_no_file_code_or_endpoint(tmp_path: Path) -> None:
    told: dict[str, Any] = dict.fromkeys(("version", "scene", "status", "reason"), "groceries")
    hostile = {"record": "notes.json", "sandbox": "none", "policy": "os:abort", "robot": "/etc/arm.xml"}
    hostile |= {"models.default.base_url": "http://10.0.0.1", "max_fixes": 3}
    cassette = told | {"settings": hostile, "files": {}, "exchanges": []}
    (tmp_path / "tape.json").write_text(json.dumps(cassette))
    done = grs("run", "--cassette", "tape.json", "--out", "run", folder=tmp_path)
    assert done.returncode == 2 and "no reply to this prompt of the role describe, nor to any other" in done.stderr
    config = json.loads((tmp_path / "run" / "run.json").read_text())["config"]
    assert (config["record"], config["policy"], config["robot"], config["max_fixes"]) == (None, "llm", "ur5e", 3)
    assert config["sandbox"] == "auto" and config["models"]["default"]["base_url"] is None


@pytest.mark.parametrize("scene", ["/home/somebody/photo", "photo", "../photo.npz", "bop:data/test/1/2"])
def test_a_cassette_of_somebody_else_does_not_choose_the_photo(tmp_path: Path, small_scene: Path, scene: str) -> None:
    shutil.copytree(small_scene, tmp_path / "photo")
    told: dict[str, Any] = dict.fromkeys(("version", "status", "reason"), "") | {"scene": scene}
    (tmp_path / "tape.json").write_text(json.dumps(told | {"settings": {}, "files": {}, "exchanges": []}))
    done = grs("run", "--cassette", "tape.json", "--out", "run", folder=tmp_path)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1, done.stderr
    assert f"is of the scene '{scene}', which is no sample" in done.stderr and "grs run SCENE" in done.stderr
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "field", [{"input_tokens": 10**400}, {"output_tokens": -1}, {"cost": float("nan")}, {"cost": -1}, {"cost": 1e308}]
)
def test_a_cassette_with_impossible_counts_is_refused(tmp_path: Path, field: dict[str, Any]) -> None:
    told = json.loads(content.shipped_cassettes()["groceries-tidy"].read_text("utf-8"))
    told["exchanges"][0] |= field
    (tmp_path / "tape.json").write_text(json.dumps(told))
    done = grs("run", "--cassette", "tape.json", "--out", "run", folder=tmp_path)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1, done.stderr
    assert "tape.json is not a cassette: exchanges" in done.stderr


@pytest.mark.parametrize("name", slow_where(lambda name: name != "groceries-tidy", content.shipped_cassettes()))
def test_a_shipped_recording_repeats(tmp_path: Path, name: str) -> None:
    done = grs("run", "--cassette", name, "--out", "run", "--json", folder=tmp_path)
    record = json.loads(done.stdout)
    assert record["status"] == "accepted", done.stderr
    assert record["reason"].endswith("; equal to the recording")
    replies = [event for event in read_events(tmp_path / "run" / "events.jsonl") if isinstance(event, Reply)]
    assert len(replies) == len(read_cassette(name).exchanges)
    assert not any(reply.model.startswith("offline") for reply in replies)
