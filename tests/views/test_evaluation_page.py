"""The page of an evaluation: figures, films, and foreign text escaped."""

import json
import shutil
from pathlib import Path

import pytest
from rerun.chunk import RrdReader

from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json
from grs_agents.sim.variation.types import Variation
from grs_agents.tasks.suites.evaluation import evaluate, make_order
from grs_agents.tasks.suites.layouts import PRESETS
from grs_agents.tasks.suites.suite import make_suite
from grs_agents.views.evaluation.episodes import find_episode, make_episode_shot
from grs_agents.views.evaluation.page import render_evaluation_page
from grs_agents.views.rerun.episode_view import record_episode
from grs_agents.views.rerun.recording import Paths
from tests.cli.command import grs
from tests.tasks.envs.conftest import block_instance


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A suite of a single task, and an evaluation of its expert."""
    folder = tmp_path_factory.mktemp("evaluated")
    run = folder / "run"
    write_json(run / "instances" / "seed_0.json", block_instance(0).model_dump(mode="json"))
    write_json(run / "task.json", {"task-description": "<script>alert(1)</script> & the red block"})
    suite, out = folder / "suite", folder / "out"
    make_suite(suite, [run], "blocks", 1, Variation(jitter=0.01), workers=1)
    evaluate(suite, make_order(suite, "oracle", PRESETS["grs"], episodes=1), out, workers=1)
    return suite, out


def test_the_page_shows_figures_and_films_and_loads_nothing(evaluated: tuple[Path, Path]) -> None:
    suite, out = evaluated
    page = render_evaluation_page(suite, out)
    assert "<h1>oracle on blocks</h1>" in page and "100% (21% to 100%) of 1" in page
    assert page.count("data:image/webp;base64,") == 1
    assert "<script>" not in page and "&lt;script&gt;alert(1)&lt;/script&gt; &amp; the red block" in page
    assert "http" not in page.replace("http-equiv", "")


def test_a_folder_without_figures_is_refused(tmp_path: Path) -> None:
    (tmp_path / "suite.json").write_text(json.dumps({"version": 1, "name": "s", "variation": {}, "tasks": []}))
    with pytest.raises(InputError, match=r"evaluation\.json"):
        render_evaluation_page(tmp_path, tmp_path)


def test_no_instance_is_written_through_a_link(evaluated: tuple[Path, Path], tmp_path: Path) -> None:
    suite, out = evaluated
    foreign = shutil.copytree(out, tmp_path / "foreign", ignore=shutil.ignore_patterns("instances"))
    (tmp_path / "elsewhere").mkdir()
    (foreign / "instances").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="instances is a link"):
        render_evaluation_page(suite, foreign)
    assert not any((tmp_path / "elsewhere").iterdir())


def test_text_of_an_episode_is_drawn_by_the_viewer_and_fetches_nothing(
    evaluated: tuple[Path, Path], tmp_path: Path
) -> None:
    suite, out = evaluated
    row = find_episode(suite, out, "put-block-left-default-0")
    row = row.model_copy(update={"instruction": "\N{GRINNING FACE}", "detail": "![x](http://host/x.png)"})
    recording = record_episode(make_episode_shot(suite, out, row), row, tmp_path / "episode.rrd")
    chunks = RrdReader(recording).stream().to_chunks()
    (text,) = (str(chunk.to_record_batch()) for chunk in chunks if str(chunk.entity_path) == Paths.TASK)
    assert "<U+1F600>" in text and "! [x]" in text


def test_an_episode_is_written_as_a_recording(evaluated: tuple[Path, Path], tmp_path: Path) -> None:
    suite, out = evaluated
    file = tmp_path / "episode.rrd"
    named = ["report", str(out), "--suite", str(suite), "--out", str(file)]
    done = grs(*named, "--episode", "put-block-left-default-0", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    paths = {str(chunk.entity_path) for chunk in RrdReader(file).stream().to_chunks()}
    assert Paths.TASK in paths and f"{Paths.WORLD}/tool_path" in paths
    assert any(path.startswith(f"{Paths.WORLD}/robot/") for path in paths)
    refused = grs(*named, "--episode", "put-block-left-default-7", folder=tmp_path)
    assert refused.returncode == 2 and "put-block-left-default-0" in refused.stderr
    other = tmp_path / "other"
    shutil.copytree(suite, other)
    (other / "suite.json").write_text((suite / "suite.json").read_text().replace('"blocks"', '"other"'))
    named[named.index(str(suite))] = str(other)
    refused = grs(*named, "--episode", "put-block-left-default-0", folder=tmp_path)
    assert refused.returncode == 2 and "no evaluation of the suite" in refused.stderr
