"""The photo laid on a mesh without a seam."""

import cv2
import numpy as np

from grs_agents.library.mesh_files import encode_png
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.drawing import draw_depth
from grs_agents.perception.shapes.observation import (
    Observation,
    connected_pieces,
    fill_from_nearest,
    sample,
    signed_edge_distance,
)
from grs_agents.perception.shapes.surface_nets import Faces, edges_of_mesh
from grs_agents.perception.shapes.types import TexturedMesh
from grs_agents.perception.types import Array, Image, Mask

CONFIG = DEFAULT.texture


def paint_mesh(seen: Observation, vertices: Array, faces: Faces) -> TexturedMesh:
    """A vertex that the camera sees has the colour of its pixel. The place in the photo of one that it does not see is
    the mean of its neighbours' places: the back looks like the front, and no edge shows where one becomes the other."""
    column, row, _ = seen.project(vertices)
    places = np.stack([column, row], axis=1)
    shown = _visible_vertices(seen, vertices, faces)
    if shown.any():
        places = _extend_texture_coordinates(places, shown, _creased_vertices(vertices, faces), faces)
    picture, (left, top) = _crop_photo_around_object(seen)
    height, width = picture.shape[:2]
    uvs = np.stack([(places[:, 0] - left + 0.5) / width, 1 - (places[:, 1] - top + 0.5) / height], axis=1)
    return TexturedMesh(vertices, faces, np.clip(uvs, 0, 1), _shrink_to_file_size(picture))


def _visible_vertices(seen: Observation, vertices: Array, faces: Faces) -> Mask:
    """(V,) which vertices the camera sees, not too flatly, where the photo shows the object."""
    drawn = draw_depth(seen, vertices, faces).astype(np.float32)
    column, row, depth = seen.project(vertices)
    nearest = np.asarray(cv2.dilate(np.where(drawn > 0, drawn, 0), np.ones((3, 3))), np.float32)
    visible = depth < sample(nearest, column, row, cv2.INTER_NEAREST, 0.0) + CONFIG.hidden
    normals = np.zeros_like(vertices)
    corners = vertices[faces]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for corner in range(3):
        np.add.at(normals, faces[:, corner], crosses)
    rays = vertices - seen.eye
    cosine = -(normals * rays).sum(axis=1) / (np.linalg.norm(normals, axis=1) * np.linalg.norm(rays, axis=1) + 1e-12)
    inside = sample(seen.edge, column, row, cv2.INTER_LINEAR, 9.0) < CONFIG.beside
    return visible & inside & (cosine > CONFIG.flat)


def _creased_vertices(vertices: Array, faces: Faces) -> Mask:
    """(V,) which vertices have faces that look in very different directions."""
    corners = vertices[faces]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = crosses / np.maximum(np.linalg.norm(crosses, axis=1, keepdims=True), 1e-15)
    mean = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(mean, faces[:, corner], normals)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-15)
    least = np.ones(len(vertices))
    for corner in range(3):
        np.minimum.at(least, faces[:, corner], (normals * mean[faces[:, corner]]).sum(axis=1))
    return np.asarray(least < CONFIG.crease)


def _extend_texture_coordinates(places: Array, shown: Mask, creased: Mask, faces: Faces) -> Array:
    """(V, 2) places of all vertices, from those of the vertices that are ``shown``: a harmonic function on the mesh,
    within its smooth parts rather than over its creases. Found by conjugate gradients."""
    hidden = ~shown
    edges = edges_of_mesh(faces)
    one, two = np.concatenate([edges, edges[:, ::-1]]).T
    weight = np.where(creased[one] | creased[two], CONFIG.across_crease, 1.0)
    count = np.bincount(one, weights=weight, minlength=len(places))[:, None] + 1e-6

    def apply_mesh_laplacian(values: Array) -> Array:
        sums = [np.bincount(one, weights=weight * values[two, axis], minlength=len(values)) for axis in range(2)]
        return np.where(hidden[:, None], count * values - np.stack(sums, axis=1), 0.0)

    found = np.where(hidden[:, None], places[shown].mean(axis=0), places)
    left = -apply_mesh_laplacian(found)
    step = left / count
    for _ in range(CONFIG.rounds):
        product = apply_mesh_laplacian(step)
        ahead = (left * left / count).sum(axis=0)
        share = ahead / np.maximum((step * product).sum(axis=0), 1e-12)
        found += share * step
        left -= share * product
        if np.abs(left).max() < CONFIG.settled:
            break
        step = left / count + (left * left / count).sum(axis=0) / np.maximum(ahead, 1e-12) * step
    return found


def _crop_photo_around_object(seen: Observation) -> tuple[Image, tuple[int, int]]:
    """The photo around the object, what is not well inside its mask filled with what is, and its first column, row."""
    inner = seen.edge < -CONFIG.inset
    if inner.sum() < CONFIG.fewest:
        inner = seen.mask
    support = _support_in_mask(seen)
    if support.any():
        pieces = connected_pieces(inner & (signed_edge_distance(~support) < -1), CONFIG.fewest)
        inner = np.any([piece for piece in pieces if piece.sum() > CONFIG.island * inner.sum()] or [inner], axis=0)
    filled = np.asarray(fill_from_nearest(seen.rgb, inner), np.uint8)
    left, top, width, height = cv2.boundingRect(seen.mask.astype(np.uint8))
    left, top = max(left - 2, 0), max(top - 2, 0)
    return filled[top : top + height + 4, left : left + width + 4], (left, top)


def _support_in_mask(seen: Observation) -> Mask:
    """(h, w) the mask's pixels that show what the object stands on, where depth reached beyond the object: they have
    its colour and are in one piece with the mask's edge. None where the object itself has that colour."""
    nothing = np.zeros_like(seen.mask)
    off = np.abs(seen.lift(seen.measured)[..., 2])
    support = ~seen.mask & (seen.measured > 0) & (off < max(CONFIG.level, 2 * seen.noise))
    if support.sum() < CONFIG.fewest:
        return nothing
    colors = cv2.cvtColor(cv2.medianBlur(seen.rgb, 3).astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    around = (CONFIG.around, CONFIG.around)
    weight = np.maximum(cv2.blur(support.astype(np.float32), around), 1e-6)
    means = cv2.blur(colors * support[..., None], around) / weight[..., None]
    differences = (colors - fill_from_nearest(means, support)) * (0.5, 1.0, 1.0)
    alike = seen.mask & (np.linalg.norm(differences, axis=-1) < CONFIG.alike)
    middle, edge = seen.mask & (seen.edge < seen.edge.min() / 2), seen.mask & (seen.edge > -CONFIG.inset)
    pieces = np.asarray(cv2.connectedComponents(alike.astype(np.uint8), connectivity=4)[1], np.int32)
    found = alike & np.isin(pieces, pieces[edge & alike])
    least, most = CONFIG.bled
    bled = alike[edge].mean() > least and found.sum() < most * seen.mask.sum()
    return found if bled and alike[middle].mean() < CONFIG.own else nothing


def _shrink_to_file_size(picture: Image) -> Image:
    """The picture, made smaller if its file would be too large."""
    size = len(encode_png(picture))
    if size <= CONFIG.most_bytes:
        return picture
    scale = float(np.sqrt(CONFIG.most_bytes / size)) * 0.95
    return np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
