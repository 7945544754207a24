"""Shape of an object from a single view: box, round, open at the top, mirrored or carved, by best agreement."""

import numpy as np

from grs_agents.perception.shapes.carving import carve_solid, find_symmetry_planes
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.lathe import (
    TurnedSolid,
    fit_revolution_axis,
    measure_turned_profile,
    mesh_turned_solid,
    mesh_visible_handle,
)
from grs_agents.perception.shapes.object_crop import ObjectCrop, crop_object
from grs_agents.perception.shapes.surface_nets import Faces
from grs_agents.perception.shapes.texture import paint_mesh
from grs_agents.perception.shapes.types import ObjectShape, ObjectView
from grs_agents.perception.shapes.view_fit import (
    compare_mesh_with_photo,
    cost_of_mesh,
    fit_box,
    fit_open_top,
    fit_turned_solid,
)
from grs_agents.perception.types import Array

CONFIG = DEFAULT.choice


def reconstruct_shape(view: ObjectView) -> ObjectShape | None:
    """The closed, textured mesh of an object, at most 2,000 faces; ``None`` with too little measured depth."""
    crop = crop_object(view)
    if crop is None:
        return None

    def cost(shape: ObjectShape) -> float:
        return cost_of_mesh(crop, shape.mesh.vertices, shape.mesh.faces)

    turned = _reconstruct_turned_solid(crop)
    open_top = _reconstruct_open_top(crop, view.size) if view.hollow else None
    hollow = [shape for shape in (turned, open_top) if shape is not None and shape.hollow]
    box = fit_box(crop, view.size)
    if hollow:
        best = min(hollow, key=cost)
        if cost(best) < cost_of_mesh(crop, *box):
            return best
    agreement = compare_mesh_with_photo(crop, *box)
    depth_tolerance = max(CONFIG.box_depth, CONFIG.deviations * crop.noise)
    if agreement.overlap < CONFIG.box_overlap or agreement.error >= depth_tolerance:  # it does not look like a box
        shape = turned
        mirrors = [] if turned else find_symmetry_planes(crop)
        carved = None if turned else carve_solid(crop, mirrors, CONFIG.faces)
        if carved is not None:
            found, method = compare_mesh_with_photo(crop, *carved), "mirror" if mirrors else "voxels"
            shape = ObjectShape(paint_mesh(crop, *carved), method, False, None, found.overlap, found.raw_error)
        if shape is None or cost(shape) < cost_of_mesh(crop, *box):
            return shape
    return ObjectShape(paint_mesh(crop, *box), "box", False, None, agreement.overlap, agreement.raw_error)


def _reconstruct_turned_solid(crop: ObjectCrop) -> ObjectShape | None:
    """A solid of revolution with its handle; ``None`` if the object is not round."""
    axis = fit_revolution_axis(crop)
    if axis is None or axis.share < CONFIG.round_share or axis.azimuth < CONFIG.round_azimuth:
        return None
    turned = measure_turned_profile(crop, axis)
    if turned is None:
        return None
    turned = fit_turned_solid(crop, turned)
    vertices, faces = _mesh_with_handle(crop, turned)
    agreement = compare_mesh_with_photo(crop, vertices, faces)
    surely_round = axis.azimuth >= CONFIG.surely_round
    if turned.walls is not None and surely_round and axis.share >= CONFIG.hollow_share:
        confirmed = agreement.near >= CONFIG.hollow_explained and agreement.overlap >= CONFIG.hollow_overlap
    else:
        confirmed = surely_round or agreement.close >= CONFIG.explained_well
        confirmed &= agreement.near >= CONFIG.explained and agreement.overlap >= CONFIG.round_overlap
    if not confirmed:
        return None
    mesh = paint_mesh(crop, vertices, faces)
    return ObjectShape(mesh, "lathe", turned.walls is not None, turned.walls, agreement.overlap, agreement.raw_error)


def _reconstruct_open_top(crop: ObjectCrop, size: tuple[float, float, float]) -> ObjectShape | None:
    """A cup with its handle or an open box, whichever is nearer to the view; ``None`` if both are far from it."""
    fitted = fit_open_top(crop, size)
    walls = fitted.walls if isinstance(fitted, TurnedSolid) else None
    vertices, faces = _mesh_with_handle(crop, fitted) if isinstance(fitted, TurnedSolid) else fitted
    agreement = compare_mesh_with_photo(crop, vertices, faces)
    if agreement.overlap < DEFAULT.open_top.overlap or agreement.near < DEFAULT.open_top.near:
        return None
    method = "box" if walls is None else "lathe"
    return ObjectShape(paint_mesh(crop, vertices, faces), method, True, walls, agreement.overlap, agreement.raw_error)


def _mesh_with_handle(crop: ObjectCrop, turned: TurnedSolid) -> tuple[Array, Faces]:
    """The mesh of a solid of revolution and of its visible handle."""
    vertices, faces = mesh_turned_solid(turned, CONFIG.faces - CONFIG.handle_faces)
    handle = mesh_visible_handle(crop, turned, CONFIG.handle_faces)
    if handle is None:
        return vertices, faces
    return np.concatenate([vertices, handle[0]]), np.concatenate([faces, handle[1] + len(vertices)])
