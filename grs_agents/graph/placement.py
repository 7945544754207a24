"""From matched segments to objects at rest: registration, proxies, collisions, settling in MuJoCo.

An asset that disagrees with the measured size or place is scaled to it if the object's look names it, or gives way to a
proxy of that size.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from grs_agents.base import Quat
from grs_agents.base.errors import GrsError
from grs_agents.graph.services import Photo, Services
from grs_agents.graph.state import TableObject
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.matching.confidence import confidence_of_fitting_asset
from grs_agents.perception.matching.types import BY_FEATURES
from grs_agents.perception.proxies.proxy import Proxy, primitive_proxy, write_proxy, write_scaled_asset
from grs_agents.perception.registration.registration import Registered, register_asset
from grs_agents.perception.registration.size_check import (
    deviation_from_measured_box,
    enclosing_aabb,
    is_match_certain,
)
from grs_agents.perception.segmentation.candidates import explain_doubt, fit_asset_to_box
from grs_agents.perception.settling.collision_repair import repair_collisions
from grs_agents.perception.settling.proxy_placement import (
    PlacedProxy,
    extend_box_to_support,
    place_with_cleared_colliders,
    settle_with_stable_colliders,
)
from grs_agents.perception.settling.segment_reconciliation import reconcile_segments
from grs_agents.perception.settling.settling import PlacedObject, RestPose
from grs_agents.perception.settling.support_relations import body_from_asset, find_spatial_relations
from grs_agents.perception.shapes.mesh_file import MeshFile, fit_mesh_file
from grs_agents.perception.shapes.types import make_object_view
from grs_agents.perception.types import (
    CandidateRecord,
    DroppedCandidate,
    Mask,
    MatchEvidence,
    SceneObject,
    Solid,
    SpatialRelation,
    TwinReport,
    UprightBox,
    is_reachable_position,
)
from grs_agents.sim.instance.episode import SimulationError

LEAST_DEPTH_NOISE = 0.0005  # m; no depth camera is more precise


def explain_why_no_scene_object(item: TableObject, proxies: bool = True) -> str:
    """Reason why a described and matched segment is no object of the scene; empty if it is.

    Without ``proxies`` an object needs an asset.
    """
    if item.given and proxies:
        return ""
    if item.match is None:
        return f"described as no object: {item.described.description}"
    if item.match.match == "no_object":
        return f"matched as no object: {item.match.reason}"
    if item.match.match == "no_asset" and not proxies:
        return f"no asset matches it, and match.proxies is off: {item.match.reason}"
    return ""


def explain_rejected_objects(
    objects: Sequence[TableObject], first: bool, services: Services
) -> tuple[dict[int, str], list[str]]:
    """Reasons why described and matched segments are no objects of the scene, by number; empty for objects.

    Words of models that leave a photo no object at all do not count, as in `regroup_segments`.

    Args:
        objects: the segments.
        first: no object is placed yet.
        services: the services of the run.

    Returns:
        The reasons, and notes for a reader of the scene.
    """
    proxies, seen = services.config.match.proxies, services.agents.sees_pictures("describe")
    reasons = {item.id: explain_why_no_scene_object(item, proxies) for item in objects}
    said = [
        item.id
        for item in objects
        if (seen if item.match is None else item.match.match == "no_object" and item.match.method != BY_FEATURES)
    ]
    if not first or not proxies or not said or not all(reasons.values()):
        return reasons, []
    note = f"models take none of {len(objects)} segments for an object: {', '.join(map(str, said))} stay, as measured"
    return reasons | dict.fromkeys(said, ""), [note]


def place_asset_or_proxy(item: TableObject, services: Services, taken: Sequence[str], name: str = "") -> TableObject:
    """Place the matched asset, or a primitive proxy of the measured size, in the measured box.

    Settling replaces the primitive by a reconstructed shape (`reconstruct_proxy`). A proxy is called ``name``, or else
    by its colour and category.
    """
    words, match = item.described, item.match
    if match is not None and match.match == "asset" and match.asset is not None:
        asset = services.library.asset(match.asset)
        position, orientation, size = fit_asset_to_box(item.upright, asset.size)
        name = unique_object_name(asset.kind, taken)
    else:
        name = name or unique_object_name(f"{words.color} {words.category}", taken)
        proxy = primitive_proxy(item.shape, item.upright.size, item.color, item.hollow)
        asset = write_proxy(services.folder / "assets", name, proxy, words.description)
        position, orientation, size = item.upright.center, yaw_quaternion(item.upright.yaw), asset.size
    placed = SceneObject(
        id=item.id,
        name=name,
        asset=asset.name,
        matched=asset.category != "proxy",
        description=words.description,
        category=words.category,
        color=words.color,
        box=item.box,
        upright=item.upright,
        position=position,
        orientation=orientation,
        size=size,
        reachable=is_reachable_position(position),
        evidence=match.reason if match else "",
        match=match,
        mask=item.mask,
        crop=item.crop,
        method="box" if asset.category != "proxy" else "proxy",
    )
    return item.model_copy(update={"placed": placed})


def unique_object_name(words: str, taken: Sequence[str]) -> str:
    """``words`` as a slug with the first number that makes it unique in the scene."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", words)
    slug = re.sub(r"[^a-z0-9]+", "_", spaced.lower()).strip("_")[:40] or "object"
    number = 1
    while f"{slug}_{number}" in taken:
        number += 1
    return f"{slug}_{number}"


def yaw_quaternion(yaw: float) -> Quat:
    """A rotation (xyzw) by a yaw, rad."""
    return (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


def register_objects(
    objects: Sequence[TableObject], masks: Mapping[int, Mask], photo: Photo, services: Services
) -> list[TableObject]:
    """Register each matched asset to the points of its mask (H, W); proxies stay in their boxes."""
    library = services.library
    return [
        set_registered_pose(
            item, register_asset(item.scene_object.asset, library, item.upright, *photo, masks[item.id])
        )
        if item.scene_object.matched
        else item
        for item in objects
    ]


def set_registered_pose(item: TableObject, registered: Registered) -> TableObject:
    """The object at a registered pose."""
    return item.place(
        position=registered.position,
        orientation=registered.orientation,
        size=registered.size,
        method=registered.method,
        residual=registered.residual,
        round=registered.round,
        reachable=is_reachable_position(registered.position),
    )


def replace_misfit_assets(
    objects: Sequence[TableObject],
    taken: Sequence[str],
    masks: Mapping[int, Mask],
    photo: Photo,
    services: Services,
) -> tuple[list[TableObject], list[DroppedCandidate], list[str]]:
    """Replace each asset that disagrees with its measured box: by a scaled copy if its look was recognised, or a proxy.

    Returns:
        The objects, those that have neither asset nor proxy, and notes for a reader of the scene.
    """
    kept: list[TableObject] = []
    dropped: list[DroppedCandidate] = []
    notes: list[str] = []
    for item in objects:
        why = describe_size_mismatch(item, services)
        if not why:
            kept.append(item)
            continue
        placed = item.scene_object
        scaled = scale_to_measured_size(item, masks[item.id], photo, services) if _is_recognised(item) else None
        if scaled is not None:
            kept.append(scaled)
            notes.append(f"{placed.name}: {scaled.scene_object.evidence}")
            continue
        names = [*taken, *(other.scene_object.name for other in (*objects, *kept))]
        replaced = replace_by_proxy(item, why, names, services)
        if isinstance(replaced, DroppedCandidate):
            dropped.append(replaced)
            continue
        kept.append(replaced)
        if _is_recognised(item):
            notes.append(f"{placed.name}: {placed.asset} {why}: it keeps its name and is rebuilt as seen")
    return kept, dropped, notes


def _is_recognised(item: TableObject) -> bool:
    """True if the look of an object names its asset: another size does not make it another thing."""
    match = item.scene_object.match
    return match is not None and match.method != BY_FEATURES


def scale_to_measured_size(item: TableObject, mask: Mask, photo: Photo, services: Services) -> TableObject | None:
    """The object with a uniformly scaled copy of its asset, registered to the points of its ``mask`` (H, W).

    None if the ratios of the measured to the asset's extents differ, no plausible factor fits, or the copy does not
    stand where the object was measured.
    """
    placed, tolerance = item.scene_object, DEFAULT.size
    library, measured = services.library, placed.upright or item.upright
    ratios = np.divide(measured.size, fit_asset_to_box(measured, library.asset(placed.asset).size)[2])
    factor = float(np.exp(np.log(ratios).mean()))
    plausible = tolerance.smallest <= factor <= tolerance.largest
    if not plausible or (np.abs(factor / ratios - 1) > tolerance.size).any():
        return None
    scaled = write_scaled_asset(services.folder / "assets", placed.name, placed.asset, library, factor)
    registered = register_asset(scaled.name, services.library, measured, *photo, mask)
    evidence = f"{placed.evidence}; {placed.asset} is scaled by {factor:.2f} to the measured size"
    fitted = set_registered_pose(item.place(asset=scaled.name, evidence=evidence), registered)
    return None if describe_size_mismatch(fitted, services) else fitted


def raise_confidence_of_fit(item: TableObject) -> TableObject:
    """The object with the confidence of its match raised, since the registered asset fits the measurements."""
    match = item.scene_object.match
    if not item.scene_object.matched or match is None or match.confidence is None:
        return item
    sure = confidence_of_fitting_asset(match.confidence)
    return item.place(match=match.model_copy(update={"confidence": sure}))


def describe_size_mismatch(item: TableObject, services: Services) -> str:
    """Deviation of an object's asset from its measured box; empty within tolerance, or for a proxy."""
    placed = item.scene_object
    if not placed.matched or is_match_certain(placed):
        return ""
    pose = (placed.position, placed.orientation)
    deviation = deviation_from_measured_box(placed.asset, pose, services.library, placed.upright or item.upright)
    return "" if deviation.is_within_tolerance else f"is not of the measured size there: {deviation}"


def replace_by_proxy(
    item: TableObject, why: str, taken: Sequence[str], services: Services
) -> TableObject | DroppedCandidate:
    """The object with a proxy instead of its asset; dropped if the configuration forbids proxies.

    It keeps its name if the look of the object names the asset.
    """
    placed = item.scene_object
    reason = f"{placed.asset} was matched ({placed.evidence}), but {why}"
    update = {"match": "no_asset", "asset": None, "runner_up": placed.asset, "reason": reason}
    match = (placed.match or MatchEvidence(match="no_asset")).model_copy(update=update)
    name = placed.name if _is_recognised(item) else ""
    item = item.model_copy(update={"match": match})
    if reason := explain_why_no_scene_object(item, services.config.match.proxies):
        return DroppedCandidate(id=item.id, reason=reason)
    return place_asset_or_proxy(item, services, taken, name)


@dataclass(frozen=True)
class SettledScene:
    """The objects at rest, their relations, the report on the twin, and warnings for a reader of the scene."""

    objects: tuple[SceneObject, ...]
    relations: tuple[SpatialRelation, ...] = ()
    twin: TwinReport | None = None
    warnings: tuple[str, ...] = ()
    dropped: tuple[DroppedCandidate, ...] = ()  # pieces of other objects, and assets without a place
    owned: Mask | None = None  # (H, W) pixels of all objects; None without objects


def settle_scene(
    objects: Sequence[TableObject], masks: Mapping[int, Mask], photo: Photo, above: Mask, services: Services
) -> SettledScene:
    """Resolve collisions, drop pieces of other objects, reconstruct the proxies, and let all settle in MuJoCo.

    Args:
        objects: the placed objects.
        masks: the pixels (H, W) of each, by its number.
        photo: the frame and the table in it.
        above: (H, W) pixels that rise above the table; there, and at the objects, the twin is compared with the photo.
        services: the services of the run.

    Returns:
        The settled scene; it has no twin where MuJoCo rejects the scene.
    """
    if not objects:
        return SettledScene(())
    warnings: list[str] = []
    dropped: list[DroppedCandidate] = []
    try:
        objects, dropped = _resolve_collisions(objects, masks, photo, services)
    except SimulationError as error:
        warnings.append(f"objects that stand in each other stay there: {error.message}")
    known = [_asset_pose(item.scene_object) if item.scene_object.matched else None for item in objects]
    own_masks = [masks[item.id] for item in objects]
    agreed = reconcile_segments(objects, own_masks, known, *photo, services.library)
    dropped += [
        DroppedCandidate(id=objects[piece].id, reason=f"a piece of {objects[whole].scene_object.name}")
        for piece, whole in agreed.pieces.items()
    ]
    owned = np.any(own_masks, axis=0)
    scene: list[SceneObject] = []
    things: list[PlacedObject | PlacedProxy] = []
    for index, item in enumerate(objects):
        if index in agreed.pieces:
            continue
        placed, volume = item.scene_object, agreed.claims.get(index)
        if volume is None:
            things.append(_asset_pose(placed))
        else:
            measured = volume.measured_box(item.upright)
            placed = placed.model_copy(update={"box": enclosing_aabb(measured, volume.shape), "upright": measured})
            box = extend_box_to_support(volume.box)
            proxy = reconstruct_proxy(item, box, volume.shape, own_masks[index], photo, services)
            things.append(PlacedProxy(placed.name, placed.description, volume.shape, box, proxy))
        doubt = "" if item.given else explain_doubt(photo[0], own_masks[index])
        scene.append(placed.model_copy(update={"pick_trouble": doubt}))
    return replace(
        _simulate_to_rest(scene, things, photo, above | owned, warnings, services), dropped=tuple(dropped), owned=owned
    )


def _resolve_collisions(
    objects: Sequence[TableObject], masks: Mapping[int, Mask], photo: Photo, services: Services
) -> tuple[list[TableObject], list[DroppedCandidate]]:
    """Move assets that were registered into others, where the new pose still agrees with the measurements.

    An asset without such a pose gives way to a proxy, or is dropped.
    """
    matched = [index for index, item in enumerate(objects) if item.scene_object.matched]
    collisions = repair_collisions(
        [_asset_pose(objects[index].scene_object) for index in matched],
        [objects[index].upright for index in matched],
        [masks[objects[index].id] for index in matched],
        *photo,
        services.library,
    )
    resolved: dict[int, TableObject] = dict(enumerate(objects))
    dropped: list[DroppedCandidate] = []
    for index, registered in collisions.moved.items():
        item = set_registered_pose(objects[matched[index]], registered)
        if not describe_size_mismatch(item, services):
            resolved[matched[index]] = item
    for index in sorted(collisions.wrong):
        item = resolved.pop(matched[index])
        names = [other.scene_object.name for other in (*objects, *resolved.values())]
        replacement = replace_by_proxy(item, "it stands in another thing", names, services)
        if isinstance(replacement, DroppedCandidate):
            dropped.append(replacement)
        else:
            resolved[matched[index]] = replacement
    return [resolved[index] for index in sorted(resolved)], dropped


def reconstruct_proxy(
    record: CandidateRecord, box: UprightBox, solid: Solid, mask: Mask, photo: Photo, services: Services
) -> Proxy:
    """Proxy of an object without an asset, from its pixels ``mask`` (H, W), in the frame of its box.

    The shape tool reconstructs it; where that finds no shape, the proxy is a primitive of the box's size.
    """
    view = make_object_view(*photo, mask, box, max(photo[1].residual, LEAST_DEPTH_NOISE), record.hollow)
    config, folder = services.config, services.folder / "shapes"
    shape = services.run_tool(config.tools.shape, view=view, folder=folder, model=config.shape.model).shape
    if isinstance(shape, MeshFile):
        shape = fit_mesh_file(shape, view)
    if shape is None:
        return primitive_proxy(solid, box.size, record.color, record.hollow, view)
    return Proxy.from_shape(shape, record.color, solid, record.hollow)


def _simulate_to_rest(
    scene: Sequence[SceneObject],
    things: Sequence[PlacedObject | PlacedProxy],
    photo: Photo,
    compared: Mask,
    warnings: list[str],
    services: Services,
) -> SettledScene:
    """The objects at rest in MuJoCo; the twin is compared with the photo at the pixels ``compared`` (H, W)."""
    folder = services.folder / "assets"
    rest: Sequence[RestPose | None] = [None] * len(scene)
    twin: TwinReport | None = None
    try:
        steady = settle_with_stable_colliders(things, folder, lambda: services.library, *photo, compared)
        placed, rest, twin = steady.placed, steady.rest.placed, steady.twin
    except GrsError as error:
        placed = place_with_cleared_colliders(things, folder, services.library)
        warnings = [*warnings, f"the scene has no twin: {error.message}"]
    library = services.library  # with the proxies that were written
    resting: list[SceneObject] = []
    for item, thing, end in zip(scene, placed, rest, strict=True):
        update: dict[str, object] = {"settled": end.pose, "drift": end.drift, "held": end.held} if end else {}
        if thing.guessed:
            position, orientation = thing.pose
            update |= {"position": position, "orientation": orientation, "size": library.asset(thing.asset).size}
            update |= {"reachable": is_reachable_position(position)}
        resting.append(item.model_copy(update=update))
    bodies = [body_from_asset(item.name, item.asset, (item.position, item.orientation), library) for item in resting]
    return SettledScene(tuple(resting), find_spatial_relations(bodies), twin, tuple(warnings))


def _asset_pose(item: SceneObject) -> PlacedObject:
    return PlacedObject(item.asset, (item.position, item.orientation), guessed=not item.matched)
