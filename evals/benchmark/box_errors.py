"""How far measured boxes and frames are off."""

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
    found: npt.NDArray[np.int32],
    candidates: Sequence[Candidate],
    library: Library,
    table: TableFrame | None = None,
    stands: Mapping[int, Mapping[str, object]] | None = None,
) -> tuple[ObjectFigures, ...]:
    """What became of each object that counts.

    Args:
        scene: with its truth.
        found: (H, W) numbers of the candidates.
        candidates: measured in the robot frame of the scene's calibration, if it has one.
        library: where the true assets are looked up.
        table: the frame that the candidates were measured in, for a truth that is given in the camera's.
        stands: by label, the figures of what stands for the objects in the twin.
    """
    common = overlaps(found, scene.labels, scene.ignored())
    partner = {row: (int(common.segments[column]), float(common.ious[row, column])) for row, column in common.pairs()}
    known = {one.id: one for one in scene.truth.objects}
    by_number = {one.id: one for one in candidates}
    figures: list[ObjectFigures] = []
    for row, (label, area) in enumerate(zip(common.truths.tolist(), common.truth_areas.tolist(), strict=True)):
        one = known.get(label, TrueObject(id=label))
        segment, iou = partner.get(row, (None, 0.0))
        visible = area / one.whole if one.whole else None
        more = dict((stands or {}).get(label, {}))
        if segment is not None and iou >= MATCHED:
            more |= _box_errors(_true_box(one, scene, library, table), by_number[segment])
        made = ObjectFigures(id=label, asset=one.asset, kind=one.kind, visible=visible, iou=iou, segment=segment)
        figures.append(made.model_copy(update=more))
    return tuple(figures)


def _true_box(one: TrueObject, scene: LabelledScene, library: Library, table: TableFrame | None) -> Aabb | None:
    """The axis-aligned box of an object in the frame of the candidates, as far as it is known."""
    if table is not None and one.id in scene.points:
        return _box_around(_moved(scene.points[one.id], table))
    return (one.box or _box_of(one, library)) if scene.frame.camera.T_robot_cam is not None else None


def _box_errors(box: Aabb | None, candidate: Candidate) -> dict[str, object]:
    if box is None:
        return {}
    return {
        "center": float(np.linalg.norm(np.subtract(candidate.box.center, box.center))),
        "size": float(np.abs(np.subtract(candidate.box.size, box.size)).max()),
    }


def _box_of(one: TrueObject, library: Library) -> Aabb | None:
    """The axis-aligned box of an asset at its pose."""
    rotation = one.rotation
    if one.asset not in library or one.position is None or rotation is None:
        return None
    return _box_around(build_posed_triangles([(one.asset, (one.position, rotation))], library).corners.reshape(-1, 3))


def _box_around(points: Floats) -> Aabb:
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return Aabb(low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2]))


def _moved(points: Floats, table: TableFrame) -> Floats:
    pose = np.array(table.T_robot_cam)
    return points @ pose[:3, :3].T + pose[:3, 3]


def frame_figures(scene: LabelledScene, rng: np.random.Generator) -> FrameFigures | None:
    """Agreement of the table frame found without calibration with the calibrated frame; ``None`` without
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
    found = np.array(find_table(blind, rng).T_robot_cam)
    tilt = float(np.rad2deg(np.arccos(np.clip(true[2, :3] @ found[2, :3], -1, 1))))
    points = scene.frame.camera_frame_point_map()[(scene.labels > 0) & (scene.frame.depth > 0)]
    if not len(points):
        raise InputError(f"{scene.name}: none of its objects has a depth", "label what was measured")
    middle = true[:3, :3] @ points.mean(axis=0) + true[:3, 3]
    on_table = true[:3, :3].T @ (np.array([middle[0], middle[1], 0.0]) - true[:3, 3])
    return FrameFigures(tilt=tilt, height=-float(found[2, :3] @ on_table + found[2, 3]))
