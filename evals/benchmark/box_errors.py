"""Errors of measured boxes and table frames."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from evals.benchmark.ground_truth import LabelledScene, TrueObject
from evals.benchmark.segmentation_metrics import MATCHED, overlaps
from evals.benchmark.types import FrameFigures, ObjectFigures
from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.library.posed_meshes import build_posed_triangles
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import Aabb, Candidate, TableFrame

Floats = npt.NDArray[np.float64]


def object_figures(
    scene: LabelledScene,
    segments: npt.NDArray[np.int32],
    candidates: Sequence[Candidate],
    library: Library,
    table: TableFrame | None = None,
    stands: Mapping[int, Mapping[str, object]] | None = None,
) -> tuple[ObjectFigures, ...]:
    """Figures of each object that counts.

    Args:
        scene: the labelled scene.
        found: (H, W) numbers of the candidates.
        candidates: measured in the robot frame of the scene's calibration, if any.
        library: of the true assets.
        table: frame of the candidates, for ground truth in the camera frame.
        stands: figures of the objects' stand-ins in the twin, by label.
    """
    common = overlaps(segments, scene.labels, scene.ignored())
    partner = {row: (int(common.segments[column]), float(common.ious[row, column])) for row, column in common.pairs()}
    known = {item.id: item for item in scene.truth.objects}
    by_number = {candidate.id: candidate for candidate in candidates}
    figures: list[ObjectFigures] = []
    for row, (label, area) in enumerate(zip(common.truths.tolist(), common.truth_areas.tolist(), strict=True)):
        true = known.get(label, TrueObject(id=label))
        segment, iou = partner.get(row, (None, 0.0))
        visible = area / true.whole if true.whole else None
        more = dict((stands or {}).get(label, {}))
        box = _true_box(true, scene, library, table) if segment is not None and iou >= MATCHED else None
        if segment is not None and box is not None:
            measured = by_number[segment].box
            more["center"] = float(np.linalg.norm(np.subtract(measured.center, box.center)))
            more["size"] = float(np.abs(np.subtract(measured.size, box.size)).max())
        row_figures = ObjectFigures(
            id=label, asset=true.asset, kind=true.kind, visible=visible, iou=iou, segment=segment
        )
        figures.append(row_figures.model_copy(update=more))
    return tuple(figures)


def _true_box(true: TrueObject, scene: LabelledScene, library: Library, table: TableFrame | None) -> Aabb | None:
    """Axis-aligned box of an object in the frame of the candidates; ``None`` if unknown."""
    if table is not None and true.id in scene.points:
        pose = np.array(table.T_robot_cam)
        return _box_around(scene.points[true.id] @ pose[:3, :3].T + pose[:3, 3])
    rotation = true.rotation
    if scene.frame.camera.T_robot_cam is None:
        return None
    if true.box is not None or true.asset not in library or true.position is None or rotation is None:
        return true.box
    triangles = build_posed_triangles([(true.asset, (true.position, rotation))], library)
    return _box_around(triangles.corners.reshape(-1, 3))


def _box_around(points: Floats) -> Aabb:
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return Aabb(low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2]))


def frame_figures(scene: LabelledScene, rng: np.random.Generator) -> FrameFigures | None:
    """Difference of the table frame estimated without calibration from the calibrated frame; ``None`` without
    calibration.

    Raises:
        InputError: no table is found without calibration.
    """
    camera = scene.frame.camera
    if camera.T_robot_cam is None:
        return None
    true = np.array(camera.T_robot_cam)
    blind = type(scene.frame)(
        scene.frame.rgb, scene.frame.depth, camera.model_copy(update={"T_robot_cam": None}), scene.frame.source
    )
    estimate = np.array(find_table(blind, rng).T_robot_cam)
    tilt = float(np.rad2deg(np.arccos(np.clip(true[2, :3] @ estimate[2, :3], -1, 1))))
    points = scene.frame.camera_frame_point_map()[(scene.labels > 0) & (scene.frame.depth > 0)]
    if not len(points):
        raise InputError(f"{scene.name}: none of its objects has a depth", "label what was measured")
    middle = true[:3, :3] @ points.mean(axis=0) + true[:3, 3]
    on_table = true[:3, :3].T @ (np.array([middle[0], middle[1], 0.0]) - true[:3, 3])
    return FrameFigures(tilt=tilt, height=-float(estimate[2, :3] @ on_table + estimate[2, 3]))
