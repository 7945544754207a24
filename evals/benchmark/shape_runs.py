"""Shapes reconstructed from known objects and from real scenes: figures, targets and sheets."""

import statistics
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from evals.benchmark.contact_sheet import write_picture, write_words
from evals.benchmark.shape_known import photograph_known, shape_score
from grs_agents.base import Frozen
from grs_agents.base.geometry.raster import barycentric_coordinates, rasterise_triangles
from grs_agents.base.geometry.transforms import rotation_about_z
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import encode_png
from grs_agents.perception.proxies.meshes import mesh_to_obj_text
from grs_agents.perception.reading.scene_source import read_scene, short_scene_name
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.shapes.reconstruction import reconstruct_shape
from grs_agents.perception.shapes.types import ObjectMesh, ObjectShape, ObjectView, make_object_view
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import Array, Image

_TILE = 200
_BACK = (56, 56, 60)
_ASIDE = np.deg2rad(40)


def draw_mesh(
    mesh: ObjectMesh, focal: float, center: tuple[float, float], pose: Array, size: tuple[int, int]
) -> tuple[Image, Array]:
    """Colours (h, w, 3) and depth (h, w), m, 0 where there is nothing, of a mesh before a camera.

    Args:
        focal, center: of the camera, pixels.
        pose: (4, 4) from the camera frame to the object frame.
        size: height and width of the picture.
    """
    local = (mesh.vertices - pose[:3, 3]) @ pose[:3, :3]
    depth = np.maximum(local[:, 2], 1e-3)
    flat = local[:, :2] / depth[:, None] * focal + center
    buffer = rasterise_triangles(flat[mesh.faces], (1 / depth)[mesh.faces], size[1], size[0])
    shown = buffer.triangle >= 0
    away = np.where(shown, 1 / np.where(shown, buffer.nearness, 1), 0.0)
    rows, columns = np.nonzero(shown)
    rays = np.stack([(columns - center[0]) / focal, (rows - center[1]) / focal, np.ones(len(rows))], axis=1)
    triangle = mesh.faces[buffer.triangle[shown]]
    points = np.asarray(rays * away[shown, None], np.float64)
    weights = barycentric_coordinates(points, local[triangle])
    uvs = np.einsum("ij,ijk->ik", weights, mesh.uvs[triangle])
    height, width = mesh.texture.shape[:2]
    x, y = uvs[:, 0] * width - 0.5, (1 - uvs[:, 1]) * height - 0.5
    texture = np.pad(mesh.texture, ((1, 1), (1, 1), (0, 0)), mode="edge")
    picture = np.empty((*size, 3), np.uint8)
    picture[:] = _BACK
    picture[shown] = _bilinear(texture, x + 1, y + 1)
    return picture, away


def _bilinear(texture: Image, x: Array, y: Array) -> Image:
    x, y = np.clip(x, 0, texture.shape[1] - 1.001), np.clip(y, 0, texture.shape[0] - 1.001)
    column, row = x.astype(int), y.astype(int)
    right, down = (x - column)[:, None], (y - row)[:, None]
    top = texture[row, column] * (1 - right) + texture[row, column + 1] * right
    bottom = texture[row + 1, column] * (1 - right) + texture[row + 1, column + 1] * right
    return (top * (1 - down) + bottom * down).astype(np.uint8)


def shape_row(view: ObjectView, mesh: ObjectMesh | None, words: str) -> Image:
    """An object: the photo with the mask's outline, the mesh, and the mesh rotated by 40 and by 140 degrees."""
    rows, columns = np.nonzero(view.mask)
    middle = np.array([(columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2])
    side = 1.25 * max(np.ptp(columns), np.ptp(rows), 20)
    scale = _TILE / side
    shift = np.array([[scale, 0, _TILE / 2 - scale * middle[0]], [0, scale, _TILE / 2 - scale * middle[1]]])
    photo = np.asarray(cv2.warpAffine(view.rgb, shift, (_TILE, _TILE), flags=cv2.INTER_LINEAR), np.uint8)
    mask = np.asarray(cv2.warpAffine(view.mask.astype(np.uint8), shift, (_TILE, _TILE)), np.uint8)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outlined = np.asarray(cv2.drawContours(photo.copy(), outlines, -1, (255, 0, 255), 1), np.uint8)
    tiles = [outlined]
    if mesh is not None:
        camera = view.intrinsics
        center = (camera.cx * scale + shift[0, 2], camera.cy * scale + shift[1, 2])
        for angle in (0.0, _ASIDE, 3.5 * _ASIDE):
            turned = view.T_object_cam.copy()
            about = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
            turn = rotation_about_z(float(angle))
            turned[:3, :3] = turn @ turned[:3, :3]
            turned[:3, 3] = turn @ (turned[:3, 3] - about) + about
            tiles.append(draw_mesh(mesh, camera.fx * scale, center, turned, (_TILE, _TILE))[0])
    while len(tiles) < 4:
        tiles.append(np.full((_TILE, _TILE, 3), _BACK, np.uint8))
    bar = np.full((18, 4 * _TILE, 3), 255, np.uint8)
    return np.concatenate([write_words(bar, words, (4, 13), 0.4), np.concatenate(tiles, axis=1)])


def join_rows(rows: Sequence[Image], across: int) -> Image:
    """Rows of equal size, ``across`` side by side."""
    blank = np.full_like(rows[0], 255)
    padded = [*rows, *[blank] * (-len(rows) % across)]
    return np.concatenate(
        [np.concatenate(padded[start : start + across], axis=1) for start in range(0, len(padded), across)]
    )


_ROWS = 60


class ShapeFigures(Frozen):
    """The figures of an object; ``None`` without a shape, as for a box, or without ground truth."""

    name: str
    method: str  # of the shape; ``box`` if the measured box stays
    seconds: float  # CPU
    kilobytes: float | None = None  # of the mesh as OBJ and its picture as PNG
    faces: int | None = None
    silhouette_iou: float | None = None
    depth_error: float | None = None  # m
    f_score: float | None = None  # of the whole surface at 6 mm
    hidden: float | None = None  # share of the hidden side within 6 mm


class Shapes(Frozen):
    """Objects that are measured together, each with the name of its row on a sheet: a PNG file."""

    figures: tuple[ShapeFigures, ...] = ()
    pictures: tuple[str, ...] = ()


def measure_known(number: int, seed: int, pictures: Path) -> Shapes:
    """Reconstruct an asset photographed alone; its picture goes into the folder ``pictures``."""
    known = photograph_known(number, seed, Library())
    if known is None:
        return Shapes()
    figures, shape = _measured(f"{Path(known.name).stem} {known.sensor}", known.view)
    score, hidden = shape_score(known, shape)
    figures = figures.model_copy(update={"f_score": score, "hidden": hidden})
    picture = f"known-{number}.png"
    write_picture(pictures / picture, _row(known.view, shape, figures))
    return Shapes(figures=(figures,), pictures=(picture,))


def measure_real(folder: Path, pictures: Path) -> Shapes:
    """Reconstruct the objects of a scene folder, by ``labels.png`` if present, else as GRS segments them.

    Raises:
        InputError: the folder holds no scene, or no table or object is found in it.
    """
    figures: list[ShapeFigures] = []
    names: list[str] = []
    frame = read_scene(folder)
    table = find_table(frame, np.random.default_rng(0))
    file = folder / "labels.png"
    labelled = cv2.imread(str(file), cv2.IMREAD_UNCHANGED) if file.is_file() else None
    labels = segment_objects_on_table(frame, table) if labelled is None else np.asarray(labelled, np.int32)
    for candidate in measure_candidates(frame, table, labels):
        name = f"{short_scene_name(folder)} {candidate.id}"
        distance = float(np.median(frame.depth[candidate.mask & (frame.depth > 0)]))
        noise = 0.0012 + 0.0019 * max(distance - 0.4, 0.0) ** 2
        view = make_object_view(frame, table, candidate.mask, candidate.upright, noise, candidate.hollow)
        row, shape = _measured(name, view)
        figures.append(row)
        names.append(f"real-{name.replace(' ', '-')}.png")
        write_picture(pictures / names[-1], _row(view, shape, row))
    return Shapes(figures=tuple(figures), pictures=tuple(names))


def _measured(name: str, view: ObjectView) -> tuple[ShapeFigures, ObjectShape | None]:
    cv2.setNumThreads(1)
    start = time.process_time()
    shape = reconstruct_shape(view)
    seconds = time.process_time() - start
    if shape is None:
        return ShapeFigures(name=name, method="primitive", seconds=seconds), None
    mesh = shape.mesh
    size = len(mesh_to_obj_text((mesh.vertices, mesh.faces), mesh.uvs)) + len(encode_png(mesh.texture))
    method = shape.method + (" hollow" if shape.hollow else "")
    figures = ShapeFigures(
        name=name,
        method=method,
        seconds=seconds,
        kilobytes=size / 1000,
        faces=len(mesh.faces),
        silhouette_iou=shape.silhouette_iou,
        depth_error=shape.depth_error,
    )
    return figures, shape


def _row(view: ObjectView, shape: ObjectShape | None, figures: ShapeFigures) -> Image:
    words = [figures.name, figures.method, f"{figures.seconds:.2f} s"]
    if figures.silhouette_iou is not None and figures.depth_error is not None:
        words += [
            f"IoU {figures.silhouette_iou:.2f}",
            f"depth {1000 * figures.depth_error:.1f} mm",
            f"{figures.kilobytes:.0f} KB",
        ]
    if figures.f_score is not None and figures.hidden is not None:
        words += [f"F {figures.f_score:.2f}", f"hidden {figures.hidden:.2f}"]
    return shape_row(view, None if shape is None else shape.mesh, "  ".join(words))


def write_sheets(out: Path, name: str, pictures: Sequence[Path]) -> None:
    """Write ``name_0.png`` and so on: photo, mesh, mesh from 40 and from 140 degrees aside."""
    rows = [np.asarray(cv2.imread(str(file)), np.uint8)[:, :, ::-1] for file in pictures]
    for number, start in enumerate(range(0, len(rows), _ROWS)):
        write_picture(out / f"{name}_{number}.png", join_rows(rows[start : start + _ROWS], 2))


def shape_targets(known: Sequence[ShapeFigures], real: Sequence[ShapeFigures]) -> list[dict[str, Any]]:
    """The measured figures of shapes with their targets."""
    every = [*known, *real]
    scores = _known_values(known, "f_score")
    overlaps, errors = _known_values(real, "silhouette_iou"), _known_values(real, "depth_error")
    most = [_known_values(every, name) for name in ("seconds", "kilobytes", "faces")]
    return [
        _target("F at 6 mm, mean", _mean(scores), least=0.9),
        _target("F at 6 mm, least", min(scores, default=None), least=0.65),
        _target("hidden side within 6 mm, mean", _mean(_known_values(known, "hidden"))),
        _target("silhouette IoU, median", statistics.median(overlaps) if overlaps else None, least=0.9),
        _target("silhouette IoU of 0.85 or more, share", _mean([float(iou >= 0.85) for iou in overlaps]), least=0.8),
        _target("depth error below 8 mm, share", _mean([float(error < 0.008) for error in errors]), least=0.8),
        _target("CPU of an object, most, s", max(most[0], default=None), most=1.0),
        _target("mesh and picture, most, KB", max(most[1], default=None), most=150.0),
        _target("faces, most", max(most[2], default=None), most=2000.0),
        _target("objects that are boxes", float(sum(item.method in ("box", "primitive") for item in every))),
    ]


def _known_values(figures: Sequence[ShapeFigures], name: str) -> list[float]:
    return [float(value) for item in figures if (value := getattr(item, name)) is not None]


def _mean(values: Sequence[float]) -> float | None:
    return statistics.fmean(values) if values else None


def _target(name: str, value: float | None, least: float | None = None, most: float | None = None) -> dict[str, Any]:
    met = None
    if value is not None and (least is not None or most is not None):
        met = value >= (least or 0.0) if most is None else value <= most
    value = None if value is None else round(value, 3)
    return {"figure": name, "value": value, "target": most if least is None else least, "met": met}
