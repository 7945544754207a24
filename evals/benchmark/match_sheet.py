"""Pictures of correspondence: each crop beside its asset, and the F1 of each method. Drawn with OpenCV alone."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from evals.benchmark.contact_sheet import Picture, write_picture, write_words
from evals.benchmark.match_types import Matching, ScoredAnswer
from grs_agents.base.errors import GrsError
from grs_agents.library.asset_rendering import render_asset_views
from grs_agents.library.library import Library

_TILE, _BAR, _ACROSS = 120, 34, 5
_COLORS = {
    "right": (15, 157, 88),
    "rightly none": (150, 200, 170),
    "wrong asset": (219, 68, 55),
    "false alarm": (244, 160, 0),
    "missed": (171, 71, 188),
}


def write_match_sheet(out: Path, matchings: Sequence[Matching]) -> None:
    """Write ``sheet-METHOD.png``: crop, answer and truth of every candidate, for a method's first model and run."""
    library, drawn = Library(), dict[str, Picture]()
    first: dict[str, tuple[str, int]] = {}
    rows: dict[str, list[Picture]] = {}
    for matching in matchings:
        key = (matching.order.model, matching.order.run)
        name = matching.order.method.name
        if matching.error or first.setdefault(name, key) != key:
            continue
        rows.setdefault(name, []).extend(_cell(out, answer, library, drawn) for answer in matching.answers)
    for name, cells in rows.items():
        blank = np.full_like(cells[0], 255)
        padded = [*cells, *([blank] * (-len(cells) % _ACROSS))]
        lines = [np.hstack(padded[at : at + _ACROSS]) for at in range(0, len(padded), _ACROSS)]
        write_picture(out / f"sheet-{name}.png", np.asarray(np.vstack(lines), np.uint8))


def write_match_plot(out: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write ``f1.png``: the mean F1 of each method and model with its 95 % interval."""
    left, width, step = 230, 420, 30
    picture = np.full((50 + step * len(rows), left + width + 70, 3), 255, np.uint8)
    for share in np.linspace(0, 1, 6):
        x = round(left + width * share)
        cv2.line(picture, (x, 10), (x, 20 + step * len(rows)), (220, 220, 220), 1)
        write_words(picture, f"{share:.1f}", (x - 10, 38 + step * len(rows)), 0.4)
    for number, row in enumerate(rows):
        mean, low, high = (float(row[name]) for name in ("F1", "F1 low", "F1 high"))
        y = 24 + step * number
        write_words(picture, f"{row['method']}  {row['model']}"[:32], (8, y + 5), 0.42)
        ends = [(round(left + width * min(max(value, 0), 1)), y) for value in (low, mean, high)]
        cv2.rectangle(picture, (left, y - 7), (ends[1][0], y + 7), (66, 133, 244), cv2.FILLED)
        cv2.line(picture, ends[0], ends[2], (0, 0, 0), 2)
        write_words(picture, f"{mean:.3f}", (ends[2][0] + 6, y + 5), 0.42)
    write_picture(out / "f1.png", picture)


def _cell(out: Path, answer: ScoredAnswer, library: Library, drawn: dict[str, Picture]) -> Picture:
    """The crop, the matched asset and the true asset, with a bar in the colour of the outcome."""
    image = cv2.imread(str(out / answer.crop))
    crop = _fitted(np.asarray(image[:, :, ::-1], np.uint8)) if image is not None else _fitted(None)
    tiles = [crop, _asset(answer.answer.asset, library, drawn), _asset(answer.truth, library, drawn)]
    bar = np.full((_BAR, 3 * _TILE, 3), 255, np.uint8)
    cv2.rectangle(bar, (0, 0), (8, _BAR), _COLORS[answer.outcome], cv2.FILLED)
    sure = "" if answer.answer.confidence is None else f" {answer.answer.confidence:.2f}"
    write_words(bar, f"{answer.outcome}{sure}", (14, 14), 0.4)
    write_words(bar, f"{answer.answer.asset or answer.answer.match} / {answer.truth or 'none'}"[:52], (14, 29), 0.36)
    cell = np.vstack([bar, np.hstack(tiles)])
    return np.asarray(cv2.copyMakeBorder(cell, 2, 4, 2, 6, cv2.BORDER_CONSTANT, value=(255, 255, 255)), np.uint8)


def _asset(name: str | None, library: Library, drawn: dict[str, Picture]) -> Picture:
    if not name or name not in library:
        return _fitted(None)
    if name not in drawn:
        try:
            rgba = render_asset_views(library, name, [(1.0, 0.6, 0.7)], size=_TILE)[0].rgba.astype(np.float64)
        except GrsError:  # the sheet does without
            return _fitted(None)
        cover = rgba[:, :, 3:] / 255
        drawn[name] = np.asarray(rgba[:, :, :3] * cover + 255 * (1 - cover), np.uint8)
    return drawn[name]


def _fitted(picture: Picture | None) -> Picture:
    """The picture in the middle of a white tile."""
    tile = np.full((_TILE, _TILE, 3), 255, np.uint8)
    if picture is None:
        return tile
    scale = _TILE / max(picture.shape[:2])
    size = (max(1, int(picture.shape[1] * scale)), max(1, int(picture.shape[0] * scale)))
    small = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
    top, left = (_TILE - small.shape[0]) // 2, (_TILE - small.shape[1]) // 2
    tile[top : top + small.shape[0], left : left + small.shape[1]] = small
    return tile
