"""Texture of a mesh from the photo, without a seam."""

from importlib import import_module
from typing import Any

import cv2
import numpy as np

from grs_agents.library.mesh_files import encode_png
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.object_crop import (
    ObjectCrop,
    connected_pieces,
    fill_from_nearest,
    sample,
    signed_edge_distance,
)
from grs_agents.perception.shapes.surface_nets import Faces, edges_of_mesh
from grs_agents.perception.shapes.types import ObjectMesh
from grs_agents.perception.types import Array, Mask

CONFIG = DEFAULT.texture


def paint_mesh(crop: ObjectCrop, vertices: Array, faces: Faces) -> ObjectMesh:
    """Texture a mesh with the photo. Visible vertices take their own pixel; texture coordinates of the others are
    interpolated over the mesh, so the back repeats the front without a seam."""
    column, row, _ = crop.project(vertices)
    places = np.stack([column, row], axis=1)
    shown = _visible_vertices(crop, vertices, faces)
    if shown.any() and not shown.all():
        places = _extend_texture_coordinates(places, shown, _creased_vertices(vertices, faces), faces)
    # The photo around the object, inpainted from the inside of its mask without support.
    inner = crop.edge < -CONFIG.inset
    if inner.sum() < CONFIG.fewest:
        inner = crop.mask
    support = _support_in_mask(crop)
    if support.any():
        pieces = connected_pieces(inner & (signed_edge_distance(~support) < -1), CONFIG.fewest)
        inner = np.any([piece for piece in pieces if piece.sum() > CONFIG.island * inner.sum()] or [inner], axis=0)
    left, top, width, height = cv2.boundingRect(crop.mask.astype(np.uint8))
    left, top = max(left - 2, 0), max(top - 2, 0)
    picture = np.asarray(fill_from_nearest(crop.rgb, inner), np.uint8)
    picture = picture[top : top + height + 4, left : left + width + 4]
    height, width = picture.shape[:2]
    uvs = np.stack([(places[:, 0] - left + 0.5) / width, 1 - (places[:, 1] - top + 0.5) / height], axis=1)
    size = len(encode_png(picture))
    if size > CONFIG.most_bytes:
        scale = float(np.sqrt(CONFIG.most_bytes / size)) * 0.95
        picture = np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
    return ObjectMesh(vertices, faces, np.clip(uvs, 0, 1), picture)


def _visible_vertices(crop: ObjectCrop, vertices: Array, faces: Faces) -> Mask:
    """(V,) vertices inside the mask that the camera sees at no grazing angle."""
    drawn = crop.render_depth(vertices, faces).astype(np.float32)
    column, row, depth = crop.project(vertices)
    nearest = np.asarray(cv2.dilate(np.where(drawn > 0, drawn, 0), np.ones((3, 3))), np.float32)
    visible = depth < sample(nearest, column, row, cv2.INTER_NEAREST, 0.0) + CONFIG.hidden
    normals = np.zeros_like(vertices)
    corners = vertices[faces]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for corner in range(3):
        np.add.at(normals, faces[:, corner], crosses)
    rays = vertices - crop.eye
    cosine = -(normals * rays).sum(axis=1) / (np.linalg.norm(normals, axis=1) * np.linalg.norm(rays, axis=1) + 1e-12)
    inside = sample(crop.edge, column, row, cv2.INTER_LINEAR, 9.0) < CONFIG.beside
    return visible & inside & (cosine > CONFIG.flat)


def _creased_vertices(vertices: Array, faces: Faces) -> Mask:
    """(V,) vertices on a crease, by the angles of their faces with the mean normal."""
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
    """(V, 2) texture coordinates of all vertices, from those of the ``shown`` vertices: the harmonic function on the
    mesh, with low weights across creases."""
    sparse: Any = import_module("scipy.sparse")
    starts, ends = edges_of_mesh(faces).T
    weight = np.where(creased[starts] | creased[ends], CONFIG.across_crease, 1.0)
    links = sparse.coo_array((weight, (starts, ends)), (len(places), len(places)))
    graph_laplacian: Any = import_module("scipy.sparse.csgraph").laplacian(links + links.T)
    regular = (graph_laplacian + 1e-6 * sparse.eye_array(len(places))).tocsr()[~shown]
    middle = places[shown].mean(axis=0)  # that of pieces without a shown vertex
    from_shown = regular[:, shown] @ (middle - places[shown])
    extended = places.copy()
    extended[~shown] = import_module("scipy.sparse.linalg").spsolve(regular[:, ~shown].tocsc(), from_shown) + middle
    return extended


def _support_in_mask(crop: ObjectCrop) -> Mask:
    """(h, w) support that bled into the mask: pixels of its colour that are connected with the mask's edge; none if
    the middle of the object has that colour too."""
    nothing = np.zeros_like(crop.mask)
    off = np.abs(crop.lift(crop.measured)[..., 2])
    support = ~crop.mask & (crop.measured > 0) & (off < max(CONFIG.level, 2 * crop.noise))
    if support.sum() < CONFIG.fewest:
        return nothing
    colors = cv2.cvtColor(cv2.medianBlur(crop.rgb, 3).astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    around = (CONFIG.around, CONFIG.around)
    weight = np.maximum(cv2.blur(support.astype(np.float32), around), 1e-6)
    means = cv2.blur(colors * support[..., None], around) / weight[..., None]
    differences = (colors - fill_from_nearest(means, support)) * (0.5, 1.0, 1.0)
    alike = crop.mask & (np.linalg.norm(differences, axis=-1) < CONFIG.alike)
    middle, edge = crop.mask & (crop.edge < crop.edge.min() / 2), crop.mask & (crop.edge > -CONFIG.inset)
    pieces = np.asarray(cv2.connectedComponents(alike.astype(np.uint8), connectivity=4)[1], np.int32)
    found = alike & np.isin(pieces, pieces[edge & alike])
    least, most = CONFIG.bled
    bled = alike[edge].mean() > least and found.sum() < most * crop.mask.sum()
    return found if bled and alike[middle].mean() < CONFIG.own else nothing
