"""Edits of a scene by a person: each changes the objects of a scene at rest, then all settle once more.

The corrected scene is a function of the scene before it, its photo, the configuration and the edits. Objects that no
edit names keep asset and measured pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from grs_agents.agents.types import Description
from grs_agents.base import Pose
from grs_agents.base.errors import ConfigError, InputError, OutputError
from grs_agents.base.foreign.files import path_exists
from grs_agents.base.geometry.transforms import matrix_to_quaternion, rotation_about_z, to_vec3
from grs_agents.base.questions import ask_person
from grs_agents.base.trace.events import SceneStage
from grs_agents.base.trace.log import EventLog, read_events
from grs_agents.graph.perceive import (
    find_recorded_camera,
    log_edits,
    prepare_scene_for_tasks_with_warnings,
    require_movable_object,
)
from grs_agents.graph.placement import (
    LEAST_DEPTH_NOISE,
    describe_size_mismatch,
    place_asset_or_proxy,
    raise_confidence_of_fit,
    reconstruct_proxy,
    register_objects,
    replace_misfit_assets,
    scale_to_measured_size,
    unique_object_name,
)
from grs_agents.graph.recognition import describe_segments, match_objects
from grs_agents.graph.services import Photo, Services, Update, logged_node
from grs_agents.graph.state import RunState, TableObject
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception.annotated_pictures import draw_object_names
from grs_agents.perception.coverage import MeasuredCoverage, measure_coverage, raised_pixel_mask
from grs_agents.perception.edits import (
    AS_SEEN,
    FILE,
    Add,
    ChooseAsset,
    ChooseShape,
    ChooseTable,
    CorrectMask,
    Delete,
    Edit,
    Mark,
    Merge,
    Move,
    Pixel,
    PlaceRobot,
    Rectangle,
    Rename,
    SceneEdits,
    SetFriction,
    SetMass,
    Split,
    describe_edit,
    inner_pixel,
    mask_from_runs,
    read_edits,
    write_edits,
)
from grs_agents.perception.image_geometry import mask_bounding_slices, pixels_in_mask, points_in_hull_mask
from grs_agents.perception.matching.feature_matcher import rank_assets_per_segment
from grs_agents.perception.matching.types import MatchRequest, Segment
from grs_agents.perception.picture_files import load_mask, save_candidate, save_label_pictures
from grs_agents.perception.proxies.box_clipping import EstimatedVolume
from grs_agents.perception.proxies.proxy import primitive_proxy, write_edited_asset
from grs_agents.perception.registration.size_check import enclosing_aabb
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.segmentation.rectangle_masks import segment_rectangle
from grs_agents.perception.segmentation.sam2_models import segment_rectangle_with_sam2
from grs_agents.perception.settling.groups import GroupSettler
from grs_agents.perception.settling.proxy_placement import (
    PlacedProxy,
    extend_box_to_support,
    place_with_cleared_colliders,
)
from grs_agents.perception.settling.segment_reconciliation import occupied_points_mask
from grs_agents.perception.settling.settling import PlacedObject, settle_and_measure_fidelity, to_instance_objects
from grs_agents.perception.settling.support_relations import body_from_asset, find_spatial_relations
from grs_agents.perception.shapes.types import make_object_view
from grs_agents.perception.table_finding import matrix_to_tuples, pixels_to_robot_frame
from grs_agents.perception.twin_picture import save_twin_picture
from grs_agents.perception.types import (
    Array,
    DroppedCandidate,
    Mask,
    MatchEvidence,
    RGBDFrame,
    SceneDescription,
    SceneObject,
    TableFrame,
    is_reachable_position,
    read_scene_description,
)
from grs_agents.sim.world.footprints import (
    Prism,
    collider_prisms_at_pose,
    least_outline_gaps,
    object_prism_at_pose,
    rest_height_of_prisms,
)

BEFORE: Final = "scene/before_edits.json"
"""The description of the scene before its edits, in the folder of a corrected scene."""
REVIEW: Final = "Is the scene right? Go on, or name a file of edits."
"""Question of a run that a person reviews."""
BY_PERSON: Final = "person"
"""Method of the match of an asset that a person chose."""
REBUILT: Final = MatchEvidence(match="no_asset", method=BY_PERSON, confidence=1.0, reason="rebuilt, by a person")
"""Match of an object that a person had reconstructed as seen."""
_NEAR = 6  # pixels; a place beside a mask still names its object
_OVERLAP = 0.002  # m; less is left to the settling
_CLEARANCE = 0.0005  # m over the support at which a moved object is let go
_NAMED = 8  # objects in an error
_GONE = 0.5  # share of its pixels that an object loses to another, beyond which it was a piece of that
_ADDED = 0.5  # share of an object's pixels that a person drew and that lie in a rectangle
_ANEW = 0.5  # share of a rectangle in an object's bounding box from which it is drawn around it anew
_LEAST_REST = 0.06  # share of an object that its border may make out
_MEASURED_ANEW = 0.15  # beyond which the rest is another object than that measured; masks are off by less at borders
_RANKED = 10  # assets that a person may choose from


@dataclass(frozen=True, eq=False)
class EditedObject:
    """An object of a scene that is edited."""

    item: SceneObject
    mask: Mask  # (H, W)
    pose: Pose  # from which it settles

    @property
    def placed(self) -> PlacedObject:
        """Its asset at its pose."""
        return PlacedObject(self.item.asset, self.pose)


@dataclass(frozen=True, eq=False)
class EditedScene:
    """A scene after some edits, before it settles."""

    before: SceneDescription
    photo: RGBDFrame
    table: TableFrame
    objects: tuple[EditedObject, ...]
    left_out: Mask  # (H, W) pixels of scenery and robot
    robot: Mask  # (H, W)
    blur: Mask  # (H, W) pixels beside objects that have their depth, but not their colour
    drawn: Mask  # (H, W) pixels of objects when a person added them
    above: Mask  # (H, W) pixels that rise above the table
    removed: tuple[tuple[Mask, DroppedCandidate], ...]  # the objects that a person removed
    slugs: frozenset[str]  # names of assets that are taken
    first_free: int  # number
    lines: tuple[str, ...]  # the edits in words

    def find(self, place: Pixel) -> EditedObject:
        """The object at a pixel, the smallest of several.

        Raises:
            InputError: there is none; it names the objects and their places.
        """
        column, row = place
        rows, columns = self.left_out.shape
        if column < columns and row < rows:
            around = np.s_[max(0, row - _NEAR) : row + _NEAR + 1, max(0, column - _NEAR) : column + _NEAR + 1]
            for window in (np.s_[row : row + 1, column : column + 1], around):
                hit = [edited for edited in self.objects if edited.mask[window].any()]
                if hit:
                    return min(hit, key=lambda edited: int(np.count_nonzero(edited.mask)))
        shown = [f"{edited.item.name} at {inner_pixel(edited.mask)}" for edited in self.objects[:_NAMED]]
        raise InputError(f"there is no object at the pixel {column}, {row}", f"name a pixel of {'; '.join(shown)}")

    def replace_object(self, old: EditedObject, new: EditedObject) -> "EditedScene":
        """The scene with another state of an object."""
        objects = tuple(new if edited is old else edited for edited in self.objects)
        return replace(self, objects=objects, slugs=self.slugs | {Path(new.item.asset).stem, new.item.name})


def open_edited_scene(scene: SceneDescription, frame: RGBDFrame, folder: Path) -> EditedScene:
    """The scene of a run folder before any edit.

    Raises:
        InputError: a picture of the folder is missing, not of the photo's size, or an object without pixels.
    """
    shape = frame.depth.shape
    names = ("left_out", "robot", "blur")
    masks = {
        name: load_mask(file) if path_exists(file := folder / f"scene/{name}.png") else np.zeros(shape, np.bool_)
        for name in names
    }
    objects: list[EditedObject] = []
    for item in scene.objects:
        mask = load_mask(folder / item.mask)
        objects.append(EditedObject(item, mask, item.settled or (item.position, item.orientation)))
    sized = {**masks, **{edited.item.mask: edited.mask for edited in objects}}
    for name, mask in sized.items():
        if mask.shape != shape:
            raise InputError(f"{folder}: the mask {name} is of another size than the photo", "make the scene again")
    if empty := [edited.item.mask for edited in objects if not edited.mask.any()]:
        raise InputError(f"{folder}: the mask {empty[0]} is empty", "make the scene again")
    return EditedScene(
        before=scene,
        photo=frame,
        table=scene.frame,
        objects=tuple(objects),
        **masks,
        drawn=np.zeros(shape, np.bool_),
        above=raised_pixel_mask(frame, scene.frame, masks["left_out"], masks["robot"]) & ~masks["blur"],
        removed=(),
        slugs=frozenset(name for item in scene.objects for name in (item.name, Path(item.asset).stem)),
        first_free=1 + max([0, *(item.id for item in scene.objects), *(item.id for item in scene.dropped)]),
        lines=(),
    )


def apply_edit(scene: EditedScene, edit: Edit, services: Services) -> EditedScene:
    """The scene after an edit.

    Raises:
        GrsError: the edit does not fit the scene, with the reason.
    """
    line = describe_edit(edit)
    match edit:
        case Add():
            mask = _require_mask(scene, edit, services)
            scene, words = _take_pixels(scene, mask, services)
            scene = replace(_add_object(scene, mask, services), drawn=scene.drawn | mask)
            line = f"{scene.objects[-1].item.name} is added{words}"
        case Merge():
            pieces = list(dict.fromkeys(scene.find(place) for place in edit.places))
            names = " and ".join(edited.item.name for edited in pieces)
            if len(pieces) < 2:
                raise InputError(f"all places are of {names}", "name pixels of at least two objects")
            mask = np.any([edited.mask for edited in pieces], axis=0)
            scene = _add_object(_without(scene, pieces), mask, services)
            line = f"{names} are one object, {scene.objects[-1].item.name}"
        case Split():
            whole = scene.find(edit.place)
            inside = _require_mask(scene, edit, services)
            parts = (_take_part(whole, inside, edit), inside)
            scene = _without(scene, [whole])
            for part in parts:
                scene = _add_object(scene, part, services)
            line = f"{whole.item.name} is split into {' and '.join(t.item.name for t in scene.objects[-2:])}"
        case CorrectMask():
            edited, part = scene.find(edit.place), _require_mask(scene, edit, services)
            name, rest = edited.item.name, _without(scene, [edited])
            if edit.kind == "include":
                line = f"{name} gains a part"
                rest, words = _take_pixels(rest, part, services)
                scene = _add_object(rest, edited.mask | part, services)
            else:
                line, words = f"{name} loses a part", ""
                scene = _add_object(rest, _take_part(edited, part, edit), services)
            line += f"{words} and is now {scene.objects[-1].item.name}"
        case Delete():
            edited = scene.find(edit.place)
            line, riders = f"{edited.item.name} is no object", _riders(scene, edited, services.library)
            scene = _drop(_remove(scene, edited, "deleted by a person"), riders, services.library)
        case Mark(kind="container"):
            edited = scene.find(edit.place)
            line = f"{edited.item.name} is a container"
            scene = _rebuild(scene, edited, REBUILT, services, hollow=True)
        case Mark():
            edited = scene.find(edit.place)
            kind = "the robot" if edit.kind == "robot" else "scenery"
            line = f"{edited.item.name} is {kind}"
            robot = scene.robot | edited.mask if edit.kind == "robot" else scene.robot
            scene = _remove(scene, edited, f"{kind}, by a person")
            left_out = scene.left_out | edited.mask
            above = raised_pixel_mask(scene.photo, scene.table, left_out, robot) & ~scene.blur
            scene = replace(scene, left_out=left_out, robot=robot, above=above)
        case Rename():
            edited = scene.find(edit.place)
            name = unique_object_name(edit.name, [other.item.name for other in scene.objects if other is not edited])
            line = f"{edited.item.name} is renamed to {name}"
            words = {"name": name, "description": edit.name}
            if not edited.item.matched:  # an asset of the library has a category of its own
                nouns = [word for word in edit.name.split() if word.lower() != edited.item.color.lower()]
                words["category"] = " ".join(nouns) or edit.name
            scene = scene.replace_object(edited, replace(edited, item=edited.item.model_copy(update=words)))
        case ChooseAsset():
            edited = scene.find(edit.place)
            if edit.asset == AS_SEEN:
                scene = _rebuild(scene, edited, REBUILT, services)
                line = f"{edited.item.name} is rebuilt as seen"
            else:
                services.library.asset(edit.asset)  # GrsError with the nearest names
                chosen = MatchEvidence(
                    match="asset", asset=edit.asset, method=BY_PERSON, confidence=1.0, reason="chosen by a person"
                )
                scene = _rebuild(scene, edited, chosen, services)
                line = f"{edited.item.name} is {edit.asset}"
        case ChooseShape():
            edited = scene.find(edit.place)
            scene = _use_primitive(scene, edited, edit, services)
            line = f"{edited.item.name} is a {edit.shape}"
        case Move():
            edited = scene.find(edit.place)
            line = describe_edit(edit).replace(f"the object at {edit.place[0]}, {edit.place[1]}", edited.item.name)
            scene = _move(scene, edited, edit, services.library)
        case SetMass() | SetFriction():
            edited = scene.find(edit.place)
            item = edited.item.model_copy(
                update={"mass": edit.mass} if isinstance(edit, SetMass) else {"friction": edit.friction}
            )
            line = describe_edit(edit).replace(f"the object at {edit.place[0]}, {edit.place[1]}", edited.item.name)
            scene = scene.replace_object(edited, replace(edited, item=item))
            scene = _write_physics(scene, scene.find(edit.place), services)
        case ChooseTable():
            pass  # the node `find_table` has read it
        case PlaceRobot():
            scene = _place_robot(scene, edit)
    return replace(scene, lines=(*scene.lines, line))


def _shape(scene: EditedScene) -> tuple[int, int]:
    rows, columns = scene.left_out.shape
    return rows, columns


def _without(scene: EditedScene, gone: Sequence[EditedObject]) -> EditedScene:
    return replace(scene, objects=tuple(edited for edited in scene.objects if edited not in gone))


def _remove(scene: EditedScene, edited: EditedObject, reason: str) -> EditedScene:
    dropped = DroppedCandidate(id=edited.item.id, reason=reason)
    return replace(_without(scene, [edited]), removed=(*scene.removed, (edited.mask, dropped)))


def find_mask(scene: EditedScene, edit: Add | Split | CorrectMask, services: Services) -> Mask | None:
    """(H, W) pixels in the rectangle of an edit: the object that it adds, or the part of an object that it concerns.

    Returns:
        None if nothing in the rectangle differs from its rim.

    Raises:
        InputError: the rectangle leaves the photo, or holds nothing of the object.
    """
    rectangle = edit.rectangle
    rows, columns = _shape(scene)
    if rectangle.right > columns or rectangle.bottom > rows:
        raise InputError(f"the rectangle {rectangle} leaves the photo of {columns} x {rows} pixels", "draw it inside")
    if isinstance(edit, Add) and edit.runs is not None:
        return mask_from_runs(rectangle, edit.runs, (rows, columns))
    edited = None if isinstance(edit, Add) else scene.find(edit.place)
    others = [item.mask for item in scene.objects if item is not edited]
    if edited is None:
        return _segment_rectangle(scene, rectangle, others, ~_drawn_apart(scene, rectangle), services)
    if isinstance(edit, CorrectMask) and edit.kind == "include":
        return _segment_rectangle(scene, rectangle, others, ~edited.mask, services)
    inside = rectangle.mask((rows, columns)) & edited.mask
    if not inside.any():
        raise InputError(
            f"the rectangle {rectangle} holds nothing of {edited.item.name}", "draw it around a part of it"
        )
    part = _segment_rectangle(scene, rectangle, (), edited.mask, services)
    return inside if part is None else part


def _drawn_apart(scene: EditedScene, rectangle: Rectangle) -> Mask:
    """(H, W) pixels of the objects in a rectangle that a person added, but for those that it is drawn around anew."""
    inside, apart = rectangle.mask(_shape(scene)), np.zeros_like(scene.drawn)
    for edited in scene.objects:
        added = np.count_nonzero(edited.mask & scene.drawn & inside) > _ADDED * np.count_nonzero(edited.mask)
        around = mask_bounding_slices(edited.mask)
        if added and np.count_nonzero(inside[around]) < _ANEW * np.count_nonzero(inside):
            apart |= edited.mask
    return apart


def _segment_rectangle(
    scene: EditedScene, rectangle: Rectangle, others: Sequence[Mask], within: Mask | None, services: Services
) -> Mask | None:
    """(H, W) mask of the object in a rectangle, by the user's SAM 2 if it segments the photo, else by depth and colour.

    Args:
        scene: the scene.
        rectangle: around the object.
        others: (H, W) masks of the known objects.
        within: (H, W) pixels that the mask may have, or None for all.
        services: of the run.
    """
    config = services.config
    if config.tools.segment != "segment_sam2":
        return segment_rectangle(scene.photo, scene.table, rectangle.window, others, within)
    mask = segment_rectangle_with_sam2(scene.photo, rectangle.window, config.segment.model, config.segment.device)
    if mask is not None and within is not None:
        mask &= within
    return mask if mask is not None and mask.any() else None


def _require_mask(scene: EditedScene, edit: Add | Split | CorrectMask, services: Services) -> Mask:
    mask = find_mask(scene, edit, services)
    if mask is None:
        raise InputError(
            f"nothing in the rectangle {edit.rectangle} differs from its rim in height or colour",
            "draw it closer around the object, with a rim of the table",
        )
    return mask


def _take_part(edited: EditedObject, part: Mask, edit: Split | CorrectMask) -> Mask:
    """(H, W) rest of an object without a part."""
    rest = edited.mask & ~part
    if np.count_nonzero(rest) < _LEAST_REST * np.count_nonzero(edited.mask):
        raise InputError(
            f"the rectangle {edit.rectangle} holds all of {edited.item.name}", "draw it around a part of it"
        )
    return rest


def _take_pixels(scene: EditedScene, mask: Mask, services: Services) -> tuple[EditedScene, str]:
    """The scene whose objects leave the pixels of a mask (H, W), and the loss of each in words, the largest first.

    Without most of its pixels an object is gone; without fewer it is measured, described and matched anew, unless they
    are a few at its border.
    """
    losses = [(np.count_nonzero(item.mask & mask) / np.count_nonzero(item.mask), item) for item in scene.objects]
    words: list[str] = []
    for share, edited in sorted((loss for loss in losses if loss[0] > 0), key=lambda loss: -loss[0]):
        left = edited.mask & ~mask
        taken = f"{max(1, round(100 * share))} % of {edited.item.name}"
        if share > _GONE:
            scene = _without(scene, [edited])
            taken += ", which it replaces"
        elif share > _MEASURED_ANEW:
            scene = _add_object(_without(scene, [edited]), left, services)
            taken += f", which is now {scene.objects[-1].item.name}"
        else:
            kept = replace(edited, mask=left)
            scene = replace(scene, objects=tuple(kept if item is edited else item for item in scene.objects))
        words.append(taken)
    return scene, f"; it takes {'; '.join(words)}" if words else ""


def _measure(scene: EditedScene, mask: Mask, number: int, services: Services) -> TableObject:
    """Measure the object of a mask beside the others, and write its pictures."""
    labels = np.zeros(mask.shape, np.int32)
    for label, edited in enumerate(scene.objects, 2):
        labels[edited.mask] = label
    labels[mask] = 1
    counted = int(np.count_nonzero(mask & (scene.photo.depth > 0)))
    try:
        measured = measure_candidates(scene.photo, scene.table, labels, given=True, most=1)
    except InputError as error:
        raise InputError(
            f"{counted} of {np.count_nonzero(mask)} pixels have depth: too few to measure an object",
            "take more of the object into the mask",
        ) from error
    return TableObject.from_record(save_candidate(replace(measured[0], id=number), services.folder))


def _add_object(scene: EditedScene, mask: Mask, services: Services) -> EditedScene:
    """Describe, match, and place the object of a mask."""
    number, photo = scene.first_free, (scene.photo, scene.table)
    item = _measure(scene, mask, number, services)
    described = describe_segments([item], number + 1, photo, services)
    words = described.descriptions[number]
    hollow = item.hollow if words.open_top is None else words.open_top
    item = item.model_copy(update={"description": words.model_copy(update={"is_object": True}), "hollow": hollow})
    (item,), _ = match_objects([item], photo, scene.before.image, services)
    scene = replace(scene, first_free=number + 1)
    return _place(scene, item, mask, services)


def _place(
    scene: EditedScene, item: TableObject, mask: Mask, services: Services, sure: bool = False, name: str = ""
) -> EditedScene:
    """Place a matched object: its asset, which is ``sure`` if a person chose it, or its reconstruction."""
    photo: Photo = scene.photo, scene.table
    masks = {item.id: mask}
    item = place_asset_or_proxy(item, services, sorted(scene.slugs), name)
    (item,) = register_objects([item], masks, photo, services)
    if sure and describe_size_mismatch(item, services):
        item = scale_to_measured_size(item, mask, photo, services) or item
    elif not sure:
        kept, dropped, _ = replace_misfit_assets([item], sorted(scene.slugs), masks, photo, services)
        if not kept:
            raise ConfigError(dropped[0].reason, "set match.proxies=true")
        item = raise_confidence_of_fit(kept[0])
    placed = item.scene_object
    if not placed.matched:
        placed = _reconstruct(scene, item, mask, services)
    if name:
        placed = placed.model_copy(update={"name": name})
    edited = EditedObject(placed, mask, (placed.position, placed.orientation))
    slugs = scene.slugs | {placed.name, Path(placed.asset).stem}
    return replace(scene, objects=(*scene.objects, edited), slugs=slugs)


def _reconstruct(scene: EditedScene, item: TableObject, mask: Mask, services: Services) -> SceneObject:
    """The proxy of an object as the photo shows it, clear of all others."""
    photo: Photo = scene.photo, scene.table
    others = [edited.placed for edited in scene.objects]
    cloud = pixels_to_robot_frame(*photo, *pixels_in_mask(mask & (scene.photo.depth > 0)))
    volume = EstimatedVolume(item.upright, item.shape, cloud, item.hollow).lift_bottom_above_occupied(
        lambda points: occupied_points_mask(points, others, services.library)
    )
    box = extend_box_to_support(volume.box)
    proxy = reconstruct_proxy(item, box, volume.shape, mask, photo, services)
    placed = item.scene_object
    return _write_proxy(
        placed, PlacedProxy(Path(placed.asset).stem, placed.description, volume.shape, box, proxy), others, services
    )


def _write_proxy(
    item: SceneObject, proxy: PlacedProxy, others: Sequence[PlacedObject], services: Services
) -> SceneObject:
    """The object with a proxy whose colliders are clear of the ``others``."""
    *_, placed = place_with_cleared_colliders([*others, proxy], services.folder / "assets", services.library)
    position, orientation = placed.pose
    update = {
        "asset": placed.asset,
        "matched": False,
        "method": "proxy",
        "residual": None,
        "position": position,
        "orientation": orientation,
        "size": services.library.asset(placed.asset).size,
        "reachable": is_reachable_position(position),
    }
    return item.model_copy(update=update)


def _measure_again(scene: EditedScene, edited: EditedObject, services: Services) -> tuple[EditedScene, TableObject]:
    """The scene without an object, and the object measured from its mask, with its words."""
    rest = _without(scene, [edited])
    item, known = _measure(rest, edited.mask, edited.item.id, services), edited.item
    words = Description(
        is_object=True,
        description=known.description,
        color=known.color,
        shape="cylinder" if known.round else "box",
        category=known.category,
    )
    return rest, item.model_copy(update={"description": words})


def _keep_place(scene: EditedScene, edited: EditedObject, new: EditedScene, services: Services) -> EditedScene:
    """The scene with a rebuilt object, the last of ``new``, in the order and with the facts of the former."""
    built = new.objects[-1]
    facts = {key: getattr(edited.item, key) for key in ("name", "mass", "friction")}
    built = replace(built, item=built.item.model_copy(update=facts))
    objects = tuple(built if old is edited else old for old in scene.objects)
    return _write_physics(replace(new, objects=objects), built, services)


def _rebuild(
    scene: EditedScene, edited: EditedObject, match: MatchEvidence, services: Services, hollow: bool | None = None
) -> EditedScene:
    """Replace an object by the matched asset, registered to its pixels, or by its reconstruction."""
    rest, item = _measure_again(scene, edited, services)
    update = {"match": match, "hollow": item.hollow if hollow is None else hollow}
    new = _place(rest, item.model_copy(update=update), edited.mask, services, sure=True)
    return _keep_place(scene, edited, new, services)


def _use_primitive(scene: EditedScene, edited: EditedObject, edit: ChooseShape, services: Services) -> EditedScene:
    """Replace an object by a primitive of a given or measured size, painted from the photo."""
    rest, item = _measure_again(scene, edited, services)
    hollow, solid = edit.shape == "bowl", "box" if edit.shape == "box" else "cylinder"
    box = item.upright
    if edit.size is not None:
        bottom = box.center[2] - box.size[2] / 2
        box = box.model_copy(update={"size": edit.size, "center": (*box.center[:2], bottom + edit.size[2] / 2)})
    view = make_object_view(
        scene.photo, scene.table, edited.mask, box, max(scene.table.residual, LEAST_DEPTH_NOISE), hollow
    )
    proxy = primitive_proxy(solid, box.size, item.color, hollow, view)
    slug = unique_object_name(edit.shape, sorted(scene.slugs))
    match = MatchEvidence(match="no_asset", method=BY_PERSON, confidence=1.0, reason=f"a {edit.shape}, by a person")
    placed = edited.item.model_copy(
        update={
            "match": match,
            "evidence": match.reason,
            "box": enclosing_aabb(box, solid),
            "upright": box,
            "round": edit.shape != "box",
        }
    )
    others = [other.placed for other in rest.objects]
    built = _write_proxy(placed, PlacedProxy(slug, placed.description, solid, box, proxy), others, services)
    new = replace(
        rest,
        objects=(*rest.objects, EditedObject(built, edited.mask, (built.position, built.orientation))),
        slugs=rest.slugs | {slug},
    )
    return _keep_place(scene, edited, new, services)


def _write_physics(scene: EditedScene, edited: EditedObject, services: Services) -> EditedScene:
    """Give an object an asset of its own, with the mass and friction that a person set."""
    item = edited.item
    if item.mass is None and item.friction is None:
        return scene
    kept = unique_object_name("edited", sorted(scene.slugs))
    own = write_edited_asset(services.folder / "assets", kept, item.asset, services.library, item.mass, item.friction)
    changed = scene.replace_object(edited, replace(edited, item=item.model_copy(update={"asset": own.name})))
    return replace(changed, slugs=changed.slugs | {kept})


def find_overlaps(
    scene: EditedScene, edited: EditedObject, position: tuple[float, float], yaw: float, library: Library
) -> tuple[str, ...]:
    """Names of the objects that an object would stand in, or half on, at another position (m) and yaw (rad)."""
    _, overlaps = _lower(scene, edited, position, yaw, _riders(scene, edited, library), library)
    return overlaps


def _lower(
    scene: EditedScene,
    edited: EditedObject,
    position: tuple[float, float],
    yaw: float,
    riders: Sequence[EditedObject],
    library: Library,
) -> tuple[Pose, tuple[str, ...]]:
    """The pose of an object lowered onto the table or the object below, and the names of those that it overlaps."""
    turn = rotation_about_z(yaw) @ matrix_from_quaternion(edited.pose[1])
    aloft: Pose = (*position, edited.pose[0][2]), matrix_to_quaternion(turn)
    (instance,) = to_instance_objects([PlacedObject(edited.item.asset, aloft)], library)
    model = library.load_object_model(edited.item.asset)
    body, whole = collider_prisms_at_pose(model, instance.pose), object_prism_at_pose(model, instance.pose)
    obstacles: list[Prism] = []
    overlaps: list[str] = []
    for other in scene.objects:
        if other is edited or other in riders:
            continue
        (still,) = to_instance_objects([other.placed], library)
        other_model = library.load_object_model(other.item.asset)
        around = object_prism_at_pose(other_model, still.pose)
        if least_outline_gaps(whole.outline, [around], np.zeros((1, 2)))[0] >= -_OVERLAP:
            continue
        obstacles += collider_prisms_at_pose(other_model, still.pose)
        if not points_in_hull_mask(np.array([position]), around.outline, 0.0)[0]:
            overlaps.append(other.item.name)
    bottom = rest_height_of_prisms(body or [whole], obstacles, np.zeros((1, 2)), 0.0) if obstacles else 0.0
    height = aloft[0][2] + max(bottom, 0.0) + _CLEARANCE - whole.low
    return ((*position, height), aloft[1]), tuple(overlaps)


def rank_assets(scene: EditedScene, place: Pixel, services: Services) -> tuple[str, ...]:
    """The assets that look most like the object at a pixel by measured features, the best first, at most ten."""
    edited, config = scene.find(place), services.config
    upright, item = edited.item.upright, edited.item
    if upright is None:
        _, measured = _measure_again(scene, edited, services)
        upright = measured.upright
    segment = Segment(item.id, edited.mask, upright, services.folder / item.crop, int(np.count_nonzero(edited.mask)))
    request = MatchRequest([segment], scene.photo, scene.table, ocr=False, index=config.match.index)
    ranked, _ = rank_assets_per_segment(request, services.library, "no size")[item.id]
    return ranked.names[:_RANKED]


def _riders(scene: EditedScene, edited: EditedObject, library: Library) -> list[EditedObject]:
    """The objects that stand on or in an object, or on these."""
    bodies = [body_from_asset(str(number), it.item.asset, it.pose, library) for number, it in enumerate(scene.objects)]
    below = {int(it.subject): int(it.reference) for it in find_spatial_relations(bodies) if it.kind != "touching"}
    carried, base = set[int](), {scene.objects.index(edited)}
    while more := {upper for upper, lower in below.items() if lower in carried | base} - carried - base:
        carried |= more
    return [scene.objects[number] for number in sorted(carried)]


def _move(scene: EditedScene, edited: EditedObject, edit: Move, library: Library) -> EditedScene:
    """Move an object and the objects on it."""
    riders = _riders(scene, edited, library)
    pose, overlaps = _lower(scene, edited, edit.position, edit.yaw, riders, library)
    if overlaps:
        raise InputError(
            f"{edited.item.name} would stand in or half on {', '.join(overlaps)}",
            "move it until its centre is over the object that it shall stand on, or clear of it",
        )
    turn = rotation_about_z(edit.yaw)

    def shift(moved: EditedObject) -> EditedObject:
        offset = turn @ np.subtract(moved.pose[0], edited.pose[0])
        place = to_vec3(offset + pose[0])
        rotation = matrix_to_quaternion(turn @ matrix_from_quaternion(moved.pose[1]))
        return _at_pose(moved, (place, rotation), turn, np.array(pose[0]) - turn @ np.array(edited.pose[0]))

    objects = tuple(shift(other) if other is edited or other in riders else other for other in scene.objects)
    return replace(scene, objects=objects)


def _drop(scene: EditedScene, riders: Sequence[EditedObject], library: Library) -> EditedScene:
    """Lower the riders of an object that is gone onto what is below them, the lowest first."""
    waiting = sorted(riders, key=lambda rider: rider.pose[0][2])
    while waiting:
        rider = waiting.pop(0)
        (x, y, z), _ = rider.pose
        pose, _ = _lower(scene, rider, (x, y), 0.0, waiting, library)
        lowered = _at_pose(rider, pose, np.eye(3), np.array((0.0, 0.0, pose[0][2] - z)))
        scene = replace(scene, objects=tuple(lowered if other is rider else other for other in scene.objects))
    return scene


def _at_pose(edited: EditedObject, pose: Pose, turn: Array, shift: Array) -> EditedObject:
    """An object at another pose; its measured boxes are turned and shifted alike."""
    item, update = edited.item, dict[str, object]()
    if item.upright is not None:
        center = to_vec3(turn @ np.array(item.upright.center) + shift)
        yaw = item.upright.yaw + float(np.arctan2(turn[1, 0], turn[0, 0]))
        upright = item.upright.model_copy(update={"center": center, "yaw": yaw})
        update = {"upright": upright, "box": enclosing_aabb(upright, "cylinder" if item.round else "box")}
    update |= {"position": pose[0], "orientation": pose[1]}
    return replace(edited, item=item.model_copy(update=update), pose=pose)


def _place_robot(scene: EditedScene, edit: PlaceRobot) -> EditedScene:
    """Lay the robot frame anew, at a pose in the present frame."""
    if scene.table.origin == "calibrated":
        raise InputError("the photo is calibrated: T_robot_cam gives the robot's base", "correct T_robot_cam instead")
    if scene.before.background:
        raise InputError("the background was made for the robot's present base", "set background.on=false")
    turn = rotation_about_z(-edit.yaw)
    shift = -turn @ np.array((*edit.position, 0.0))
    transform = np.array(scene.table.T_robot_cam)
    transform[:3] = turn @ transform[:3]
    transform[:3, 3] += shift
    table = scene.table.model_copy(update={"T_robot_cam": matrix_to_tuples(transform)})

    def carry(edited: EditedObject) -> EditedObject:
        place = to_vec3(turn @ np.array(edited.pose[0]) + shift)
        rotation = matrix_to_quaternion(turn @ matrix_from_quaternion(edited.pose[1]))
        return _at_pose(edited, (place, rotation), turn, shift)

    return replace(scene, table=table, objects=tuple(map(carry, scene.objects)))


def settle_edited_scene(scene: EditedScene, services: Services, settler: GroupSettler) -> SceneDescription:
    """The corrected scene at rest, ready for tasks.

    Raises:
        InputError: no object is left, or the arm can move none of them.
        SimulationError: MuJoCo rejects the scene.
    """
    if not scene.objects:
        raise InputError("no object is left in the scene", "undo an edit, or add an object")
    frame, table, library = scene.photo, scene.table, services.library
    owned = np.any([edited.mask for edited in scene.objects], axis=0)
    placed = [edited.placed for edited in scene.objects]
    rest, twin = settle_and_measure_fidelity(placed, library, frame, table, scene.above | owned, settler.settle)
    objects: list[SceneObject] = []
    for edited, end in zip(scene.objects, rest.placed, strict=True):
        described = (edited.item.position, edited.item.orientation)
        update: dict[str, object] = {"settled": None, "drift": None, "held": False}
        if end is not None:
            drift = float(np.linalg.norm(np.subtract(end.pose[0], described[0])))
            update = {"settled": end.pose, "drift": drift, "held": end.held}
        update |= {
            "stands_in_robot": False,
            "reachable": is_reachable_position(described[0]),
            "pick_trouble": edited.item.pick_trouble if edited.item.is_doubtful else "",
        }
        objects.append(edited.item.model_copy(update=update))
    bodies = [
        body_from_asset(item.name, item.asset, item.settled or (item.position, item.orientation), library)
        for item in objects
    ]
    ids = {item.id for item in objects}
    description = scene.before.model_copy(
        update={
            "frame": table,
            "objects": tuple(objects),
            "dropped": (
                *(item for item in scene.before.dropped if item.id not in ids),
                *(dropped for _, dropped in scene.removed),
            ),
            "relations": find_spatial_relations(bodies),
            "twin": twin,
            "coverage": _measure_coverage(scene).record,
            "edits": scene.lines,
        }
    )
    return prepare_scene_for_tasks_with_warnings(description, services)


def _measure_coverage(scene: EditedScene) -> MeasuredCoverage:
    owned = np.any([edited.mask for edited in scene.objects], axis=0)
    removed = [(mask, dropped.reason) for mask, dropped in scene.removed]
    return measure_coverage(scene.photo, scene.table, scene.above, owned, removed)


def save_corrected_scene(
    corrected: SceneDescription, scene: EditedScene, edits: SceneEdits, services: Services, log: EventLog
) -> str:
    """Write ``scene.json``, ``edits.json`` and the pictures of a corrected scene into the run folder, and log them.

    Returns:
        The photo with the names of the objects.
    """
    folder, masks = services.folder, {edited.item.name: edited.mask for edited in scene.objects}
    corrected.write(folder / "scene.json")
    write_edits(edits, folder / FILE)
    save_label_pictures(scene.photo, {edited.item.id: edited.mask for edited in scene.objects}, folder)
    files = save_twin_picture(corrected, services.library, folder)
    if corrected.coverage is not None:
        files["coverage"] = _measure_coverage(scene).write(scene.photo, folder).picture
    log.append(SceneStage(stage="matched", summary=dict(corrected), files=files))
    log_edits(corrected, log)
    return draw_object_names(scene.photo, masks, folder)


@logged_node("edit")
def edit_scene(state: RunState, services: Services) -> Update:
    """Correct the scene by the edits of a person, and let it settle again."""
    before, edits, folder = state["scene"], state["edits"], services.folder
    if path_exists(folder / BEFORE):  # a corrected scene was copied: its edits are replaced
        before = read_scene_description(folder / BEFORE)
    elif edits.table is not None and "table" not in state:
        raise InputError(f"the table of {state['scene_path']} is chosen already", "name the photo instead")
    if "camera" not in state:
        camera = find_recorded_camera(read_events(services.log.path), state["scene_path"])
        state = {**state, "camera": camera}
    frame = services.load_photo(state)
    scene = open_edited_scene(before, frame, folder)
    before.write(folder / BEFORE)
    for number, edit in enumerate(edits.edits, 1):
        try:
            scene = apply_edit(scene, edit, services)
        except OutputError:  # the edit is not at fault
            raise
        except InputError as error:
            raise InputError(f"edit {number} ({edit.act}): {error.message}", error.remedy) from error
    corrected = settle_edited_scene(scene, services, GroupSettler()) if edits.edits else before
    named = save_corrected_scene(corrected, scene, edits, services, services.log)
    if edits.edits:  # without, a person may be about to edit it
        require_movable_object(corrected, services.arm)
    return {"scene": corrected, "image": named if state["image"] else "", "camera": state["camera"]}


@logged_node("review")
def review_scene(state: RunState, services: Services) -> Update:
    """Ask a person to correct the scene; the reply is ``go on``, or the file with the edits."""
    scene = state["scene"]
    names = ", ".join(item.name for item in scene.objects)
    folder = services.folder
    details = f"objects: {names}\nphoto: {folder / state['image']}\npage: grs edit {folder}, which goes on from there"
    while True:
        reply = ask_person(REVIEW, details=details).strip()
        if reply.lower().rstrip(".!") in ("go on", "yes", "ok"):
            return {}
        try:
            return {"edits": read_edits(Path(reply).expanduser())}
        except InputError as error:  # asked anew
            details = str(error)
