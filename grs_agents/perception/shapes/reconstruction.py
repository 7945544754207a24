"""The shape of an object from one view: a box, round, mirrored or carved, whichever the view agrees with."""

import numpy as np

from grs_agents.perception.shapes.box_fit import mesh_fitted_box
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.drawing import Agreement, compare_mesh_with_photo
from grs_agents.perception.shapes.handle import mesh_visible_handle
from grs_agents.perception.shapes.lathe import measure_turned_profile, mesh_turned_solid
from grs_agents.perception.shapes.mirrors import find_symmetry_planes
from grs_agents.perception.shapes.observation import Observation, observe_object
from grs_agents.perception.shapes.revolution import Axis, fit_revolution_axis
from grs_agents.perception.shapes.solid import carve_solid
from grs_agents.perception.shapes.texture import paint_mesh
from grs_agents.perception.shapes.types import ObjectShape, ObjectView

CONFIG = DEFAULT.choice


def reconstruct_shape(view: ObjectView) -> ObjectShape | None:
    """The closed, textured mesh of what a view shows of an object, at most 2,000 faces.

    ``None`` where too little depth was measured to tell of a shape.
    """
    seen = observe_object(view)
    if seen is None or seen.measured_share < CONFIG.least_measured:
        return None
    turned = _reconstruct_turned_solid(seen)
    if turned is not None and turned.hollow:  # a mug's outline may be near to a box, but one can put things into it
        return turned
    mesh = mesh_fitted_box(seen, view.size)
    box = compare_mesh_with_photo(seen, *mesh)
    if _is_box_confirmed(box, seen):
        return ObjectShape(paint_mesh(seen, *mesh), "box", False, None, box.overlap, box.raw_error)
    return turned or _reconstruct_by_carving(seen)


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
    vertices, faces = mesh_turned_solid(turned, CONFIG.faces - CONFIG.handle_faces)
    handle = mesh_visible_handle(seen, turned, CONFIG.handle_faces)
    if handle is not None:
        faces = np.concatenate([faces, handle[1] + len(vertices)])
        vertices = np.concatenate([vertices, handle[0]])
    found = compare_mesh_with_photo(seen, vertices, faces)
    if not _is_turned_solid_confirmed(found, axis, turned.walls is not None):
        return None
    mesh = paint_mesh(seen, vertices, faces)
    return ObjectShape(mesh, "lathe", turned.walls is not None, turned.walls, found.overlap, found.raw_error)


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
