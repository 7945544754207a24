"""Handles of round things: what of the mask lies beside the turned body, as a rounded strip in an upright plane."""

import cv2
import numpy as np

from grs_agents.perception.shapes import surface_nets
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.drawing import draw_depth
from grs_agents.perception.shapes.lathe import TurnedSolid, mesh_turned_solid
from grs_agents.perception.shapes.mesh_simplification import simplify_closed_mesh
from grs_agents.perception.shapes.observation import (
    Observation,
    connected_pieces,
    dilate,
    sample,
    signed_edge_distance,
)
from grs_agents.perception.shapes.surface_nets import Faces
from grs_agents.perception.types import Array, Mask

CONFIG = DEFAULT.handle


def mesh_visible_handle(seen: Observation, turned: TurnedSolid, most_faces: int) -> tuple[Array, Faces] | None:
    """The closed mesh of the handle; ``None`` where none is seen, or only edge on."""
    if turned.top < CONFIG.slender * 2 * float(turned.outer[:, 1].max()):
        return None
    piece = _find_largest_mask_piece_beside_body(seen, turned)
    if piece is None:
        return None
    azimuth = _handle_azimuth(seen, turned, piece)
    if azimuth is None:
        return None
    strip = dilate(piece, 7) & seen.mask
    return _mesh_handle_strip(seen, turned, strip, azimuth, most_faces)


def _find_largest_mask_piece_beside_body(seen: Observation, turned: TurnedSolid) -> Mask | None:
    """The largest piece of the mask beside the body, if it reaches far enough out."""
    body = dilate(draw_depth(seen, *mesh_turned_solid(turned, 800)) > 0, 5)
    pieces = connected_pieces(seen.mask & ~body, CONFIG.fewest)
    if not pieces:
        return None
    largest = max(pieces, key=np.count_nonzero)
    reach = cv2.distanceTransform((~body).astype(np.uint8), cv2.DIST_L2, 5)[largest].max()
    size = reach * float(np.median(seen.depth[largest])) / seen.focal[0]
    return largest if size > CONFIG.reach else None


def _handle_azimuth(seen: Observation, turned: TurnedSolid, piece: Mask) -> float | None:
    """Where around the axis the handle is, rad: from its depth if that was measured, else square to the view."""
    eye = seen.eye[:2] - (turned.axis.x, turned.axis.y)
    toward = float(np.arctan2(eye[1], eye[0]))
    column = float(np.nonzero(piece)[1].mean())
    middle = seen.project(np.array([[turned.axis.x, turned.axis.y, turned.top / 2]]))[0][0]
    square = toward + (
        np.pi / 2 if column > middle else -np.pi / 2
    )  # the photo's right is to the left of who looks back
    points = seen.lift(seen.depth)[piece & (seen.measured > 0)] - (turned.axis.x, turned.axis.y, 0.0)
    radius = np.linalg.norm(points[:, :2], axis=1)
    far = points[radius > turned.outer_radius(points[:, 2]) + 0.5 * CONFIG.reach]
    if len(far) < CONFIG.fewest:
        return square
    found = float(np.arctan2(far[:, 1].sum(), far[:, 0].sum()))
    off = float(np.angle(np.exp(1j * (found - square))))
    return found if abs(off) < CONFIG.square else None


def _mesh_handle_strip(
    seen: Observation, turned: TurnedSolid, strip: Mask, azimuth: float, most_faces: int
) -> tuple[Array, Faces] | None:
    """The strip of the mask, seen in the upright plane through the axis, with rounded edges."""
    out = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    side = np.array([-out[1], out[0], 0.0])
    base = np.array([turned.axis.x, turned.axis.y, 0.0])
    widest = float(turned.outer[:, 1].max()) + CONFIG.longest
    step = CONFIG.step
    radii, heights = (
        np.arange(0.5 * float(turned.outer[:, 1].min()), widest, step),
        np.arange(-2 * step, turned.top + 4 * step, step),
    )
    plane = radii[:, None, None] * out + heights[None, :, None] * np.array([0.0, 0.0, 1.0]) + base
    column, row, _ = seen.project(plane.reshape(-1, 3))
    inside = sample(signed_edge_distance(strip), column, row, cv2.INTER_LINEAR, 50.0).reshape(plane.shape[:2]) < 0
    inside &= radii[:, None] > turned.outer_radius(heights) - CONFIG.sunk
    pieces = connected_pieces(np.asarray(inside), CONFIG.fewest)
    if not pieces:
        return None
    inside = max(pieces, key=np.count_nonzero)
    within = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, 5) * step
    beyond = cv2.distanceTransform((~inside).astype(np.uint8), cv2.DIST_L2, 5) * step
    half = float(np.clip(np.percentile(within[inside], 85), *CONFIG.half_thickness))
    across = np.arange(-half - 2 * step, half + 2.5 * step, step)
    edge = np.maximum(beyond - within + half, 0)
    values = np.hypot(edge[:, None, :], across[None, :, None]) - half
    vertices, faces = surface_nets.mesh_zero_level(surface_nets.smooth_grid(values), np.zeros(3), 1.0)
    vertices, faces = surface_nets.keep_large_pieces(vertices, faces, 0.2)
    vertices = surface_nets.smooth_mesh(vertices, faces, CONFIG.smoothing) * step
    vertices, faces = simplify_closed_mesh(vertices, faces, most_faces)
    local = vertices + np.array([radii[0], across[0], heights[0]])  # radius, across, height: a right-handed frame
    return base + local[:, :1] * out + local[:, 1:2] * side + local[:, 2:] * (0.0, 0.0, 1.0), faces
