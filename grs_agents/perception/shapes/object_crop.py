"""Crop of the photo around an object: cleaned mask and depth, points with normals, and free space."""

from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.raster import rasterise_triangles
from grs_agents.perception.asset_surfaces import Tree
from grs_agents.perception.image_geometry import mask_bounding_slices
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.surface_nets import Faces
from grs_agents.perception.shapes.types import ObjectView
from grs_agents.perception.types import Array, Image, Mask

CONFIG = DEFAULT.observation
CORNERS = 4  # points of a surface: fewer span no solid
FAR = 0.02  # truncation of signed distances, m
Depth = npt.NDArray[np.float32]
Value = TypeVar("Value", bound=np.generic)


@dataclass(frozen=True)
class ObjectCrop:
    """A window of the photo around an object; (h, w) pixels, object frame, metres."""

    rgb: Image  # (h, w, 3)
    measured: Depth  # (h, w) raw depth, 0 where nothing was measured
    mask: Mask  # (h, w) the object's pixels without table, flying pixels and holes
    depth: Depth  # (h, w) smoothed, and filled inside and beyond the mask
    edge: Depth  # (h, w) signed distance to the mask's edge, pixels, negative inside
    slope: Depth  # (h, w) cosine between ray and surface normal, at least 0.2
    focal: tuple[float, float]  # pixels
    center: tuple[float, float]  # principal point, pixels of the window
    photo: tuple[float, float, float, float]  # first and last column, first and last row of the photo
    T_object_cam: Array  # (4, 4)
    points: Array  # (N, 3) of the surface, away from its edges
    normals: Array  # (N, 3) towards the camera
    noise: float  # standard deviation of depth, m

    @property
    def eye(self) -> Array:
        """(3,) position of the camera."""
        return self.T_object_cam[:3, 3]

    def project(self, points: Array) -> tuple[Array, Array, Array]:
        """Column, row and depth of points (N, 3)."""
        return project_points(points, self.focal, self.center, self.T_object_cam)

    def lift(self, depth: Depth) -> Array:
        """(h, w, 3) points of the pixels at ``depth`` (h, w)."""
        return lift_pixels(depth, self.focal, self.center, self.T_object_cam)

    def free_distance(self, points: Array) -> Array:
        """(N,) signed distance of points (N, 3) to the space that the view shows to be free, m: positive in free space,
        which lies before the surface or beside the mask. NaN where a nearer surface occludes the point, and outside the
        photo."""
        column, row, depth = self.project(points)
        beside = (sample(self.edge, column, row, cv2.INTER_LINEAR, 50.0) - CONFIG.shrinkage) * depth / self.focal[0]
        smooth = sample(self.depth, column, row, cv2.INTER_LINEAR, 9.0)
        nearest = sample(self.depth, column, row, cv2.INTER_NEAREST, 9.0)
        before = np.where(np.abs(smooth - nearest) < CONFIG.same_surface, smooth, nearest) - depth
        free = np.maximum(beside, before)
        measured = sample(self.measured, column, row, cv2.INTER_NEAREST, 0.0)
        hidden = (beside > 0) & (measured > 0) & (measured < depth - CONFIG.nearer)
        left, right, top, bottom = self.photo
        cut = (column < left + 1) | (column > right - 1) | (row < top + 1) | (row > bottom - 1)
        return np.where(hidden | cut, np.nan, np.clip(free, -FAR, FAR))

    def depth_behind_surface(self, points: Array) -> Array:
        """(N,) depth of points (N, 3) behind the seen surface, along its normal, m."""
        column, row, depth = self.project(points)
        surface = sample(self.depth, column, row, cv2.INTER_NEAREST, 0.0)
        slope = sample(self.slope, column, row, cv2.INTER_NEAREST, 1.0)
        return (depth - surface) * slope

    def render_depth(self, vertices: Array, faces: Faces) -> npt.NDArray[np.float64]:
        """(h, w) depth of a mesh seen by the photo's camera, m; 0 beside the mesh."""
        column, row, depth = self.project(vertices)
        nearness = 1 / np.maximum(depth, 1e-3)
        corners = np.stack([column, row], axis=1)[faces]
        height, width = self.mask.shape
        buffer = rasterise_triangles(corners, nearness[faces], width, height)
        return np.where(buffer.triangle >= 0, 1 / np.where(buffer.triangle >= 0, buffer.nearness, 1), 0.0)


def sample(picture: npt.NDArray[np.float32], column: Array, row: Array, interpolation: int, outside: float) -> Array:
    """(N,) values of a picture (h, w) at pixel coordinates (N,); ``outside`` beyond its border."""
    width = 1024  # OpenCV's pictures have at most 32,767 rows and columns
    places = np.zeros((2, -(-len(column) // width) * width), np.float32)
    places[:, : len(column)] = column, row
    x, y = places.reshape(2, -1, width)
    values = cv2.remap(picture, x, y, interpolation, borderMode=cv2.BORDER_CONSTANT, borderValue=outside)
    return np.asarray(values, np.float64).ravel()[: len(column)]


def project_points(
    points: Array, focal: tuple[float, float], center: tuple[float, float], T_object_cam: Array
) -> tuple[Array, Array, Array]:
    """Column, row (pixels of a window) and depth (m) of points (N, 3) in the object frame, m."""
    local = (points - T_object_cam[:3, 3]) @ T_object_cam[:3, :3]
    depth = np.maximum(local[:, 2], 1e-6)
    return focal[0] * local[:, 0] / depth + center[0], focal[1] * local[:, 1] / depth + center[1], local[:, 2]


def lift_pixels(depth: Depth, focal: tuple[float, float], center: tuple[float, float], pose: Array) -> Array:
    """(h, w, 3) points of the pixels of a window at ``depth`` (h, w), transformed by ``pose`` (4, 4), m."""
    rows, columns = np.indices(depth.shape, dtype=np.float64)
    local = np.stack([(columns - center[0]) / focal[0] * depth, (rows - center[1]) / focal[1] * depth, depth], axis=-1)
    return local @ pose[:3, :3].T + pose[:3, 3]


def crop_object(view: ObjectView) -> ObjectCrop | None:
    """Crop the photo to an object, clean its mask and smooth its depth; ``None`` with too little measured depth."""
    if np.count_nonzero(view.mask & (view.depth > 0)) < CONFIG.fewest:
        return None
    rows, columns = mask_bounding_slices(view.mask)
    step = max(1, round(max(rows.stop - rows.start, columns.stop - columns.start) / CONFIG.pixels))
    margin = CONFIG.margin * step
    left, top = max(columns.start - margin, 0), max(rows.start - margin, 0)
    window = (slice(top, rows.stop + margin, step), slice(left, columns.stop + margin, step))
    focal = (view.intrinsics.fx / step, view.intrinsics.fy / step)
    center = ((view.intrinsics.cx - left) / step, (view.intrinsics.cy - top) / step)
    measured = np.ascontiguousarray(view.depth[window], np.float32)

    def lift(depth: Depth) -> Array:
        return lift_pixels(depth, focal, center, view.T_object_cam)

    jump = max(CONFIG.jump, CONFIG.jump_deviations * view.noise)  # of depth between two surfaces
    mask, sound = _clean_mask_and_sound_depth(view.mask[window].copy(), measured, lift(measured), view.noise, jump)
    if np.count_nonzero(sound) < CONFIG.fewest:
        return None
    depth = fill_from_nearest(np.where(sound, measured, 0).astype(np.float32), sound)
    depth = np.asarray(cv2.medianBlur(depth, 5), np.float32)
    for _ in range(2):
        depth = np.asarray(cv2.bilateralFilter(depth, 7, CONFIG.smooth_deviations * view.noise, 3), np.float32)
    edge = signed_edge_distance(mask)
    rays = lift(np.ones_like(depth)) - view.T_object_cam[:3, 3]
    on_support = (CONFIG.sunk - view.T_object_cam[2, 3]) / np.minimum(rays[..., 2], -1e-3)
    missing = mask & ~sound
    if missing.any():
        highest = float(np.percentile(lift(depth)[sound][:, 2], 98))
        walls = _depth_of_upright_walls(rays[missing], highest, edge, measured, (focal, center, view.T_object_cam))
        mixed = np.where(measured[missing] > 0, measured[missing], np.inf)
        depth[missing] = np.maximum(depth[missing], np.minimum(walls, mixed))
    depth = np.where(mask, np.minimum(depth, on_support), depth).astype(np.float32)
    surface = lift(depth)
    pixel = float(np.median(depth[mask])) / focal[0]
    reach = int(np.clip(np.ceil(CONFIG.reach_deviations * view.noise / pixel), 1, CONFIG.longest_reach))
    normals, slope, even = _surface_normals(surface, view.T_object_cam[:3, 3], reach, jump)
    inner = np.flatnonzero(sound & mask & even & (edge < -1))
    if len(inner) < CORNERS:
        return None
    inner = inner[:: max(1, len(inner) // CONFIG.points)]
    height, width = view.depth.shape
    rgb = view.rgb[top : rows.stop + margin, left : columns.stop + margin]
    if step > 1:
        rgb = np.asarray(cv2.resize(rgb, mask.shape[::-1], interpolation=cv2.INTER_AREA), np.uint8)
    return ObjectCrop(
        rgb=np.ascontiguousarray(rgb),
        measured=measured,
        mask=mask,
        depth=depth,
        edge=edge,
        slope=slope,
        focal=focal,
        center=center,
        photo=(-left / step, (width - 1 - left) / step, -top / step, (height - 1 - top) / step),
        T_object_cam=view.T_object_cam,
        points=surface.reshape(-1, 3)[inner],
        normals=normals.reshape(-1, 3)[inner],
        noise=view.noise,
    )


def _clean_mask_and_sound_depth(
    mask: Mask, depth: Depth, points: Array, noise: float, jump: float
) -> tuple[Mask, Mask]:
    """The mask without holes, table and stray pieces; and its pixels whose depth is no flying pixel and no outlier."""
    known = depth > 0
    for hole in connected_pieces(~mask, 1):  # a highlight is the object's unless it shows something farther away
        if hole.sum() > CONFIG.hole * mask.sum():
            continue
        around = dilate(hole, 5) & mask & known
        if around.any() and (depth[hole] < np.percentile(depth[around], 90) + 0.015).mean() > 0.6:
            mask = mask | hole
    low = points[..., 2] < max(CONFIG.low, 2 * noise)
    highest, lowest = cv2.dilate(depth, np.ones((3, 3))), cv2.erode(np.where(known, depth, 9), np.ones((3, 3)))
    middle = float(np.median(depth[mask & known])) if (mask & known).any() else 0.0
    sound = mask & known & (np.asarray(highest - lowest) < jump) & (np.abs(depth - middle) < CONFIG.farthest)
    for piece in connected_pieces(sound & low, CONFIG.smallest):  # the table seen through a handle
        around = dilate(piece, 9) & sound & ~low
        if around.any() and (np.median(depth[piece]) - depth[around] > jump).mean() > 0.6:
            mask, sound = mask & ~dilate(piece, 3), sound & ~dilate(piece, 3)
    # Beside the largest piece keep the large and the near ones: an inner wall, a half behind an occluder.
    pieces = sorted(connected_pieces(sound, CONFIG.smallest), key=np.count_nonzero, reverse=True)
    if len(pieces) > 1:
        tree, kept = Tree(points[pieces[0]]), pieces[0].copy()
        for piece in pieces[1:]:
            gap = np.sqrt(np.percentile(tree.find_nearest_points(points[piece][::3])[1], 10))
            if gap < CONFIG.apart or piece.sum() > 0.1 * sound.sum():
                kept |= piece
        sound = kept
    pieces = connected_pieces(mask, 1)
    if len(pieces) > 1:
        mask = np.any([piece for piece in pieces if (piece & sound).sum() >= CONFIG.smallest] or pieces[:1], axis=0)
    return np.asarray(cv2.medianBlur(mask.astype(np.uint8), 3), np.bool_), sound


def _depth_of_upright_walls(
    rays: Array,
    top: float,
    edge: Depth,
    measured: Depth,
    camera: tuple[tuple[float, float], tuple[float, float], Array],
) -> Array:
    """(N,) depth at which rays (N, 3), of depth 1 in the object frame, meet an upright wall on the object's foot, m;
    infinite if they meet none.

    A steep wall covers few pixels, and these are flying pixels. Extrapolating its top would make the object overhang
    its foot. The foot is the support covered by the mask, or by something nearer.
    """
    found = np.full(len(rays), np.inf)
    for height in np.linspace(top, 0.0, CONFIG.wall_steps):
        depth = (height - camera[2][2, 3]) / np.minimum(rays[:, 2], -1e-3)
        foot = (camera[2][:3, 3] + depth[:, None] * rays) * (1, 1, 0)
        column, row, foot_depth = project_points(foot, *camera)
        nearest = sample(measured, column, row, cv2.INTER_NEAREST, 0.0)
        covered = (nearest > 0) & (nearest < foot_depth - CONFIG.nearer)
        covered |= sample(edge, column, row, cv2.INTER_LINEAR, 50.0) <= CONFIG.foot_edge
        found = np.where(covered, np.minimum(found, depth), found)
    return found


def _surface_normals(surface: Array, eye: Array, reach: int, jump: float) -> tuple[Array, Depth, Mask]:
    """Of a surface (h, w, 3): normals towards the camera by central differences over ``reach`` pixels, their cosine
    with the ray, and the mask of pixels without a depth jump nearby."""
    across, down = np.zeros_like(surface), np.zeros_like(surface)
    across[:, reach:-reach] = surface[:, 2 * reach :] - surface[:, : -2 * reach]
    down[reach:-reach] = surface[2 * reach :] - surface[: -2 * reach]
    normals = np.cross(down, across)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True) + 1e-12
    rays = surface - eye
    cosine = (normals * rays).sum(axis=-1) / np.linalg.norm(rays, axis=-1)
    slope = np.asarray(cv2.blur(np.abs(cosine).astype(np.float32), (3, 3)), np.float32)
    even = (np.linalg.norm(across, axis=-1) < reach * jump) & (np.linalg.norm(down, axis=-1) < reach * jump)
    return normals * -np.sign(cosine)[..., None], np.clip(slope, 0.2, 1).astype(np.float32), np.asarray(even)


def signed_edge_distance(mask: Mask) -> Depth:
    """(h, w) signed distance to a mask's edge, pixels, negative inside; smoothed to hide the pixel grid."""
    outside = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    inside = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
    return np.asarray(cv2.GaussianBlur(outside - inside, (0, 0), 1.2), np.float32)


def fill_from_nearest(picture: npt.NDArray[Value], known: Mask) -> npt.NDArray[Value]:
    """A picture (h, w) or (h, w, D) with each unknown pixel replaced by the nearest ``known`` pixel."""
    missing = (~known).astype(np.uint8)
    nearest = cv2.distanceTransformWithLabels(missing, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)[1]
    labels = np.asarray(nearest, np.int64)
    owners = np.zeros((int(labels.max()) + 1, *picture.shape[2:]), picture.dtype)
    owners[labels[known]] = picture[known]
    return owners[labels]


def connected_pieces(mask: Mask, smallest: int) -> list[Mask]:
    """The 8-connected components of a mask of at least ``smallest`` pixels."""
    count, labels, figures, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    return [np.asarray(labels == number) for number in range(1, count) if figures[number, cv2.CC_STAT_AREA] >= smallest]


def dilate(mask: Mask, side: int) -> Mask:
    """The mask dilated by a square of ``side`` pixels."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)), np.bool_)
