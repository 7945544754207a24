"""GRS from Python: what `grs run` and `grs check` do, as functions."""

import asyncio
import contextlib
import inspect
import io
import re
from pathlib import Path
from typing import Any

import pytest
from langchain_core.callbacks import BaseCallbackHandler

import grs_agents
from grs_agents import Run
from grs_agents.base.errors import ConfigError, GrsError, InputError

README = Path(__file__).parent.parent / "README.md"


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory, known_scene: Path) -> dict[str, Any]:
    """What the example in the README has made of a scene that is known."""
    [example] = re.findall(r"## From Python\n\n```python\n(.*?)```", README.read_text("utf-8"), re.DOTALL)
    names: dict[str, Any] = {}
    with contextlib.chdir(tmp_path_factory.mktemp("api")), contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(example.replace('"groceries"', repr(str(known_scene))), names)
        names["run"].folder = names["run"].folder.resolve()
    return names | {"printed": printed.getvalue()}


def test_the_example_in_the_readme_runs(ran: dict[str, Any]) -> None:
    run: Run = ran["run"]
    assert run.accepted and ran["found"].accepted
    first, *_ = ran["printed"].splitlines()
    assert first == f"accepted {run.task.description}"
    assert all(item.name in ran["printed"] for item in run.scene.objects)


def test_the_page_on_python_follows_the_decisions_of_a_run(
    ran: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    [example] = re.findall(r"```python\n(.*?)```", (README.parent / "docs" / "python.md").read_text("utf-8"), re.DOTALL)
    with contextlib.chdir(tmp_path):
        exec(example.replace('"groceries"', repr(str(ran["run"].folder))), {})  # whose scene it takes over
    *told, last = capsys.readouterr().out.splitlines()
    assert told and all(line.split()[0] in ("fix_code", "fix_test", "fix_task") for line in told)
    assert ": accepted" in last


def test_a_run_holds_what_it_made(ran: dict[str, Any]) -> None:
    run: Run = ran["run"]
    assert {item.asset for item in run.scene.objects} & set(run.task.assets)
    assert "class" in run.simulation and "def test_" in run.tests
    assert run.instances.keys() == set(run.record.seeds)
    assert run.events[-1].kind == "run_ended"
    assert str(run.folder) in repr(run)


def test_an_ended_run_is_opened_again(ran: dict[str, Any]) -> None:
    again = Run(str(ran["run"].folder))
    assert again.record == ran["run"].record
    assert again.resume().record == again.record


def test_what_is_wrong_is_refused_before_anything_runs(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="max_fixes"):
        grs_agents.run("groceries", out=tmp_path / "run", max_fixes=-1)
    with pytest.raises(InputError, match="no_such"):
        grs_agents.stream("no_such", out=tmp_path / "run").wait()
    with pytest.raises(InputError, match="holds no run"):
        Run(tmp_path)
    assert not (tmp_path / "run").exists()


def test_a_stream_that_is_stopped_can_be_resumed(
    known_scene: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    stream = grs_agents.stream(str(known_scene), out=tmp_path / "run")
    assert next(stream).kind == "run_started"
    stream.stop()
    with pytest.raises(KeyboardInterrupt):
        stream.wait()
    stopped = Run(tmp_path / "run")
    assert stopped.status == "interrupted"
    with pytest.raises(InputError, match=f"{tmp_path / 'run'} alone names the scene {known_scene}"):
        stopped.resume()
    assert Run(tmp_path / "run").resume(scene=known_scene).accepted
    assert capfd.readouterr() == ("", "")


def test_a_cancelled_run_is_interrupted(small_scene: Path, tmp_path: Path) -> None:
    async def cancel() -> None:
        going = asyncio.create_task(grs_agents.arun(str(small_scene), out=tmp_path / "run"))
        while not (tmp_path / "run" / "events.jsonl").exists():
            await asyncio.sleep(0)
        going.cancel()
        await going

    with pytest.raises(asyncio.CancelledError):
        asyncio.run(cancel())
    assert Run(tmp_path / "run").status == "interrupted"


def test_an_error_of_a_run_is_raised(tmp_path: Path) -> None:
    with pytest.raises(GrsError):
        grs_agents.run("groceries", out=tmp_path / "run", models={"default": "offline:no_such_model"})


class CallCounter(BaseCallbackHandler):
    """Counts the calls of models and the chains begun.

    Attributes:
        models, chains: so many.
    """

    def __init__(self) -> None:
        self.models = self.chains = 0

    def on_chat_model_start(self, *_: Any, **__: Any) -> None:
        """A call of a model begins."""
        self.models += 1

    def on_chain_start(self, *_: Any, **__: Any) -> None:
        """The graph, or a node of it, begins."""
        self.chains += 1


@pytest.mark.parametrize("model", ["offline", ["offline", "offline"]], ids=["one", "fallback"])
def test_callbacks_see_the_graph_and_each_call_of_a_model_once(
    known_scene: Path, tmp_path: Path, model: str | list[str]
) -> None:
    counter = CallCounter()
    run = grs_agents.run(
        str(known_scene), out=tmp_path / "run", callbacks=[counter], models={"default": model}, audit={"seeds": 1}
    )
    assert counter.models == sum(event.kind == "reply" for event in run.events) > 2
    assert counter.chains > sum(event.kind == "node_started" for event in run.events)


def test_everything_exported_is_documented_and_typed() -> None:
    for name in ("run", "arun", "stream", "check"):
        function = getattr(grs_agents, name)
        assert inspect.getdoc(function)
        assert "return" in function.__annotations__
