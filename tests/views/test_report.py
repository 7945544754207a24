"""The report: one page that holds all, fetches nothing and runs nothing, whatever models write."""

import base64
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from markupsafe import escape

from grs_agents.base.control_characters import escape_control_chars
from grs_agents.base.trace.events import Decision, Finding, Note, SceneStage, TaskDefined
from grs_agents.base.trace.events import TestsRun as Tested
from grs_agents.base.trace.log import EventLog, read_events
from grs_agents.library.library import Library
from grs_agents.views.film import rollout_film
from grs_agents.views.report import pictures as report_pictures
from grs_agents.views.report.page import POLICY, render_html_report
from grs_agents.views.report.pictures import Sources
from tests.views.conftest import Script

HOSTILE = '<script>alert(1)</script><img src=x onerror=alert(2)>"\'--></style></pre><a href="javascript:x">\x1b[2J\x00'
RECORD = {"id": "sample-run", "status": "accepted", "reason": HOSTILE, "counts": {"model_calls": 3}, "versions": {}}


class Tags(HTMLParser):
    """The tags and attributes of a page; checks that what is opened is closed."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: set[tuple[str, str]] = set()
        self.opened: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {(name, value or "") for name, value in attrs}
        if tag not in ("meta", "img", "image", "rect", "br", "source"):
            self.opened.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in ("image", "rect"):
            assert self.opened.pop() == tag


def parsed(text: str) -> Tags:
    """The tags of a whole page."""
    tags = Tags()
    tags.feed(text)
    assert tags.opened == []
    return tags


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, library: Library) -> str:
    """The page of a run in which everything that a model may write is hostile."""
    folder = tmp_path_factory.mktemp("hostile")
    run = Script(EventLog(folder / "events.jsonl"), folder)
    run.before_fix()
    run.after_fix()
    case = {"id": HOSTILE, "outcome": HOSTILE, "message": HOSTILE, "traceback": HOSTILE}
    run.node(
        HOSTILE,
        1,
        Decision(verdict=HOSTILE, explanation=HOSTILE, policy=HOSTILE),
        Note(level="error", text=HOSTILE),
        TaskDefined(task={HOSTILE: HOSTILE, "assets-used": [HOSTILE]}),
        Tested(report={"outcome": HOSTILE, "cases": [case], "message": HOSTILE}),
        Finding(check=HOSTILE, passed=False, measured=HOSTILE, bound=HOSTILE),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rollout_film, "_BACKENDS", ("rays",))
        patch.setattr(report_pictures, "FILM_RATE", 1.0)
        return render_html_report(RECORD, read_events(run.log.path), Sources(run.folder, library))


def test_the_page_leads_with_task_verdict_and_film_and_then_tells_the_steps(made: str) -> None:
    assert made.count("data:image/webp;base64,") == 1
    places = [
        made.index(part)
        for part in (
            "<h1>",
            '<b class="good">accepted</b>',
            "data:image/jpeg;base64,",
            "data:image/webp;base64,",
            "<b>generate_task</b> pack-milk",
            "prompt of task to offline",
            "reply of offline to task (call task-1): 900 tokens in, 120 out, 0.8 s, stop",
            "<h3>After fix 1</h3>",
            "Seed 1: success, reward 1.00",
            "<td>bystander</td></tr>",
        )
    ]
    assert places == sorted(places)


def test_a_fix_stands_beside_the_failure_that_it_answers_and_its_reason(made: str) -> None:
    (fix,) = re.findall(
        r'<details class="step" open>(?:(?!<details class="step").)*<b>fix_code</b>.*?</details>', made, re.S
    )
    places = [
        fix.index(part)
        for part in (
            '<h4 class="bad">test_oracle</h4>',
            "AssertionError: 0.25 &lt; 0.99",
            "Why fix_code, by policy llm",
            "with 1 of 4 objects placed, so the program is at fault",
            "simulation, version 2 by fix_code",
            '<span class="add">+        self.max_steps = 4</span>',
        )
    ]
    assert places == sorted(places)
    assert '<span class="hunk">+++ b</span>' in fix


def test_what_failed_has_the_colour_of_failure_and_what_passed_has_not(made: str) -> None:
    rows = dict(re.findall(r'<tr class="bad"><td>([^<]*)</td><td>([^<]*)</td>', made))
    assert rows[str(escape(escape_control_chars(HOSTILE)))] == "failed"
    assert "reward" not in rows and "<tr><td>reward</td><td>passed</td>" in made
    assert '<span class="bad">✗</span> 4 <b>run_tests</b> 1 passed, 1 failed' in made
    assert '<span class="good">✓</span> 7 <b>run_tests ×2</b> 2 passed' in made
    assert '<summary class="bad">test_oracle: failed in 1.20 s</summary>' in made
    assert '<summary class="good">test_oracle: passed in 1.20 s</summary>' in made


def test_the_simulated_view_holds_the_task_in_its_colours(
    script: Callable[[], Any], library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rollout_film, "_BACKENDS", ("rays",))
    monkeypatch.setattr(report_pictures, "FILM_RATE", 1.0)
    run = script()
    run.before_fix()
    sources = Sources(run.folder, library)
    run.after_fix()
    text = render_html_report(RECORD, read_events(run.log.path), sources)
    pictures = re.findall(r'base64,([^"]+)"[^>]*><figcaption>The same view of the task, seed 0', text)
    assert len(pictures) == 1
    decoded = cv2.imdecode(np.frombuffer(base64.b64decode(pictures[0]), np.uint8), cv2.IMREAD_COLOR)
    seen = np.asarray(decoded, dtype=int)
    blue, green, red = seen[..., 0], seen[..., 1], seen[..., 2]
    assert ((red > 130) & (green < 70) & (blue < 70)).sum() > 100  # the red block of the task
    assert ((blue > 110) & (red < 70)).sum() > 1000  # the print on milk and cookies, which are one colour each without


def test_photo_and_twin_are_laid_over_each_other(script: Callable[[], Any], library: Library) -> None:
    run = script()
    run.before_fix()
    before = render_html_report(RECORD, read_events(run.log.path), Sources(run.folder, library))
    cv2.imwrite(str(run.folder / "twin.png"), np.full((60, 80, 3), (200, 20, 20), np.uint8))
    run.log.append(SceneStage(stage="matched", files={"twin": "twin.png"}))
    text = render_html_report(RECORD, read_events(run.log.path), Sources(run.folder, library))
    parsed(text)
    assert 'class="compare"' not in before
    found = re.search(r'<div class="compare"><img src="data:image/jpeg;base64,([^"]+)" width="80" height="60"', text)
    assert found is not None
    twin = cv2.imdecode(np.frombuffer(base64.b64decode(found[1]), np.uint8), cv2.IMREAD_COLOR)
    assert np.abs(np.asarray(twin, int) - (200, 20, 20)).max() < 12
    assert re.search(r'<div class="over"><img src="data:image/jpeg;base64,[^"]+" width="80" height="60"', text)


def test_nothing_hostile_gets_through_and_nothing_is_fetched(made: str) -> None:
    tags = parsed(made)
    assert tags.tags.isdisjoint({"script", "a", "iframe", "object", "link", "form", "embed", "base"})
    assert not any(name.startswith("on") for name, _ in tags.attributes)
    sources = [value for name, value in tags.attributes if name in ("src", "srcset", "href", "xlink:href", "action")]
    assert sources and all(re.match("data:image/(jpeg|webp);base64,", value) for value in sources)
    assert ("content", POLICY) in tags.attributes and POLICY.startswith("default-src 'none'")
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f]", made)
    assert "url(" not in made and "@import" not in made


def test_what_cannot_be_drawn_is_said_and_the_page_stays_whole(
    script: Callable[[], Any], library: Library, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rollout_film, "_BACKENDS", ("rays",))
    run = script()
    run.before_fix()
    run.after_fix()
    (tmp_path / "instances" / "seed_0.json").write_text("{}")
    (tmp_path / "instances" / "seed_1.npz").unlink()
    (tmp_path / "rgb.png").unlink()
    text = render_html_report(RECORD, read_events(run.log.path), Sources(run.folder, library))
    parsed(text)
    assert "There is no picture of it" in text and "Seed 1: success" in text


def test_a_run_that_only_began_has_a_page(library: Library, tmp_path: Path) -> None:
    text = render_html_report({"id": "x", "status": "running"}, [], Sources(tmp_path, library))
    parsed(text)
    assert "running" in text
