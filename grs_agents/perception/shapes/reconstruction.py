"""The shape of an object from one view: a box, round, open at the top, mirrored or carved, whichever the view agrees
with."""

import numpy as np

from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.drawing import Agreement, compare_mesh_with_photo
from grs_agents.perception.shapes.handle import mesh_visible_handle
from grs_agents.perception.shapes.lathe import TurnedSolid, measure_turned_profile, mesh_turned_solid
from grs_agents.perception.shapes.mirrors import find_symmetry_planes
from grs_agents.perception.shapes.observation import Observation, observe_object
from grs_agents.perception.shapes.open_top import fit_open_top
from grs_agents.perception.shapes.revolution import Axis, fit_revolution_axis
from grs_agents.perception.shapes.solid import carve_solid
from grs_agents.perception.shapes.surface_nets import Faces
from grs_agents.perception.shapes.texture import paint_mesh
from grs_agents.perception.shapes.types import ObjectShape, ObjectView
from grs_agents.perception.shapes.view_fit import cost_of_mesh, fit_box, fit_turned_solid
from grs_agents.perception.types import Array

CONFIG = DEFAULT.choice


def reconstruct_shape(view: ObjectView) -> ObjectShape | None:
    """The closed, textured mesh of what a view shows of an object, at most 2,000 faces.

    ``None`` where too little depth was measured to tell of a shape.
    """
    seen = observe_object(view)
    if seen is None:
        return None
    turned = _reconstruct_turned_solid(seen)
    open_top = _reconstruct_open_top(seen, view.size) if view.hollow else None
    hollow = [one for one in (turned, open_top) if one is not None and one.hollow]
    box = fit_box(seen, view.size)
    if hollow:
        best = min(hollow, key=lambda one: _cost_of_shape(seen, one))
        if _cost_of_shape(seen, best) < cost_of_mesh(seen, *box):
            return best
    return _reconstruct_solid(seen, turned, box)


def _reconstruct_solid(seen: Observation, turned: ObjectShape | None, mesh: tuple[Array, Faces]) -> ObjectShape | None:
    """The box that was fitted, if it looks like the object or no turned or carved solid agrees better with the view."""
    found = compare_mesh_with_photo(seen, *mesh)
    if not _is_box_confirmed(found, seen):
        other = turned or _reconstruct_by_carving(seen)
        if other is None or _cost_of_shape(seen, other) < cost_of_mesh(seen, *mesh):
            return other
    return ObjectShape(paint_mesh(seen, *mesh), "box", False, None, found.overlap, found.raw_error)


def _cost_of_shape(seen: Observation, shape: ObjectShape) -> float:
    return cost_of_mesh(seen, shape.mesh.vertices, shape.mesh.faces)


def _is_box_confirmed(found: Agreement, seen: Observation) -> bool:
    """Whether the fitted box looks like the object from the camera."""
    return found.overlap >= CONFIG.box_overlap and found.error < max(CONFIG.box_depth, CONFIG.deviations * seen.noise)


def _reconstruct_turned_solid(seen: Observation) -> ObjectShape | None:
    """A turned solid with its handle; ``None`` where the object is not round."""
    axis = fit_revolution_axis(seen)
    if axis is None or axis.share < CONFIG.round_share or axis.azimuth < CONFIG.round_azimuth:
        return None
    turned = measure_turned_profile(seen, axis)
    if turned is None:
        return None
    turned = fit_turned_solid(seen, turned)
    vertices, faces = _with_handle(seen, turned)
    found = compare_mesh_with_photo(seen, vertices, faces)
    if not _is_turned_solid_confirmed(found, axis, turned.walls is not None):
        return None
    mesh = paint_mesh(seen, vertices, faces)
    return ObjectShape(mesh, "lathe", turned.walls is not None, turned.walls, found.overlap, found.raw_error)


def _reconstruct_open_top(seen: Observation, size: tuple[float, float, float]) -> ObjectShape | None:
    """A cup with its handle or an open box, whichever is nearer to the view; ``None`` where both are far from it."""
    fitted = fit_open_top(seen, size)
    walls = fitted.walls if isinstance(fitted, TurnedSolid) else None
    vertices, faces = _with_handle(seen, fitted) if isinstance(fitted, TurnedSolid) else fitted
    found = compare_mesh_with_photo(seen, vertices, faces)
    if found.overlap < DEFAULT.open_top.overlap or found.near < DEFAULT.open_top.near:
        return None
    method = "box" if walls is None else "lathe"
    return ObjectShape(paint_mesh(seen, vertices, faces), method, True, walls, found.overlap, found.raw_error)


def _with_handle(seen: Observation, turned: TurnedSolid) -> tuple[Array, Faces]:
    """The mesh of a turned solid and of the handle that is seen of it."""
    vertices, faces = mesh_turned_solid(turned, CONFIG.faces - CONFIG.handle_faces)
    handle = mesh_visible_handle(seen, turned, CONFIG.handle_faces)
    if handle is None:
        return vertices, faces
    return np.concatenate([vertices, handle[0]]), np.concatenate([faces, handle[1] + len(vertices)])


def _is_turned_solid_confirmed(found: Agreement, axis: Axis, hollow: bool) -> bool:
    """Whether a turned solid agrees well enough with the view."""
    surely = axis.azimuth >= CONFIG.surely_round
    if hollow and surely and axis.share >= CONFIG.hollow_share:
        return found.near >= CONFIG.hollow_explained and found.overlap >= CONFIG.hollow_overlap
    closely = surely or found.close >= CONFIG.explained_well
    return closely and found.near >= CONFIG.explained and found.overlap >= CONFIG.round_overlap


def _reconstruct_by_carving(seen: Observation) -> ObjectShape | None:
    mirrors = find_symmetry_planes(seen)
    mesh = carve_solid(seen, mirrors, CONFIG.faces)
    if mesh is None:
        return None
    found = compare_mesh_with_photo(seen, *mesh)
    method = "mirror" if mirrors else "voxels"
    return ObjectShape(paint_mesh(seen, *mesh), method, False, None, found.overlap, found.raw_error)
