"""The nodes of perception, from a photo to a scene at rest in MuJoCo (paper, Scene Comprehension)."""

import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import ValidationError

from grs_agents.base.config.schema import ToolsConfig
from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.foreign.run_folder import find_member_file
from grs_agents.base.trace.events import Event, Note, SceneStage
from grs_agents.base.trace.log import EventLog, read_events
from grs_agents.graph.bystanders import prepare_scene_for_tasks
from grs_agents.graph.placement import (
    explain_rejected_objects,
    place_asset_or_proxy,
    raise_confidence_of_fit,
    register_objects,
    replace_misfit_assets,
    settle_scene,
)
from grs_agents.graph.recognition import describe_segments, match_objects
from grs_agents.graph.services import Photo, Services, Update, logged_node
from grs_agents.graph.state import RunState, TableObject, parse_state, select_pending
from grs_agents.library.background_asset import write_background_asset
from grs_agents.perception.annotated_pictures import NAMED, draw_object_names
from grs_agents.perception.background_reconstruction import reconstruct_background
from grs_agents.perception.coverage import describe_coverage, measure_coverage, raised_pixel_mask
from grs_agents.perception.depth_quality import (
    align_depth_with_colors,
    measure_depth_noise,
    measure_stray_light,
    remove_stray_light,
    smooth_depth_noise,
)
from grs_agents.perception.edits import plane_number_at
from grs_agents.perception.object_finding import find_objects
from grs_agents.perception.picture_files import load_mask, round_depth_as_saved, save_candidates, save_frame, write_png
from grs_agents.perception.reading.bop import is_bop_source
from grs_agents.perception.reading.captures import split_choice
from grs_agents.perception.reading.foreign_scene import is_sample_scene, read_foreign_scene
from grs_agents.perception.reading.known_scene import copy_scene_from_run, is_known_scene
from grs_agents.perception.reading.photo_without_depth import DepthEstimate
from grs_agents.perception.registration.unexplained_segments import add_residual_candidates
from grs_agents.perception.robot_pixels import render_robot_depth, require_joints_within_limits, robot_pixel_mask
from grs_agents.perception.segmentation.candidates import center_objects_in_workspace
from grs_agents.perception.table_appearance import measure_table_color, write_table_texture
from grs_agents.perception.table_finding import describe_table_doubts
from grs_agents.perception.table_finding import find_table as find_table_in_frame
from grs_agents.perception.twin_picture import save_twin_picture
from grs_agents.perception.types import (
    Camera,
    Candidate,
    DroppedCandidate,
    Image,
    Mask,
    RGBDFrame,
    SceneDescription,
    TableFrame,
)
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.world.compilation import compute_arm_spheres_at_home

NAMED_OBJECTS = 3
"""Objects that the error for a scene without movable objects names."""
LEFT_OUT, ROBOT, BLUR = "scene/left_out.png", "scene/robot.png", "scene/blur.png"


def build_background_asset(
    frame: RGBDFrame, table: TableFrame, candidates: Sequence[Candidate], robot: Mask, services: Services
) -> tuple[str, list[str]]:
    """Reconstruct the background of a photo, if the configuration says so, and write it beside the run's proxies.

    Args:
        frame: the photo.
        table: the table in it.
        candidates: the segments, which are no background.
        robot: (H, W) pixels that show the robot, which is none either.
        services: the services of the run.

    Returns:
        The library name of the background, empty without one, and notes for a reader of the scene.
    """
    config = services.config.background
    if not config.on:
        return "", []
    objects = robot.copy()
    for candidate in candidates:
        objects |= candidate.mask
    arm = compute_arm_spheres_at_home(services.robot_name_or_path, services.config.hand, services.library)
    background = reconstruct_background(
        frame, table, objects, [candidate.box for candidate in candidates], arm, config.voxel
    )
    if background is None:
        return "", ["the photo shows nothing but table and objects near the robot: there is no background"]
    folder = services.folder / "assets"
    folder.mkdir(exist_ok=True)
    name = write_background_asset(
        folder, background.mesh.vertices, background.mesh.faces, background.boxes, background.color
    )
    low, high = background.boxes[:, 0].min(axis=0), background.boxes[:, 1].max(axis=0)
    summary = {
        "asset": name,
        "faces": len(background.mesh.faces),
        "boxes": len(background.boxes),
        "pixels": background.pixels,
        "low": [round(float(value), 3) for value in low],
        "high": [round(float(value), 3) for value in high],
    }
    services.log.append(SceneStage(stage="background", summary=summary))
    return name, []


@logged_node("read")
def read_photo_into_run(state: RunState, services: Services) -> Update:
    """Read the RGB-D photo and write it into the run folder; all later nodes use the written files.

    If the source is a run folder, its scene is copied and perception ends here.
    """
    source, config = Path(state["scene_path"]), services.config
    _require_scene_of_user(source, services)
    if is_known_scene(source):
        scene = copy_scene_from_run(source, services.folder, config.robot, config.hand)
        for event in read_events(source / "events.jsonl"):
            if isinstance(event, SceneStage):
                services.log.append(SceneStage(stage=event.stage, summary=event.summary, files=event.files))
        services.log.append(Note(text=f"the scene is that of {source}, as it was made there"))
        if "edits" not in state:
            log_edits(scene, services.log)
        image = scene.image if find_member_file(services.folder, NAMED) is None else NAMED
        if "edits" not in state:
            require_movable_object(scene, services.arm)
        return {"scene": scene, "image": image}

    def estimate_depth(rgb: Image, focal: float | None, photo: str) -> DepthEstimate:
        return services.run_tool(config.tools.depth, rgb=rgb, focal=focal, photo=photo, model=config.depth.model)

    frame = read_foreign_scene(source, estimate_depth, config.depth.field_of_view, config.camera)
    noise = measure_depth_noise(frame)
    frame = align_depth_with_colors(smooth_depth_noise(frame, noise))
    doubts: list[str] = []
    if frame.camera.joints is not None:
        require_joints_within_limits(frame.camera.joints, services.robot_name_or_path)
        if frame.camera.T_robot_cam is None:
            doubts = ["camera.json: joints is not used: where the robot is seen is not known without T_robot_cam"]
    if frame.camera.arm_is_known:
        arm = render_robot_depth(frame, services.robot_name_or_path, services.library, services.config.hand)
        if np.isfinite(arm).any():
            table = find_table_in_frame(frame, np.random.default_rng(config.seed), config.scene.table)
            stray = measure_stray_light(frame, table, arm)  # that the arm scatters into the sensor
            frame = frame if stray is None else remove_stray_light(frame, arm, stray)
    notes = [*frame.notes, *doubts]
    files = save_frame(frame, services.folder)
    services.cache_photo(round_depth_as_saved(frame, state["scene_path"]))
    summary = {"camera": frame.camera, "noise": noise.at_one_metre}
    services.log.append(SceneStage(stage="frame", summary=summary, files=files))
    for note in frame.notes:
        services.log.append(Note(level="warning", text=note))
    return {"notes": notes, "image": files["rgb"], "camera": frame.camera}


def find_recorded_camera(events: Sequence[Event], source: str) -> Camera:
    """The camera of a run's photo, by its events. Raises InputError if they hold none."""
    for event in events:
        if isinstance(event, SceneStage) and event.stage == "frame":
            try:
                return Camera.model_validate(event.summary.get("camera"))
            except ValidationError as error:
                problem = f"{source}: the camera of its photo: {error.errors(include_url=False)[0]['msg']}"
                raise InputError(problem, "name the photo instead") from error
    raise InputError(f"{source} does not hold the camera of its photo", "name the photo instead")


def _require_scene_of_user(source: Path, services: Services) -> None:
    """Raise InputError if only the run folder, which may be foreign, names a scene outside of itself."""
    inside = Path(os.path.realpath(split_choice(source)[0])).is_relative_to(services.folder)
    if not services.recorded_source or is_sample_scene(source) or (inside and not is_bop_source(source)):
        return
    again = shlex.join(["grs", "run", str(source), "--out", str(services.folder), "--resume"])
    found = f"{services.folder} alone names the scene {source}, which lies outside of it"
    raise InputError(found, f"if you mean that scene, name it: {again}")


def next_step_after_read(state: RunState) -> Literal["find_table", "edit", "done"]:
    """The edge after ``read``: a known scene ends perception, or is edited."""
    return next_step_after_settle(state) if state.get("scene") else "find_table"


def next_step_after_settle(state: RunState) -> Literal["edit", "done"]:
    """The edge after ``settle``: a scene with edits is corrected."""
    return "edit" if "edits" in state else "done"


@logged_node("find_table")
def find_table(state: RunState, services: Services) -> Update:
    """Find the table's plane and its frame; the robot is placed once the objects are known."""
    config, frame = services.config, services.load_photo(state)
    table = find_table_in_frame(frame, np.random.default_rng(config.seed), config.scene.table)
    if "edits" in state and (chosen := state["edits"].table) is not None:
        number = plane_number_at(frame, table, chosen.point)
        table = find_table_in_frame(frame, np.random.default_rng(config.seed), number)
    return {"table": table, "notes": [*state["notes"], *describe_table_doubts(table)]}


@logged_node("segment")
def segment_photo(state: RunState, services: Services) -> Update:
    """Segment the objects on the table into candidates, and place the robot in front of them."""
    (frame, table), config = _load_photo_and_table(state, services), services.config
    if config.tools.segment != ToolsConfig().segment:  # another tool may read masks beside the photo
        _require_scene_of_user(frame.source, services)
    robot = robot_pixel_mask(frame, services.robot_name_or_path, services.library, services.config.hand)
    # Settings at their default are left out, so that a tool need not have fields for them.
    settings = {"model": None, **config.segment.model_dump(exclude_defaults=True)}
    tool_notes: list[str] = []

    def segment(photo: RGBDFrame) -> Sequence[Candidate]:
        result = services.run_tool(config.tools.segment, frame=photo, table=table, **settings)
        tool_notes[:] = getattr(result, "notes", ())
        return result.candidates

    found = find_objects(frame, table, robot, segment)
    if not found.objects:
        problem = f"{state['scene_path']}: nothing on the table is an object: {'; '.join(sorted(set(found.reasons)))}"
        remedy = "put objects onto the table, away from the picture's border"
        if table.origin == "calibrated":
            remedy = f"clear T_robot_cam (x forward, y left, z up, from the robot's base) of mistakes, or {remedy}"
        raise InputError("; ".join([problem, *describe_table_doubts(table)]), remedy)
    for name, mask in ((LEFT_OUT, found.left_out), (ROBOT, robot), (BLUR, found.blur)):
        write_png(services.folder / name, mask.astype(np.uint8) * 255)
    table, candidates = center_objects_in_workspace(table, found.objects)
    records = save_candidates(frame, candidates, services.folder)
    boxes = [{"id": record.id, "name": f"candidate {record.id}", "box": record.box} for record in records]
    camera = state["camera"].model_copy(update={"T_robot_cam": table.T_robot_cam})
    services.log.append(
        SceneStage(
            stage="segmented",
            summary={"camera": camera, "table": table, "objects": boxes},
            files={
                "rgb": "scene/rgb.png",
                "depth": "scene/depth.png",
                "masks": "scene/masks.png",
                "annotated": "scene/annotated.png",
            },
        )
    )
    background, notes = build_background_asset(frame, table, candidates, robot, services)
    return {
        "notes": [*state["notes"], *tool_notes, *notes],
        "background": background,
        "table": table,
        "left_out": LEFT_OUT,
        "robot": ROBOT,
        "blur": BLUR,
        "objects": [TableObject.from_record(record) for record in records],
        "dropped": [DroppedCandidate(id=0, reason=reason) for reason in found.reasons],
    }


@logged_node("describe")
def describe_candidates(state: RunState, services: Services) -> Update:
    """Describe each pending object (paper, Scene Comprehension, step 2), and join pieces of the same object."""
    objects, dropped = state["objects"], state["dropped"]
    pending = select_pending(objects, dropped)
    first_free = max(item.id for item in objects) + 1
    described = describe_segments(pending, first_free, _load_photo_and_table(state, services), services)
    summary = {str(number): words for number, words in described.descriptions.items()}
    services.log.append(SceneStage(stage="described", summary=summary))
    earlier = [item for item in objects if item not in pending]
    return {
        "objects": [*earlier, *described.objects],
        "dropped": [*dropped, *described.dropped],
        "notes": [*state["notes"], *described.notes],
    }


@logged_node("match")
def match_candidates_to_assets(state: RunState, services: Services) -> Update:
    """Match each pending object with an asset (paper, Scene Comprehension, step 3)."""
    photo, pending = _load_photo_and_table(state, services), select_pending(state["objects"], state["dropped"])
    pending, notes = match_objects(pending, photo, state["image"], services)
    matched = {item.id: item for item in pending}
    return {
        "objects": [matched.get(item.id, item) for item in state["objects"]],
        "notes": [*state["notes"], *notes],
    }


@logged_node("register")
def register_assets_in_photo(state: RunState, services: Services) -> Update:
    """Place each pending object: its asset registered to the photo, or a proxy.

    In the first pass, segments that the placed assets leave unexplained become pending for a second pass.
    """
    objects, dropped = state["objects"], list(state["dropped"])
    photo = _load_photo_and_table(state, services)
    is_first_pass = not any(item.placed for item in objects)
    masks = _load_masks(objects, services)
    names = [item.placed.name for item in objects if item.placed]
    pending: list[TableObject] = []
    reasons, notes = explain_rejected_objects(select_pending(objects, dropped), is_first_pass, services)
    for item in select_pending(objects, dropped):
        if reason := reasons[item.id]:
            dropped.append(DroppedCandidate(id=item.id, reason=reason))
        else:
            taken = [*names, *(other.scene_object.name for other in pending)]
            pending.append(place_asset_or_proxy(item, services, taken))
    registered = register_objects(pending, masks, photo, services)
    fitting, misfits, remarks = replace_misfit_assets(registered, names, masks, photo, services)
    dropped += misfits
    placed = {item.id: raise_confidence_of_fit(item) for item in fitting}
    objects = [placed.get(item.id, item) for item in objects]
    if is_first_pass:
        residual, divided = add_residual_candidates(
            [item.placed for item in objects if item.placed], objects, masks, *photo, services.library, services.folder
        )
        dropped += divided
        gone = {item.id for item in divided}
        objects = [item.model_copy(update={"placed": None}) if item.id in gone else item for item in objects]
        objects += [TableObject.from_record(record) for record in residual]
    return {"objects": objects, "dropped": dropped, "notes": [*state["notes"], *notes, *remarks]}


def next_step_after_register(state: RunState) -> Literal["describe", "settle"]:
    """The edge after ``register``: residual segments are described, else the placed objects settle."""
    state = parse_state(state)
    return "describe" if select_pending(state["objects"], state["dropped"]) else "settle"


@logged_node("settle")
def settle_objects(state: RunState, services: Services) -> Update:
    """Resolve collisions, let the objects come to rest in MuJoCo, and write ``scene.json``."""
    photo, table = _load_photo_and_table(state, services)
    config, folder, assets = services.config.scene, services.folder, services.folder / "assets"
    objects = state["objects"]
    masks = _load_masks(objects, services)
    if "left_out" in state:
        left_out, blur = (load_mask(folder / state[name]) for name in ("left_out", "blur"))
        robot = load_mask(folder / state["robot"]) if "robot" in state else None
        above = raised_pixel_mask(photo, table, left_out, robot) & ~blur
    else:
        above = raised_pixel_mask(photo, table)
    settled = settle_scene([item for item in objects if item.placed], masks, (photo, table), above, services)
    dropped = (*state["dropped"], *settled.dropped)
    coverage = None
    if settled.owned is not None:
        rejected = [(masks[item.id], item.reason) for item in dropped if item.id in masks]
        coverage = measure_coverage(photo, table, above, settled.owned, rejected).write(photo, folder)
    far = [
        f"{item.name} at x = {item.position[0]:.2f}, y = {item.position[1]:.2f} m is out of the arm's reach"
        for item in settled.objects
        if not item.reachable
    ]
    warnings = [*state["notes"], *settled.warnings, *far]
    if coverage is not None and coverage.share < config.coverage.warn:
        warnings = [describe_coverage(coverage), *warnings]
    _log_warnings(warnings, services)
    if not settled.objects:
        found = f"{state['scene_path']}: none of {len(objects)} segments is an object"
        raise InputError(
            "; ".join([found, *describe_table_doubts(table)]),
            "put objects of at least 2 cm on the table, or name another model for describe and match",
        )
    hidden = np.any([above, *(masks[item.id] for item in settled.objects)], axis=0)
    scene = SceneDescription(
        source=state["scene_path"],
        image=state["image"],
        frame=table,
        objects=settled.objects,
        dropped=dropped,
        warnings=tuple(warnings),
        background=state.get("background") or None,
        relations=settled.relations,
        twin=settled.twin,
        camera=photo.camera.intrinsics,
        table_color=measure_table_color(photo, table),
        table_texture=write_table_texture(photo, table, hidden, assets),
        coverage=coverage,
    )
    scene = prepare_scene_for_tasks_with_warnings(scene, services)
    scene.write(folder / "scene.json")
    files = save_twin_picture(scene, services.library, folder)
    files |= {} if coverage is None else {"coverage": coverage.picture}
    services.log.append(SceneStage(stage="matched", summary=dict(scene), files=files))
    if "edits" not in state:
        require_movable_object(scene, services.arm)
    named = draw_object_names(photo, {item.name: masks[item.id] for item in scene.objects}, folder)
    return {"scene": scene, "image": named}


def log_edits(scene: SceneDescription, log: EventLog) -> None:
    """Log a note for each edit of a corrected scene."""
    for line in scene.edits:
        log.append(Note(text=f"corrected by a person: {line}"))


def prepare_scene_for_tasks_with_warnings(scene: SceneDescription, services: Services) -> SceneDescription:
    """Hold or leave out the objects that the world of the tasks does not bear, with a warning for each."""
    try:
        scene = prepare_scene_for_tasks(scene, services.library, services.robot_name_or_path, services.config.hand)
    except GrsError as error:
        _log_warnings([f"whether all stays at rest is not known: {error.message}"], services)
    held = [item.name for item in scene.objects if item.held]
    left_out = [item.name for item in scene.objects if item.stands_in_robot]
    warnings: list[str] = []
    if held:
        warnings.append(f"held where the photo shows them, because they would fall: {', '.join(held)}")
    if left_out:
        warnings.append(f"left out of the tasks, because the robot stands there: {', '.join(left_out)}")
    _log_warnings(warnings, services)
    return scene.model_copy(update={"warnings": (*scene.warnings, *warnings)})


def require_movable_object(scene: SceneDescription, arm: Arm) -> None:
    """Raises InputError if the arm can reach, pick and move no object of the scene: no task can be set there."""
    movable = [item for item in scene.objects if item.reachable and not item.held]
    if any(not item.pick_trouble for item in movable):
        return
    if movable:
        reasons = [f"{item.name}: {item.pick_trouble}" for item in movable[:NAMED_OBJECTS]]
        raise InputError(
            f"{scene.source}: the robot can pick none of {len(scene.objects)} objects: {'; '.join(reasons)}; "
            f"it reaches {arm.describe_reach()}",
            "choose another robot or hand, or put objects there that it reaches and holds",
        )
    reasons = [
        f"{item.name} at x = {item.position[0]:.2f}, y = {item.position[1]:.2f} m "
        + ("would fall" if item.held else "is in the robot" if item.stands_in_robot else "is out of reach")
        for item in scene.objects[:NAMED_OBJECTS]
    ]
    raise InputError(
        f"{scene.source}: the arm can reach and move none of {len(scene.objects)} objects: {', '.join(reasons)}",
        "put objects in the middle of the table, 0.25 to 0.75 m before the robot if T_robot_cam is given",
    )


@logged_node("hide_image")
def hide_image(state: RunState, services: Services) -> Update:
    """Keep the scene image from the authors (ablation ``LLM``)."""
    return {"image": ""}


def _load_photo_and_table(state: RunState, services: Services) -> Photo:
    return services.load_photo(state), state["table"]


def _load_masks(objects: Sequence[TableObject], services: Services) -> dict[int, Mask]:
    return {item.id: load_mask(services.folder / item.mask) for item in objects}


def _log_warnings(warnings: Sequence[str], services: Services) -> None:
    for warning in warnings:
        services.log.append(Note(level="warning", text=warning))
