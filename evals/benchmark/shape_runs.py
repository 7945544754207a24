"""Shapes reconstructed from known objects and from real scenes: figures, targets and sheets."""

import statistics
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from evals.benchmark.contact_sheet import write_picture
from evals.benchmark.shape_known import photograph_known, shape_score
from evals.benchmark.shape_pictures import join_rows, shape_row
from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import encode_png
from grs_agents.perception.proxies.meshes import mesh_to_obj_text
from grs_agents.perception.reading.scene_source import read_scene, short_scene_name
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.shapes.reconstruction import reconstruct_shape
from grs_agents.perception.shapes.types import ObjectShape, ObjectView, make_object_view
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import Image

_ROWS = 60


class ShapeFigures(Frozen):
    """The figures of an object; ``None`` without a shape, as for a box, or without ground truth."""

    name: str
    method: str  # of the shape; ``box`` where the measured box stays
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
    one, shape = _measured(f"{Path(known.name).stem} {known.sensor}", known.view)
    score, hidden = shape_score(known, shape)
    one = one.model_copy(update={"f_score": score, "hidden": hidden})
    picture = f"known-{number}.png"
    write_picture(pictures / picture, _row(known.view, shape, one))
    return Shapes(figures=(one,), pictures=(picture,))


def measure_real(folder: Path, pictures: Path) -> Shapes:
    """Reconstruct the objects of a scene folder, by ``labels.png`` if present, else as GRS segments them.

    Raises:
        InputError: the folder holds no scene, or no table or object is found in it.
    """
    figures: list[ShapeFigures] = []
    names: list[str] = []
    for name, view in _views_of_scene(folder):
        one, shape = _measured(name, view)
        figures.append(one)
        names.append(f"real-{name.replace(' ', '-')}.png")
        write_picture(pictures / names[-1], _row(view, shape, one))
    return Shapes(figures=tuple(figures), pictures=tuple(names))


def scene_folders(places: Iterable[Path]) -> list[Path]:
    """The scene folders among places and in them.

    Raises:
        InputError: a place has none.
    """
    found: list[Path] = []
    for place in places:
        folders = sorted(file.parent for file in [*place.glob("camera.json"), *place.glob("*/camera.json")])
        if not folders:
            raise InputError(f"{place} holds no scene", "name a scene folder, or a folder of scene folders")
        found += folders
    return found


def _views_of_scene(folder: Path) -> Iterable[tuple[str, ObjectView]]:
    frame = read_scene(folder)
    table = find_table(frame, np.random.default_rng(0))
    file = folder / "labels.png"
    labelled = cv2.imread(str(file), cv2.IMREAD_UNCHANGED) if file.is_file() else None
    labels = segment_objects_on_table(frame, table) if labelled is None else np.asarray(labelled, np.int32)
    for one in measure_candidates(frame, table, labels):
        distance = float(np.median(frame.depth[one.mask & (frame.depth > 0)]))
        yield (
            f"{short_scene_name(folder)} {one.id}",
            make_object_view(frame, table, one.mask, one.upright, _noise(distance), one.hollow),
        )


def _noise(distance: float) -> float:
    """Deviation of structured light (m): Nguyen, Izadi and Lovell, "Modeling Kinect sensor noise", 2012."""
    return 0.0012 + 0.0019 * max(distance - 0.4, 0.0) ** 2


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


def _row(view: ObjectView, shape: ObjectShape | None, one: ShapeFigures) -> Image:
    words = [one.name, one.method, f"{one.seconds:.2f} s"]
    if one.silhouette_iou is not None and one.depth_error is not None:
        words += [f"IoU {one.silhouette_iou:.2f}", f"depth {1000 * one.depth_error:.1f} mm", f"{one.kilobytes:.0f} KB"]
    if one.f_score is not None and one.hidden is not None:
        words += [f"F {one.f_score:.2f}", f"hidden {one.hidden:.2f}"]
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
        _target("silhouette IoU of 0.85 or more, share", _mean([float(one >= 0.85) for one in overlaps]), least=0.8),
        _target("depth error below 8 mm, share", _mean([float(one < 0.008) for one in errors]), least=0.8),
        _target("CPU of an object, most, s", max(most[0], default=None), most=1.0),
        _target("mesh and picture, most, KB", max(most[1], default=None), most=150.0),
        _target("faces, most", max(most[2], default=None), most=2000.0),
        _target("objects that are boxes", float(sum(one.method in ("box", "primitive") for one in every))),
    ]


def _known_values(figures: Sequence[ShapeFigures], name: str) -> list[float]:
    return [float(value) for one in figures if (value := getattr(one, name)) is not None]


def _mean(values: Sequence[float]) -> float | None:
    return statistics.fmean(values) if values else None


def _target(name: str, value: float | None, least: float | None = None, most: float | None = None) -> dict[str, Any]:
    met = None
    if value is not None and (least is not None or most is not None):
        met = value >= (least or 0.0) if most is None else value <= most
    value = None if value is None else round(value, 3)
    return {"figure": name, "value": value, "target": most if least is None else least, "met": met}
