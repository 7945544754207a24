"""A run's scene against the ground truth: coverage, false objects, matches, and the appearance of the twin."""

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from evals.benchmark.ground_truth import LabelledScene, TrueObject
from evals.benchmark.scene_run import SceneRun
from evals.benchmark.segmentation_metrics import MOSTLY, overlaps
from evals.benchmark.types import RunFigures
from grs_agents.base import Pose
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception.asset_surfaces import Tree, asset_surface_at_pose, find_asset_symmetry
from grs_agents.perception.image_geometry import Labels
from grs_agents.perception.types import Mask, SceneObject
from grs_agents.sim.instance.task_instance import InstanceObject
from grs_agents.sim.motion.grasp import find_grasp
from grs_agents.sim.world.budget import Budget
from grs_agents.sim.world.compilation import build_world
from grs_agents.sim.world.footprints import object_prism_at_pose
from grs_agents.sim.world.physics import Physics

_FREE = (0.5, 0.0)
"""A free place in front of the robot, m."""
_SAMPLES = 400
"""Largest number of an asset's points for its diameter."""


def first_of_same_look(library: Library) -> dict[str, str]:
    """The first asset of the same appearance, by asset name: no method can distinguish them."""
    first: dict[str, str] = {}
    representative: dict[str, str] = {}
    for asset in library.everyday_assets():
        looks = repr(library.load_object_model(asset.name).visuals)
        representative[asset.name] = first.setdefault(looks, asset.name)
    return representative


def run_figures(scene: LabelledScene, segments: Labels, run: SceneRun) -> RunFigures:
    """The figures of the whole scene.

    Args:
        scene: the labelled scene.
        segments: (H, W) result of the segment tool.
        run: its result.
    """
    measured = (scene.labels > 0) & (scene.frame.depth > 0)
    fixed = np.zeros(measured.shape, np.bool_) if scene.fixed is None else scene.fixed
    areas = np.bincount(run.owners.ravel())
    others = np.bincount(run.owners[fixed], minlength=len(areas))
    before = set(overlaps(segments, scene.labels, scene.ignored()).matched().values())
    after = set(overlaps(run.owners, scene.labels, scene.ignored()).matched().values())
    coverage = run.scene.coverage
    return RunFigures(
        coverage=None if coverage is None else coverage.share,
        true_coverage=float(run.owned[measured].mean()) if measured.any() else None,
        refused=run.refused,
        fixed_as_objects=None if scene.fixed is None else int((others > MOSTLY * areas)[1:].sum()),
        right_segments=len(before),
        kept_segments=len(before & after),
        cpu_seconds=run.cpu_seconds,
    )


def twin_figures(scene: LabelledScene, run: SceneRun, library: Library) -> dict[int, dict[str, object]]:
    """Figures of each true object with a stand-in, named as in `ObjectFigures`, by label."""
    partner = overlaps(run.owners, scene.labels, scene.ignored()).matched()
    known, looks = {item.id: item for item in scene.truth.objects}, first_of_same_look(library)
    camera, file = scene.frame.camera, Path(scene.frame.source) / "depth_true.png"
    depth = np.asarray(scene.frame.depth, np.float64)
    if file.is_file():  # without noise
        depth = np.asarray(cv2.imread(str(file), cv2.IMREAD_UNCHANGED), np.float64) * camera.depth_scale
    figures: dict[int, dict[str, object]] = {}
    for item in run.scene.objects:
        if (label := partner.get(item.id)) is None:
            continue
        true_object = known.get(label, TrueObject(id=label))
        right = None  # without an asset or ground truth
        if item.matched and (true_object.asset or true_object.absent):
            true_look = looks.get(true_object.asset, true_object.asset)
            right = bool(true_object.asset) and looks.get(item.asset, item.asset) == true_look
        rows, columns = run.twin.owner.shape
        fixed = np.zeros(scene.labels.shape, np.bool_) if scene.fixed is None else scene.fixed
        free = ~_resized(fixed | scene.unlabelled, rows, columns)
        drawn = (run.twin.owner == item.id) & free
        shown = _resized(scene.labels == label, rows, columns) & free
        both, either = drawn & shown, int((drawn | shown).sum())
        true = np.asarray(cv2.resize(depth, (columns, rows), interpolation=cv2.INTER_NEAREST))
        errors = np.abs(run.twin.depth[both] - true[both])[true[both] > 0]
        figures[label] = {
            "stands": "asset" if item.matched else "shape",
            "right": right,
            "confidence": item.match.confidence if item.matched and item.match is not None else None,
            "drift": item.drift,
            "tilt": _tilt(item),
            "held": item.held,
            "seat": None if item.matched else _has_seat(item.asset, run.library),
            "silhouette": int(both.sum()) / either if either else 0.0,
            "depth_error": float(np.percentile(errors, 90)) if len(errors) else None,
        }
        if right and camera.T_robot_cam is not None:
            figures[label] |= _pose_errors(true_object, item, library)
    return figures


def _tilt(item: SceneObject) -> float | None:
    """Tilt of an object's stand-in until it rests, degrees."""
    if item.settled is None:
        return None
    before, after = (matrix_from_quaternion(turn)[:, 2] for turn in (item.orientation, item.settled[1]))
    return float(np.rad2deg(np.arccos(min(before @ after, 1.0))))


def _has_seat(asset: str, library: Library) -> bool:
    """True if the suction cup finds a grasp on the object, alone on the table."""
    model = library.load_object_model(asset)
    alone = [InstanceObject(id=0, asset=asset, pose=((*_FREE, -model.bounds[0][2]), (0.0, 0.0, 0.0, 1.0)))]
    physics = Physics(build_world(alone, library), Budget(), alone)
    return find_grasp(physics, 0, object_prism_at_pose(model, alone[0].pose, 0)).point is not None


def _resized(mask: Mask, rows: int, columns: int) -> Mask:
    small = cv2.resize(mask.astype(np.uint8), (columns, rows), interpolation=cv2.INTER_NEAREST)
    return np.asarray(small) > 0


def _pose_errors(true_object: TrueObject, item: SceneObject, library: Library) -> dict[str, object]:
    """Errors of the resting pose of an asset.

    ``adds`` is ADD-S as a share of the diameter: the mean distance of the true surface's points to the placed
    surface (Hinterstoisser et al., "Model based training, detection and pose estimation of texture-less 3D
    objects in heavily cluttered scenes", ACCV 2012).
    """
    rotation, (center, turned) = true_object.rotation, item.settled or (item.position, item.orientation)
    if true_object.position is None or rotation is None:
        return {}
    true, symmetry = matrix_from_quaternion(rotation), find_asset_symmetry(true_object.asset, library)
    x, y, z = (
        true @ np.mean(library.load_object_model(true_object.asset).bounds, axis=0) + true_object.position
    ).tolist()
    return {
        "position": float(np.linalg.norm(np.subtract(center, (x, y, z)))),
        "angle": symmetry.rotation_error_degrees(matrix_from_quaternion(turned), true),
        "symmetric": len(symmetry.axes) > 0,
        "adds": _adds(item.asset, (center, turned), ((x, y, z), rotation), library),
    }


def _adds(asset: str, placed: Pose, true: Pose, library: Library) -> float:
    """ADD-S of an asset, as a share of its diameter."""
    there, here = (asset_surface_at_pose(asset, pose, library).points for pose in (placed, true))
    _, squares = Tree(there).find_nearest_points(here)
    some: npt.NDArray[np.float64] = here[:: max(1, len(here) // _SAMPLES)]
    diameter = float(np.linalg.norm(some[:, None] - some[None], axis=2).max())
    return float(np.sqrt(np.maximum(squares, 0)).mean()) / diameter
