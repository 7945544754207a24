"""An evaluation as a self-contained HTML page: success with intervals, and films of first successes and failures."""

import base64
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Final

from grs_agents.base.errors import GrsError
from grs_agents.base.templates import load_template
from grs_agents.tasks.suites.evaluation import (
    EpisodeResult,
    EvaluationSummary,
    read_results,
    read_summary,
)
from grs_agents.tasks.suites.perturbation import Effect
from grs_agents.tasks.suites.statistics import Interval
from grs_agents.views.evaluation.episodes import make_episode_shot
from grs_agents.views.film.rollout_film import (
    Take,
    draw_take_captions,
    encode_animation,
    make_film_take,
    render_takes,
)
from grs_agents.views.report.page import POLICY

_SIZE: Final = (400, 300)
_RATE: Final = 8.0
"""Frames per second of a film: legible, at some 150 KB."""
_LONGEST: Final = 80
"""Frames of a film; longer episodes are shown faster."""
_WIDTH: Final = 320
"""Pixels of a bar of 100 %."""
_MOST_FAILURES: Final = 200
"""Rows of the table of episodes without success."""
_MOST_LOG_ODDS: Final = 8.0
"""Ends of the axis of effects: beyond them success is all or nothing."""


@dataclass(frozen=True)
class Bar:
    """A success rate as a bar with its interval; x in pixels."""

    name: str
    interval: Interval
    text: str

    @property
    def mean(self) -> float:
        """End of the bar."""
        return _WIDTH * self.interval.mean

    @property
    def low(self) -> float:
        """Lower end of the interval."""
        return _WIDTH * self.interval.low

    @property
    def high(self) -> float:
        """Upper end of the interval."""
        return _WIDTH * self.interval.high


@dataclass(frozen=True)
class EffectView:
    """An effect as a point with its interval on an axis of log odds; x in pixels."""

    effect: Effect

    @property
    def text(self) -> str:
        """The effect in words."""
        odds, alone = self.effect.log_odds, self.effect.alone
        rate = f", {alone.mean:.0%} of {alone.count} with it alone" if alone.count else ""
        return f"{odds.value:+.1f} ({odds.low:+.1f} to {odds.high:+.1f}), {self.effect.verdict}{rate}"

    @property
    def places(self) -> tuple[float, float, float]:
        """Coefficient, and ends of its interval."""
        odds = self.effect.log_odds
        value, low, high = (
            _WIDTH * (0.5 + 0.5 * min(max(number / _MOST_LOG_ODDS, -1.0), 1.0))
            for number in (odds.value, odds.low, odds.high)
        )
        return value, low, high


@dataclass(frozen=True)
class Film:
    """An episode as an animation."""

    url: str  # data URL; empty if it cannot be drawn
    caption: str


@dataclass(frozen=True)
class TaskView:
    """A task with its bar, words, and films of the first success and the first failure."""

    bar: Bar
    words: str
    tags: tuple[str, ...]
    films: tuple[Film, ...]


def render_evaluation_page(suite_folder: Path, out: Path, show: Callable[[str], None] = lambda _: None) -> str:
    """The page of the evaluation in ``out``, of the suite in ``suite_folder``. Raises InputError: either is none."""
    summary, results = read_summary(out), read_results(out)
    tasks = list(_describe_tasks(suite_folder, summary, results, out, show))
    groups = {"By tag": summary.by_tag, "By words": summary.by_words if len(summary.by_words) > 1 else {}}
    failures = [row for row in results if not row.success]
    return load_template(Path(__file__).with_name("page.html")).render(
        policy=POLICY,
        summary=summary,
        total=_bar("all tasks", summary.success),
        groups={
            title: [_bar(name, interval) for name, interval in rows.items()] for title, rows in groups.items() if rows
        },
        effects=[EffectView(effect) for effect in summary.effects],
        tasks=tasks,
        failures=failures[:_MOST_FAILURES],
        failed=len(failures),
        width=_WIDTH,
        style=Path(__file__).parents[1].joinpath("report", "style.css").read_text("utf-8"),
    )


def _bar(name: str, interval: Interval) -> Bar:
    bounds = f"{interval.low:.0%} to {interval.high:.0%}"
    return Bar(name, interval, f"{interval.mean:.0%} ({bounds}) of {interval.count}")


def _describe_tasks(
    suite_folder: Path,
    summary: EvaluationSummary,
    results: Sequence[EpisodeResult],
    out: Path,
    show: Callable[[str], None],
) -> Iterator[TaskView]:
    shown: list[EpisodeResult] = []  # the first success and the first failure of each task
    for item in summary.tasks:
        for success in (True, False):
            rows = (row for row in results if row.task == item.task and row.success == success)
            shown += [row] if (row := next(rows, None)) else []
    show(f"{len(shown)} films")
    films = dict(zip(shown, _draw_films(suite_folder, shown, out), strict=True))
    for item in summary.tasks:
        words = ", ".join(dict.fromkeys(row.instruction for row in results if row.task == item.task))
        own = tuple(film for row, film in films.items() if row.task == item.task)
        yield TaskView(_bar(item.task, item.success), words, tuple(item.tags), own)


def _draw_films(suite_folder: Path, rows: Sequence[EpisodeResult], out: Path) -> list[Film]:
    """Films of episodes from their recorded motions, drawn by a single process."""
    takes = [_plan_take(suite_folder, row, out) for row in rows]
    films: list[Film] = []
    try:
        images = render_takes(takes) if takes else iter(())
        for row, take in zip(rows, takes, strict=True):
            frames = list(draw_take_captions(take, islice(images, len(take[1]))))
            film = base64.b64encode(encode_animation(frames, _RATE, "webp")).decode()
            films.append(Film(f"data:image/webp;base64,{film}", _caption(row)))
    except GrsError as error:
        films += [Film("", f"{_caption(row)} (no film: {error.message})") for row in rows[len(films) :]]
    return films


def _caption(row: EpisodeResult) -> str:
    caption = f"{row.outcome.replace('_', ' ')}, instance {row.instance}, {row.seconds:.0f} s"
    return f"{caption}: {row.detail}" if row.detail else caption


def _plan_take(suite_folder: Path, row: EpisodeResult, out: Path) -> Take:
    """The shot and the frame times of an episode."""
    shot = replace(make_episode_shot(suite_folder, out, row), width=_SIZE[0], height=_SIZE[1])
    return make_film_take(shot, min(_RATE, _LONGEST / max(shot.recorded_motion.duration_seconds, 1.0)))
