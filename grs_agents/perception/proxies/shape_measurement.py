"""What a proxy of a candidate needs to know of the photo: the candidate's shape in its own frame, and its look."""

from dataclasses import replace

import cv2
import numpy as np

from grs_agents.geometry import rotation_about_z
from grs_agents.perception.proxies.free_space_grid import free_space_map, is_box_crowded, points_in_box_frame
from grs_agents.perception.proxies.neighbors import Surroundings
from grs_agents.perception.proxies.proxy_kind import MeasuredShape
from grs_agents.perception.proxies.proxy_writer import ProxyTexture
from grs_agents.perception.table_finding import pixels_to_robot_frame, project_to_pixels
from grs_agents.perception.types import Array, Image, Mask, RGBDFrame, TableFrame, UprightBox

_POINTS = 1500
ON = 0.004  # what is nearer than this (m) to a known object is its surface
FEWEST = 50  # fewer points tell of no shape
_LARGEST = 512  # the longer side of a texture has at most so many pixels


def measure_shape(
    frame: RGBDFrame, table: TableFrame, mask: Mask, box: UprightBox, around: Surroundings | None = None
) -> MeasuredShape:
    """The measured points of a candidate, (H, W) pixels, and how high it may be where the photo shows nothing else."""
    if around is not None:
        mask = _drop_known_object_pixels(frame, table, mask, around)
    points = points_in_box_frame(frame, table, mask & (frame.depth > 0), box)
    entered = around is not None and is_box_crowded(box, around)
    return MeasuredShape(
        points[:: max(1, len(points) // _POINTS)], free_space_map(frame, table, mask, box, around), entered
    )


def _drop_known_object_pixels(frame: RGBDFrame, table: TableFrame, mask: Mask, around: Surroundings) -> Mask:
    """The pixels (H, W) of a mask that do not show a known object beside it, if any are left."""
    rows, columns = np.nonzero(mask & (frame.depth > 0))
    theirs = replace(around, claims=()).occupied_points_mask(pixels_to_robot_frame(frame, table, rows, columns), ON)
    own = mask.copy()
    own[rows[theirs], columns[theirs]] = False
    return own if (~theirs).sum() >= FEWEST else mask


def extract_proxy_texture(frame: RGBDFrame, table: TableFrame, mask: Mask, box: UprightBox) -> ProxyTexture | None:
    """The photo's own texture; ``None`` where too little is seen."""
    solid = np.asarray(cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)), bool)
    solid = solid if solid.sum() > 50 else mask
    left, top, width, height = cv2.boundingRect(solid.astype(np.uint8))
    if width < 4 or height < 4:
        return None
    window = (slice(top, top + height), slice(left, left + width))
    image, known = frame.rgb[window], solid[window]
    filled = _fill_from_nearest_pixels(image, known)
    scale = min(1.0, _LARGEST / max(width, height))
    if scale < 1:
        filled = np.asarray(cv2.resize(filled, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
    turn = rotation_about_z(box.yaw)

    def uv_of(points: Array) -> Array:
        columns, rows, _ = project_to_pixels(points @ turn.T + box.center, frame.camera, table)
        return np.stack([(columns - left) / width, 1 - (rows - top) / height], axis=1)

    to_camera = (np.asarray(table.T_robot_cam)[:3, 3] - box.center) @ turn
    return ProxyTexture(filled, uv_of, to_camera / np.linalg.norm(to_camera))


def _fill_from_nearest_pixels(image: Image, known: Mask) -> Image:
    """The image, where each pixel that is not of the object has the colour of the nearest that is."""
    missing = (~known).astype(np.uint8)
    nearest = cv2.distanceTransformWithLabels(missing, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)[1]
    labels = nearest.astype(np.int64)
    owners = np.zeros((int(labels.max()) + 1, 3), np.uint8)
    owners[labels[known]] = image[known]
    return np.ascontiguousarray(owners[labels])
