"""The nodes of perception, from a photo to a scene at rest in MuJoCo (paper, Scene Comprehension).

The background of the photo becomes an asset of the run.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from grs_agents.agents.types import Description
from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.foreign.run_folder import find_member_file
from grs_agents.base.trace.events import Note, SceneStage
from grs_agents.base.trace.log import read_events
from grs_agents.graph.asset_matching import run_match_tool
from grs_agents.graph.bystanders import prepare_scene_for_tasks
from grs_agents.graph.describing import describe_segments
from grs_agents.graph.scene_object_building import (
    MatchedCandidate,
    explain_why_no_scene_object,
    place_asset_or_proxy,
    raise_confidence_of_fit,
    replace_misfit_assets,
)
from grs_agents.graph.scene_settling import SettledScene, settle_scene
from grs_agents.graph.services import Photo, Services, Update, logged_node
from grs_agents.graph.state import RunState
from grs_agents.library.background_asset import write_background_asset
from grs_agents.perception.annotated_pictures import NAMED, draw_object_names
from grs_agents.perception.background_reconstruction import reconstruct_background
from grs_agents.perception.coverage import describe_coverage, measure_coverage, raised_pixel_mask
from grs_agents.perception.depth_alignment import describe_depth_shift
from grs_agents.perception.depth_noise import measure_depth_noise, smooth_depth_noise
from grs_agents.perception.object_finding import find_objects
from grs_agents.perception.picture_files import load_mask, round_depth_as_saved, save_candidates, save_frame, write_png
from grs_agents.perception.reading.foreign_scene import read_foreign_scene
from grs_agents.perception.reading.known_scene import copy_scene_from_run, is_known_scene
from grs_agents.perception.reading.photo_without_depth import DepthEstimate, Estimator
from grs_agents.perception.registration.scene_registration import add_residual_candidates, register_objects
from grs_agents.perception.robot_pixels import render_robot_depth, require_joints_within_limits, robot_pixel_mask
from grs_agents.perception.segmentation.candidates import center_objects_in_workspace
from grs_agents.perception.stray_light import measure_stray_light, remove_stray_light
from grs_agents.perception.table_color import measure_table_color
from grs_agents.perception.table_finding import describe_table_doubts
from grs_agents.perception.table_finding import find_table as table_in
from grs_agents.perception.table_texture import write_table_texture
from grs_agents.perception.twin_picture import save_twin_picture
from grs_agents.perception.types import (
    Candidate,
    CandidateRecord,
    Coverage,
    DroppedCandidate,
    Image,
    Mask,
    MatchEvidence,
    RGBDFrame,
    SceneDescription,
    SceneObject,
    TableFrame,
)
from grs_agents.sim.world.compilation import compute_arm_spheres_at_home

LEFT_OUT, ROBOT, BLUR = "scene/left_out.png", "scene/robot.png", "scene/blur.png"


def build_background_asset(
    frame: RGBDFrame, table: TableFrame, candidates: Sequence[Candidate], robot: Mask, services: Services
) -> tuple[str, list[str]]:
    """Reconstruct what is left of a photo, if the configuration says so, and write it beside the proxies of the run.

    ``robot`` (H, W) are the pixels that show the robot, which is no background.

    Returns:
        The library name of the background, empty without one, and what a reader of the scene should know.
    """
    asked = services.config.background
    if not asked.on:
        return "", []
    objects = robot.copy()
    for candidate in candidates:
        objects |= candidate.mask
    arm = compute_arm_spheres_at_home(services.robot_name_or_path, services.library)
    background = reconstruct_background(
        frame, table, objects, [candidate.box for candidate in candidates], arm, asked.voxel
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
    """Read the RGB-D photo and write it into the run folder; all later nodes work on what was written.

    Where the source is a run folder, its scene is taken over as it is, and there is nothing left to perceive.
    """
    source = Path(state["scene_path"])
    if is_known_scene(source):
        return _copy_scene_of_other_run(source, services)
    frame = read_foreign_scene(source, _make_depth_estimator(services), services.config.depth.field_of_view)
    noise = measure_depth_noise(frame)
    frame = smooth_depth_noise(frame, noise)
    doubts = [*describe_depth_shift(frame), *_check_robot_joints(frame, services)]
    frame = _take_out_stray_light(frame, services)
    notes = [*frame.notes, *doubts]
    files = save_frame(frame, services.folder)
    services.cache_photo(round_depth_as_saved(frame, state["scene_path"]))
    camera = frame.camera.model_dump(mode="json")
    summary = {"camera": camera, "noise": noise.at_one_metre}
    services.log.append(SceneStage(stage="frame", summary=summary, files=files))
    return {"notes": notes, "image": files["rgb"], "camera": camera}


def _copy_scene_of_other_run(source: Path, services: Services) -> Update:
    scene = copy_scene_from_run(source, services.folder, services.config.robot)
    for event in read_events(source / "events.jsonl"):
        if isinstance(event, SceneStage):
            services.log.append(SceneStage(stage=event.stage, summary=event.summary, files=event.files))
    services.log.append(Note(text=f"the scene is that of {source}, as it was made there"))
    require_scene_coverage(scene, services.config.scene.coverage.refuse, services.folder)
    named = find_member_file(services.folder, NAMED)
    return {"scene": scene.model_dump(mode="json"), "image": scene.image if named is None else NAMED}


def next_step_after_read(state: RunState) -> Literal["find_table", "done"]:
    """Whether there is a photo to look at, or the scene is known."""
    return "done" if state.get("scene") else "find_table"


@logged_node("find_table")
def find_table(state: RunState, services: Services) -> Update:
    """Find the table's plane and lay a frame on it; the robot is placed once the objects are known."""
    config = services.config
    table = table_in(services.load_photo(state), np.random.default_rng(config.seed), config.scene.table)
    return {"table": table.model_dump(mode="json"), "notes": [*state["notes"], *describe_table_doubts(table)]}


@logged_node("segment")
def segment_photo(state: RunState, services: Services) -> Update:
    """Segment what stands on the table into candidates, and place the robot in front of them."""
    frame, config, table = services.load_photo(state), services.config, _table_from_state(state)
    robot = robot_pixel_mask(frame, services.robot_name_or_path, services.library)
    # What is not set is not told, so that a tool need not take it.
    told = {"model": None, **config.segment.model_dump(exclude_defaults=True)}
    said: list[str] = []

    def segment(photo: RGBDFrame) -> Sequence[Candidate]:
        result = services.run_tool(config.tools.segment, frame=photo, table=table, **told)
        said[:] = getattr(result, "notes", ())
        return result.candidates

    found = find_objects(frame, table, robot, segment)
    if not found.objects:
        raise InputError(
            f"{state['scene_path']}: nothing on the table is an object: {'; '.join(sorted(set(found.reasons)))}",
            "clear T_robot_cam (x forward, y left, z up, from the robot's base) of mistakes, or put objects before it",
        )
    for name, mask in ((LEFT_OUT, found.left_out), (ROBOT, robot), (BLUR, found.blur)):
        write_png(services.folder / name, mask.astype(np.uint8) * 255)
    table, candidates = center_objects_in_workspace(table, found.objects)
    records = save_candidates(frame, candidates, services.folder)
    boxes = [{"id": record.id, "name": f"candidate {record.id}", "box": record.box.model_dump()} for record in records]
    camera = {**state["camera"], "T_robot_cam": table.T_robot_cam}
    services.log.append(
        SceneStage(
            stage="segmented",
            summary={"camera": camera, "table": table.model_dump(mode="json"), "objects": boxes},
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
        "notes": [*state["notes"], *said, *notes],
        "background": background,
        "table": table.model_dump(mode="json"),
        "candidates": [record.model_dump(mode="json") for record in records],
        "pending": [record.id for record in records],
        "left_out": LEFT_OUT,
        "robot": ROBOT,
        "blur": BLUR,
        "dropped": [DroppedCandidate(id=0, reason=reason).model_dump(mode="json") for reason in found.reasons],
    }


@logged_node("describe")
def describe_candidates(state: RunState, services: Services) -> Update:
    """Ask the describer about each pending candidate (paper, Scene Comprehension, step 2); pieces become one."""
    first_free = max(record["id"] for record in state["candidates"]) + 1
    photo = _load_photo_and_table(state, services)
    found = describe_segments(_pending_candidates_from_state(state), first_free, photo, services)
    descriptions = {str(number): said.model_dump(mode="json") for number, said in found.descriptions.items()}
    services.log.append(SceneStage(stage="described", summary=descriptions))
    others = [record for record in state["candidates"] if record["id"] not in state["pending"]]
    return {
        "candidates": [*others, *(record.model_dump(mode="json") for record in found.records)],
        "pending": [record.id for record in found.records],
        "descriptions": {**state.get("descriptions", {}), **descriptions},
        "dropped": [*state.get("dropped", ()), *(piece.model_dump(mode="json") for piece in found.dropped)],
        "notes": [*state["notes"], *found.notes],
    }


@logged_node("match")
def match_candidates_to_assets(state: RunState, services: Services) -> Update:
    """Match each pending candidate that is an object with an asset (paper, Scene Comprehension, step 3)."""
    result = run_match_tool(_pending_candidates_from_state(state), _descriptions_from_state(state), state, services)
    matches = {str(number): answer.model_dump(mode="json") for number, answer in result.matches.items()}
    return {"matches": {**state.get("matches", {}), **matches}, "notes": [*state["notes"], *result.notes]}


@logged_node("register")
def register_assets_in_photo(state: RunState, services: Services) -> Update:
    """Place each pending candidate's asset where the photo shows it; what no asset stands for becomes a proxy.

    In the first pass, what the placed assets do not explain of the segments becomes the candidates of a second pass.
    """
    records = [CandidateRecord.model_validate(item) for item in state["candidates"]]
    objects = [SceneObject.model_validate(item) for item in state.get("objects", ())]
    placed, dropped = _convert_candidates_to_objects(_pending_candidates_from_state(state), objects, state, services)
    objects += placed
    dropped = [*(DroppedCandidate.model_validate(item) for item in state.get("dropped", ())), *dropped]
    residual: tuple[CandidateRecord, ...] = ()
    if len(state["pending"]) == len(records):  # the first pass
        residual, divided = add_residual_candidates(
            objects, records, *_load_photo_and_table(state, services), services.library, services.folder
        )
        dropped += divided
        objects = [item for item in objects if item.id not in {gone.id for gone in divided}]
    return {
        "candidates": [record.model_dump(mode="json") for record in (*records, *residual)],
        "pending": [record.id for record in residual],
        "objects": [item.model_dump(mode="json") for item in objects],
        "dropped": [item.model_dump(mode="json") for item in dropped],
    }


def next_step_after_register(state: RunState) -> Literal["describe", "settle"]:
    """Whether there are residual candidates to describe, or all objects are placed."""
    return "describe" if state["pending"] else "settle"


def _raised_pixels(state: RunState, photo: Photo, services: Services) -> Mask:
    """(H, W) what rises above the table, and may be an object."""
    if "left_out" not in state:
        return raised_pixel_mask(*photo)
    left_out, blur = (load_mask(services.folder / state[name]) for name in ("left_out", "blur"))
    robot = load_mask(services.folder / state["robot"]) if "robot" in state else None
    return raised_pixel_mask(*photo, left_out, robot) & ~blur


@logged_node("settle")
def settle_objects(state: RunState, services: Services) -> Update:
    """Resolve collisions, let the objects come to rest in MuJoCo, and write ``scene.json``."""
    photo, table = _load_photo_and_table(state, services)
    records = [CandidateRecord.model_validate(item) for item in state["candidates"]]
    above = _raised_pixels(state, (photo, table), services)
    settled = settle_scene(
        [SceneObject.model_validate(item) for item in state["objects"]], records, (photo, table), above, services
    )
    dropped = (*(DroppedCandidate.model_validate(item) for item in state["dropped"]), *settled.dropped)
    coverage = None
    if settled.owned is not None:
        rejected = _load_rejected_masks(dropped, records, services)
        coverage = measure_coverage(photo, table, above, settled.owned, rejected).write(photo, services.folder)
    warnings = _list_scene_warnings(state, settled, coverage, services)
    for warning in warnings:
        services.log.append(Note(level="warning", text=warning))
    if not settled.objects:
        raise _no_object_error(state, table)
    hidden = above.copy()
    for item in settled.objects:
        hidden |= load_mask(services.folder / item.mask)
    texture = write_table_texture(photo, table, hidden, services.folder / "assets")
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
        table_texture=texture,
        coverage=coverage,
    )
    scene = _prepare_scene_for_tasks(scene, services)
    scene.write(services.folder / "scene.json")
    files = save_twin_picture(scene, services.library, services.folder)
    files |= {} if coverage is None else {"coverage": coverage.picture}
    services.log.append(SceneStage(stage="matched", summary=scene.model_dump(mode="json"), files=files))
    require_scene_coverage(scene, services.config.scene.coverage.refuse, services.folder)
    masks = {item.name: load_mask(services.folder / item.mask) for item in scene.objects}
    named = draw_object_names(photo, masks, services.folder)
    return {"scene": scene.model_dump(mode="json"), "image": named}


def _list_scene_warnings(
    state: RunState, settled: SettledScene, coverage: Coverage | None, services: Services
) -> list[str]:
    """What a reader of the scene should know."""
    far = [
        f"{item.name} at x = {item.position[0]:.2f}, y = {item.position[1]:.2f} m is out of the arm's reach"
        for item in settled.objects
        if not item.reachable
    ]
    warnings = [*state["notes"], *settled.warnings, *far]
    if coverage is not None and coverage.share < services.config.scene.coverage.warn:
        warnings.append(describe_coverage(coverage))
    return warnings


def _load_rejected_masks(
    dropped: Sequence[DroppedCandidate], records: Sequence[CandidateRecord], services: Services
) -> list[tuple[Mask, str]]:
    """The pixels (H, W) of the segments that are no objects, and why they are none."""
    files = {record.id: record.mask for record in records}
    return [(load_mask(services.folder / files[one.id]), one.reason) for one in dropped if one.id in files]


def _no_object_error(state: RunState, table: TableFrame) -> InputError:
    found = f"{state['scene_path']}: none of {len(state['candidates'])} segments is an object"
    return InputError(
        "; ".join([found, *describe_table_doubts(table)]),
        "put objects of at least 2 cm on the table, or name another model for describe and match",
    )


def require_scene_coverage(scene: SceneDescription, bound: float, folder: Path) -> None:
    """Raises InputError: too much of what rises above the table belongs to no object.

    A scene of before coverage was measured is accepted.
    """
    if scene.coverage is not None and scene.coverage.share < bound:
        raise InputError(
            f"{scene.source}: {describe_coverage(scene.coverage)}; scene.coverage.refuse is {bound:g}",
            f"look at {folder / scene.coverage.picture}; clear away what is no object, give its mask "
            "(tools.segment=segment_masks), or set scene.coverage.refuse lower",
        )


def _prepare_scene_for_tasks(scene: SceneDescription, services: Services) -> SceneDescription:
    """The scene as the world of its tasks bears it; its warnings tell what had to change."""
    try:
        scene = prepare_scene_for_tasks(scene, services.library, services.robot_name_or_path)
    except GrsError as error:
        services.log.append(Note(level="warning", text=f"whether all stays at rest is not known: {error.message}"))
    warnings = [
        f"{why}: {', '.join(names)}"
        for why, names in (
            ("held where the photo shows them, because they would fall", [o.name for o in scene.objects if o.held]),
            (
                "left out of the tasks, because the robot stands there",
                [item.name for item in scene.objects if item.stands_in_robot],
            ),
        )
        if names
    ]
    for warning in warnings:
        services.log.append(Note(level="warning", text=warning))
    return scene.model_copy(update={"warnings": (*scene.warnings, *warnings)})


def _convert_candidates_to_objects(
    records: Sequence[CandidateRecord], others: Sequence[SceneObject], state: RunState, services: Services
) -> tuple[tuple[SceneObject, ...], list[DroppedCandidate]]:
    """The candidates as objects with an asset or proxy where the photo shows them, and those that are no object."""
    if not records:
        return (), []
    photo = _load_photo_and_table(state, services)
    descriptions = _descriptions_from_state(state)
    matches = {int(number): MatchEvidence.model_validate(match) for number, match in state["matches"].items()}
    dropped: list[DroppedCandidate] = []
    objects: list[SceneObject] = []
    for record in records:
        answer = MatchedCandidate(record, descriptions[record.id], matches.get(record.id))
        if reason := explain_why_no_scene_object(answer, services.config.match.proxies):
            dropped.append(DroppedCandidate(id=record.id, reason=reason))
        else:
            objects.append(place_asset_or_proxy(answer, services, [other.name for other in (*others, *objects)], photo))
    by_number = {record.id: record for record in records}
    names = [other.name for other in others]
    registered = register_objects(objects, records, *photo, services.library, services.folder)
    placed, mismatched = replace_misfit_assets(registered, by_number, names, photo, services)
    return tuple(raise_confidence_of_fit(one) for one in placed), [*dropped, *mismatched]


def _table_from_state(state: RunState) -> TableFrame:
    return TableFrame.model_validate(state["table"])


def _load_photo_and_table(state: RunState, services: Services) -> Photo:
    return services.load_photo(state), _table_from_state(state)


def _pending_candidates_from_state(state: RunState) -> list[CandidateRecord]:
    """The candidates of this pass."""
    return [
        CandidateRecord.model_validate(record) for record in state["candidates"] if record["id"] in state["pending"]
    ]


def _descriptions_from_state(state: RunState) -> dict[int, Description]:
    return {
        int(number): Description.model_validate(description) for number, description in state["descriptions"].items()
    }


@logged_node("hide_image")
def hide_image(state: RunState, services: Services) -> Update:
    """Keep the scene image from the authors (ablation ``LLM``)."""
    return {"image": ""}


def _check_robot_joints(frame: RGBDFrame, services: Services) -> list[str]:
    """What a reader should know about the joints in a photo's camera; raises InputError if the arm cannot be there."""
    joints = frame.camera.joints
    if joints is None:
        return []
    require_joints_within_limits(joints, services.robot_name_or_path)
    lacks = "camera.json: joints is not used: where the robot is seen is not known without T_robot_cam"
    return [lacks] if frame.camera.T_robot_cam is None else []


def _take_out_stray_light(frame: RGBDFrame, services: Services) -> RGBDFrame:
    """The frame without the light that a known robot scatters into the depth of what is beside it."""
    if not frame.camera.arm_is_known:
        return frame
    arm = render_robot_depth(frame, services.robot_name_or_path, services.library)
    if not np.isfinite(arm).any():
        return frame
    table = table_in(frame, np.random.default_rng(services.config.seed), services.config.scene.table)
    stray = measure_stray_light(frame, table, arm)
    return frame if stray is None else remove_stray_light(frame, arm, stray)


def _make_depth_estimator(services: Services) -> Estimator:
    """Asks the configured depth tool, if the scene turns out to have no depth."""

    def run_depth_tool(rgb: Image, focal: float | None, photo: str) -> DepthEstimate:
        config = services.config
        return services.run_tool(config.tools.depth, rgb=rgb, focal=focal, photo=photo, model=config.depth.model)

    return run_depth_tool
