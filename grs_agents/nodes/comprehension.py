"""The comprehension nodes: segment the photo; describe and match each candidate (paper, Scene Comprehension)."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from grs_agents.agents import Description, NoReply, roles
from grs_agents.errors import InputError
from grs_agents.nodes.background import stand_in
from grs_agents.nodes.corresponding import correspond, measurements
from grs_agents.nodes.fitting import fitting
from grs_agents.nodes.matching import Matched, dropped, object_of
from grs_agents.nodes.registering import registered, seen_later
from grs_agents.nodes.services import Services, Update, node
from grs_agents.nodes.standing import stand
from grs_agents.scene import (
    Camera,
    CandidateRecord,
    DepthEstimate,
    DroppedCandidate,
    Estimator,
    Image,
    SceneDescription,
    SceneObject,
    TableFrame,
    find_table,
    load_frame,
    place_robot,
    read_scene,
    save_candidates,
    save_frame,
)
from grs_agents.state import RunState
from grs_agents.trace import Note, SceneStage


@node
def comprehend(state: RunState, services: Services) -> Update:
    """Find the table and the candidates in the photo, and lay the robot frame."""
    frame = read_scene(Path(state["scene_path"]), _estimator(services), services.config.depth.field_of_view)
    files = save_frame(frame, services.folder)
    camera = frame.camera.model_dump(mode="json")
    services.log.append(SceneStage(stage="frame", summary={"camera": camera}, files=files))
    table = find_table(frame, np.random.default_rng(services.config.seed))
    config = services.config
    found = services.tool(config.tools.segment, frame=frame, table=table, model=config.segment.model).candidates
    table, candidates = place_robot(table, found)
    records = save_candidates(frame, candidates, services.folder)
    boxes = [{"id": one.id, "name": f"candidate {one.id}", "box": one.box.model_dump()} for one in records]
    placed = {**camera, "T_robot_cam": table.T_robot_cam}
    services.log.append(
        SceneStage(
            stage="segmented",
            summary={"camera": placed, "table": table.model_dump(mode="json"), "objects": boxes},
            files={**files, "masks": "scene/masks.png", "annotated": "scene/annotated.png"},
        )
    )
    background, notes = stand_in(frame, table, candidates, services)
    return {
        "notes": [*frame.notes, *notes],
        "background": background,
        "image": files["rgb"],
        "camera": camera,
        "frame": table.model_dump(mode="json"),
        "candidates": [record.model_dump(mode="json") for record in records],
    }


@node
def match(state: RunState, services: Services) -> Update:
    """Describe each candidate and match it with an asset; what no asset matches becomes a primitive proxy."""
    records = [CandidateRecord.model_validate(one) for one in state["candidates"]]
    table = TableFrame.model_validate(state["frame"])
    warnings = list(state.get("notes", []))
    warnings += [table.note] if table.origin == "calibrated" and table.note else []
    objects: list[SceneObject] = []
    lost = _understood(records, state, services, objects, warnings)
    later, divided = seen_later(objects, records, state, services)
    lost += divided
    objects = [one for one in objects if one.id not in {gone.id for gone in divided}]
    lost += _understood(later, state, services, objects, warnings)
    records += later
    stood = stand(objects, records, state, services)
    objects, warnings, lost = list(stood.objects), [*warnings, *stood.warnings], [*lost, *stood.dropped]
    warnings += [
        f"{one.name} at x = {one.position[0]:.2f}, y = {one.position[1]:.2f} m is out of the arm's reach"
        for one in objects
        if not one.reachable
    ]
    for warning in warnings:
        services.log.append(Note(level="warning", text=warning))
    if not objects:
        raise InputError(
            f"{state['scene_path']}: none of {len(records)} segments is an object",
            "put objects of at least 2 cm on the table, or name another model for describe and match",
        )
    scene = SceneDescription(
        source=state["scene_path"],
        image=state["image"],
        frame=table,
        objects=tuple(objects),
        dropped=tuple(lost),
        warnings=tuple(warnings),
        background=state.get("background") or None,
        relations=stood.relations,
        twin=stood.twin,
    )
    scene.write(services.folder / "scene.json")
    services.log.append(SceneStage(stage="matched", summary=scene.model_dump(mode="json")))
    return {"scene": scene.model_dump(mode="json")}


def _understood(
    records: Sequence[CandidateRecord],
    state: RunState,
    services: Services,
    objects: list[SceneObject],
    warnings: list[str],
) -> list[DroppedCandidate]:
    """Describe and match candidates, and add them to ``objects`` where the photo shows them; tell what is none."""
    if not records:
        return []
    described = {one.id: _described(one, state["image"], services, warnings) for one in records}
    summary = {str(number): one.model_dump(mode="json") for number, one in described.items()}
    services.log.append(SceneStage(stage="described", summary=summary))
    lost: list[DroppedCandidate] = []
    new: list[SceneObject] = []
    frame = load_frame(services.folder, Camera.model_validate(state["camera"]), state["scene_path"])
    photo = (frame, TableFrame.model_validate(state["frame"]))
    answers = correspond(records, described, frame, state, services)
    warnings += answers.notes
    for record in records:
        found = Matched(record, described[record.id], answers.matches.get(record.id))
        if reason := dropped(found, services.config.match.proxies):
            lost.append(DroppedCandidate(id=record.id, reason=reason))
        else:
            new.append(object_of(found, services, [one.name for one in (*objects, *new)], photo))
    placed, unlike = fitting(
        registered(new, records, state, services), {one.id: one for one in records},
        [one.name for one in objects], photo, services,
    )  # fmt: skip
    objects += placed
    return [*lost, *unlike]


@node
def hide_image(state: RunState, services: Services) -> Update:
    """Keep the scene image from the authors (ablation ``LLM``)."""
    return {"image": ""}


def _estimator(services: Services) -> Estimator:
    """Asks the configured depth tool, if the scene turns out to have no depth."""

    def estimate(rgb: Image, focal: float | None, photo: str) -> DepthEstimate:
        config = services.config
        return services.tool(config.tools.depth, rgb=rgb, focal=focal, photo=photo, model=config.depth.model)

    return estimate


def _described(record: CandidateRecord, image: str, services: Services, warnings: list[str]) -> Description:
    reply = roles.describe(services.agents, measurements(record), [record.crop, image])
    if not isinstance(reply, NoReply):
        return reply
    warnings.append(f"candidate {record.id}: {reply}")
    return _undescribed(record)


def _undescribed(record: CandidateRecord) -> Description:
    """Stands in where the describer gave no usable reply: what was measured, and nothing else."""
    return Description(
        is_object=True,
        description=f"an undescribed {record.shape}",
        color="unknown",
        shape=record.shape,
        category="object",
    )
