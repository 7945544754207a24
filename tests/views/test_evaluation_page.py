"""The page of an evaluation: figures, films, and foreign text escaped."""

import json
from pathlib import Path

import pytest

from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json
from grs_agents.sim.variation.types import Variation
from grs_agents.tasks.suites.evaluation import evaluate, make_order
from grs_agents.tasks.suites.layouts import PRESETS
from grs_agents.tasks.suites.suite import make_suite
from grs_agents.views.evaluation.page import render_evaluation_page
from tests.tasks.envs.conftest import block_instance


def test_the_page_shows_figures_and_films_and_loads_nothing(tmp_path: Path) -> None:
    run = tmp_path / "run"
    write_json(run / "instances" / "seed_0.json", block_instance(0).model_dump(mode="json"))
    write_json(run / "task.json", {"task-description": "<script>alert(1)</script> & the red block"})
    suite, out = tmp_path / "suite", tmp_path / "out"
    make_suite(suite, [run], "blocks", 1, Variation(jitter=0.01), workers=1)
    evaluate(suite, make_order(suite, "oracle", PRESETS["grs"], episodes=1), out, workers=1)
    page = render_evaluation_page(suite, out)
    assert "<h1>oracle on blocks</h1>" in page and "100% (21% to 100%) of 1" in page
    assert page.count("data:image/webp;base64,") == 1
    assert "<script>" not in page and "&lt;script&gt;alert(1)&lt;/script&gt; &amp; the red block" in page
    assert "http" not in page.replace("http-equiv", "")


def test_a_folder_without_figures_is_refused(tmp_path: Path) -> None:
    (tmp_path / "suite.json").write_text(json.dumps({"version": 1, "name": "s", "variation": {}, "tasks": []}))
    with pytest.raises(InputError, match=r"evaluation\.json"):
        render_evaluation_page(tmp_path, tmp_path)
