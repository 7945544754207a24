"""Contact sheets of scenes and their twins, and plots of the figures. Drawn with OpenCV alone."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from evals.benchmark.ground_truth import read_labelled
from evals.benchmark.scene_run import TWIN, TWIN_ASIDE
from evals.benchmark.types import Result, SceneFigures, result_file, run_folder
from grs_agents.base.files import write_bytes
from grs_agents.perception.image_geometry import mask_outline_pixels
from grs_agents.perception.types import Camera

Picture = npt.NDArray[np.uint8]
_TILE = 480
_ROWS = 8
"""Scenes on a page."""
_EDGES = [(0, 1), (0, 2), (0, 4), (1, 3), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 6), (5, 7), (6, 7)]
_HEX = "4285f4 db4437 0f9d58 f4a000 ab47bc 00acc1 ff7043 5c6bc0 9e9d24 ec407a"
_COLORS = [(int(code[:2], 16), int(code[2:4], 16), int(code[4:], 16)) for code in _HEX.split()]
_WHITE, _BLACK, _GREY = (255, 255, 255), (0, 0, 0), (170, 170, 170)


def write_pages(out: Path, rows: Sequence[Picture]) -> list[str]:
    """Write rows of pictures as pages ``sheet-01.png``, ...; gives their names."""
    names: list[str] = []
    for number, start in enumerate(range(0, len(rows), _ROWS), start=1):
        page = rows[start : start + _ROWS]
        width = max(row.shape[1] for row in page)
        edges = [(0, 6, 0, width - row.shape[1]) for row in page]
        padded = [
            cv2.copyMakeBorder(row, *edge, cv2.BORDER_CONSTANT, value=_WHITE)
            for row, edge in zip(page, edges, strict=True)
        ]
        names.append(f"sheet-{number:02d}.png")
        write_picture(out / names[-1], np.asarray(np.vstack(padded), np.uint8))
    return names


def measured_row(out: Path, result: Result) -> Picture:
    """A scene's photo with the true outlines, its segments with their boxes, and its twin, seen from the photo's camera
    and from aside."""
    scene = read_labelled(Path(result.order.source))
    file = result_file(out, result.order.name).with_suffix(".png")
    labels = np.asarray(cv2.imread(str(file), cv2.IMREAD_UNCHANGED), np.int32)
    photo = scene.frame.rgb.copy()
    for label in np.unique(scene.labels[scene.labels > 0]):
        columns, rows = mask_outline_pixels(scene.labels == label).T
        photo[rows, columns] = _GREY if int(label) in scene.ignored() else (255, 230, 0)
    segments = (scene.frame.rgb * 0.35).astype(np.uint8)
    for label in np.unique(labels[labels > 0]):
        color = np.array(_COLORS[int(label) % len(_COLORS)])
        mask = labels == label
        segments[mask] = (0.35 * scene.frame.rgb[mask] + 0.65 * color).astype(np.uint8)
    for number, corners in result.boxes.items():
        _draw_box(segments, np.array(corners), scene.frame.camera, _COLORS[number % len(_COLORS)])
    tiles = [photo, segments, *twin_pictures(run_folder(out, result.order.name))]
    score = result.figures.score
    words = [
        result.figures.name,
        result.figures.sensor,
        "" if result.figures.tilt is None else f"tilt {result.figures.tilt:.0f}",
    ]
    words += [f"{score.objects} objects, {score.segments} segments", f"F1 {score.f1[0]:.2f} / {score.f1[1]:.2f}"]
    words += [f"IoU {score.mean_iou:.2f}", f"split {score.split}, merged {score.merged}"]
    looks = [item.silhouette for item in result.figures.objects if item.silhouette is not None]
    words += [f"silhouettes {np.median(looks):.2f}" if looks else "", result.figures.error]
    return captioned_row("   ".join(word for word in words if word), tiles)


def twin_pictures(run: Path) -> list[Picture]:
    """The twin of a run seen from the photo's camera and from aside; empty for a failed run."""
    drawn = [cv2.imread(str(run / name)) for name in (TWIN, TWIN_ASIDE)]
    return [np.asarray(picture[:, :, ::-1], np.uint8) for picture in drawn if picture is not None]


def captioned_row(words: str, tiles: Sequence[Picture]) -> Picture:
    """Pictures of a scene side by side, of equal width, below a caption."""
    sizes = [(_TILE, round(tile.shape[0] * _TILE / tile.shape[1])) for tile in tiles]
    scaled = [cv2.resize(tile, size, interpolation=cv2.INTER_AREA) for tile, size in zip(tiles, sizes, strict=True)]
    row = np.hstack(scaled)
    bar = write_words(np.full((24, row.shape[1], 3), 255, np.uint8), words, (6, 17))
    return np.asarray(np.vstack([bar, row]), np.uint8)


def _draw_box(picture: Picture, corners: npt.NDArray[np.float64], camera: Camera, color: tuple[int, int, int]) -> None:
    if corners[:, 2].min() < 0.05:
        return
    columns = corners[:, 0] / corners[:, 2] * camera.fx + camera.cx
    rows = corners[:, 1] / corners[:, 2] * camera.fy + camera.cy
    points = np.stack([columns, rows], axis=1).clip(-9999, 9999).astype(int)
    for start, end in _EDGES:
        ends = [(int(points[corner][0]), int(points[corner][1])) for corner in (start, end)]
        cv2.line(picture, ends[0], ends[1], color, max(1, camera.width // 500), cv2.LINE_AA)


def write_words(picture: Picture, words: str, place: tuple[int, int], size: float = 0.45) -> Picture:
    """Write on a picture, in black."""
    cv2.putText(picture, words, place, cv2.FONT_HERSHEY_SIMPLEX, size, _BLACK, 1, cv2.LINE_AA)
    return picture


def write_picture(file: Path, picture: Picture) -> None:
    """Write a picture as PNG."""
    write_bytes(file, cv2.imencode(".png", np.ascontiguousarray(picture[:, :, ::-1]))[1].tobytes())


def write_plots(out: Path, scenes: Sequence[SceneFigures]) -> None:
    """Write ``scores.png`` (F1 and overlap of each scene) and ``errors.png`` (distribution of the errors)."""
    bars = [(scene.name, (scene.score.f1[0], scene.score.f1[1], scene.score.mean_iou_of_objects)) for scene in scenes]
    write_picture(out / "scores.png", _draw_bars(bars, ("F1 at IoU 0.5", "F1 at IoU 0.75", "mean IoU of all objects")))
    objects = [item for scene in scenes for item in scene.objects]
    curves = {
        name: sorted(1000 * value for item in objects if (value := getattr(item, attribute)) is not None)
        for name, attribute in (("box centre", "center"), ("box size", "size"), ("asset position", "position"))
    }
    if any(curves.values()):
        write_picture(
            out / "errors.png", _draw_error_curves({name: values for name, values in curves.items() if values})
        )


def _draw_bars(rows: Sequence[tuple[str, tuple[float, ...]]], names: Sequence[str]) -> Picture:
    """Horizontal bars from 0 to 1, a group for each row."""
    left, right, step = 190, 620, 14 * len(names) + 10
    picture = np.full((40 + step * len(rows) + 10, right + 60, 3), 255, np.uint8)
    for index, name in enumerate(names):
        cv2.rectangle(picture, (10 + 210 * index, 10), (22 + 210 * index, 22), _COLORS[index], cv2.FILLED)
        write_words(picture, name, (28 + 210 * index, 21))
    for number, (name, values) in enumerate(rows):
        top = 38 + step * number
        write_words(picture, name[:24], (8, top + step // 2), 0.4)
        for index, value in enumerate(values):
            length = round((right - left) * (0.0 if np.isnan(value) else value))
            y = top + 14 * index
            cv2.rectangle(picture, (left, y), (left + length, y + 11), _COLORS[index], cv2.FILLED)
            write_words(picture, f"{value:.2f}", (left + length + 4, y + 10), 0.36)
    return picture


def _draw_error_curves(curves: dict[str, list[float]], most: float = 40.0) -> Picture:
    """Cumulative distribution of the objects' errors, mm."""
    left, top, width, height = 50, 20, 560, 320
    picture = np.full((top + height + 40, left + width + 20, 3), 255, np.uint8)
    for share in np.linspace(0, 1, 6):
        y = round(top + height * (1 - share))
        cv2.line(picture, (left, y), (left + width, y), _GREY, 1)
        write_words(picture, f"{share:.0%}", (6, y + 4), 0.4)
    for value in range(0, int(most) + 1, 5):
        write_words(picture, f"{value}", (left + round(width * value / most) - 6, top + height + 16), 0.4)
    write_words(picture, "error at most, mm", (left + width - 150, top + height + 32), 0.4)
    for index, (name, values) in enumerate(curves.items()):
        x = left + np.clip(np.array(values) / most, 0, 1) * width
        y = top + height * (1 - np.arange(1, len(values) + 1) / len(values))
        points = np.rint(np.stack([x, y], axis=1)).astype(np.int32)
        cv2.polylines(picture, [points], False, _COLORS[index], 2, cv2.LINE_AA)
        place = (left + width - 190, top + height - 56 + 18 * index)  # between two grid lines
        cv2.rectangle(picture, (place[0], place[1] - 12), (place[0] + 12, place[1]), _COLORS[index], cv2.FILLED)
        write_words(picture, f"{name} ({len(values)})", (place[0] + 18, place[1]))
    return picture
