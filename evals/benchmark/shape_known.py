"""Known shapes: an asset of the library alone on a table, photographed with a sensor's noise from a random camera."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

from evals.synthesis.camera import random_camera
from evals.synthesis.drawing import draw_scene
from evals.synthesis.scenery import random_scenery
from evals.synthesis.sensors import SENSORS, SensorKind
from evals.synthesis.sensors.common import noisy_rgb
from grs_agents.base import Quat
from grs_agents.library.library import Library
from grs_agents.library.posed_meshes import build_posed_triangles
from grs_agents.perception.asset_surfaces import Tree
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.shapes.types import ObjectShape, ObjectView, make_object_view
from grs_agents.perception.types import Array, RGBDFrame, TableFrame

_PLACE = (0.5, 0.0)
_TILTS = (25.0, 70.0)
_STANDING: Quat = (0.0, 0.0, 0.0, 1.0)
_LYING: Quat = (2**-0.5, 0.0, 0.0, 2**-0.5)
_SAMPLES = 4000
TOLERANCE = 0.006


@dataclass(frozen=True)
class KnownObject:
    """A photographed asset."""

    name: str
    sensor: SensorKind
    view: ObjectView
    surface: Array  # (N, 3) points all over its true surface, object frame, m
    hidden: npt.NDArray[np.bool_]  # (N,) occluded from the camera


def photograph_known(number: int, seed: int, library: Library) -> KnownObject | None:
    """An asset, standing or lying, from a camera that looks down 25 to 70 degrees; the sensors take turns by number.

    ``None`` if the sensor measures too little of the object.
    """
    assets = [asset for asset in library.everyday_assets() if asset.category != "proxy"]
    rng = np.random.default_rng((seed, number))
    asset = assets[int(rng.integers(len(assets)))]
    sensor = list(SENSORS)[number % len(SENSORS)]
    turn = _LYING if rng.random() < 0.3 and not asset.hollow else _STANDING
    yaw = float(rng.uniform(-np.pi, np.pi))
    w, z = float(np.cos(yaw / 2)), float(np.sin(yaw / 2))
    x1, y1, z1, w1 = turn
    turned = (w * x1 - z * y1, w * y1 + z * x1, w * z1 + z * w1, w * w1 - z * z1)
    triangles = build_posed_triangles([(asset.name, ((0.0, 0.0, 0.0), turned))], library)
    low, high = triangles.corners.min(axis=(0, 1)), triangles.corners.max(axis=(0, 1))
    place = (*(np.array(_PLACE) - (low[:2] + high[:2]) / 2).tolist(), -float(low[2]))
    triangles = build_posed_triangles([(asset.name, (place, turned))], library)
    middle = (*_PLACE, float(high[2] - low[2]) / 2)
    camera = random_camera(float(rng.uniform(*_TILTS)), middle, (640, 480), rng)
    seen = draw_scene(triangles, random_scenery(rng), camera)
    depth = SENSORS[sensor](seen, camera, rng).astype(np.float32)
    frame = RGBDFrame(noisy_rgb(seen.rgb, rng), depth, camera, library.asset_path(asset.name))
    table = TableFrame(T_robot_cam=camera.T_robot_cam or (), origin="calibrated", residual=0.0, inliers=1.0)
    mask = seen.labels == 1
    if (depth[mask] > 0).mean() < 0.3:
        return None
    candidate = measure_candidates(frame, table, mask.astype(np.int32))[0]
    # Deviation of the depth of the table around the object, without outliers.
    around = (seen.labels == 0) & (depth > 0) & (np.abs(seen.depth - np.median(seen.depth[seen.labels == 1])) < 0.1)
    noise = max(1.4826 * float(np.median(np.abs(depth - seen.depth)[around])), 0.0005)
    view = make_object_view(frame, table, mask, candidate.upright, noise, candidate.hollow)
    solid = trimesh.Trimesh(triangles.corners.reshape(-1, 3), np.arange(3 * len(triangles.corners)).reshape(-1, 3))
    points = np.asarray(trimesh.sample.sample_surface(solid, _SAMPLES, seed=0)[0], np.float64)
    pose = np.asarray(camera.T_robot_cam)
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    column = np.rint(local[:, 0] / local[:, 2] * camera.fx + camera.cx).astype(int).clip(0, camera.width - 1)
    row = np.rint(local[:, 1] / local[:, 2] * camera.fy + camera.cy).astype(int).clip(0, camera.height - 1)
    hidden = np.asarray(local[:, 2] > seen.depth[row, column] + TOLERANCE)
    to_object = view.T_object_cam @ np.linalg.inv(np.asarray(camera.T_robot_cam))
    return KnownObject(asset.name, sensor, view, points @ to_object[:3, :3].T + to_object[:3, 3], hidden)


def shape_score(known: KnownObject, shape: ObjectShape | None) -> tuple[float, float]:
    """F-score of the whole surface at 6 mm, and the share of the hidden side that the shape has within 6 mm.

    Without a shape, the measured box is scored.
    """
    if shape is not None:
        solid = trimesh.Trimesh(shape.mesh.vertices, shape.mesh.faces, process=False)
    else:
        solid = trimesh.creation.box(known.view.size)
        solid.apply_translation((0, 0, known.view.size[2] / 2))
    points = np.asarray(trimesh.sample.sample_surface(solid, _SAMPLES, seed=0)[0], np.float64)
    precise = np.sqrt(Tree(known.surface).find_nearest_points(points)[1]) < TOLERANCE
    complete = np.sqrt(Tree(points).find_nearest_points(known.surface)[1]) < TOLERANCE
    both = float(precise.mean() + complete.mean())
    return 2 * float(precise.mean() * complete.mean()) / max(both, 1e-9), float(complete[known.hidden].mean())
