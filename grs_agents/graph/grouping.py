"""The node that lets a model which sees the numbered photo regroup the segments."""

from typing import Any, Literal

import numpy as np

from grs_agents.agents import roles
from grs_agents.agents.types import NoReply
from grs_agents.base.trace.events import SceneStage
from grs_agents.graph.perceive import build_background_asset
from grs_agents.graph.recognition import list_adjoining
from grs_agents.graph.services import Services, Update, logged_node
from grs_agents.graph.state import RunState, TableObject, parse_state
from grs_agents.perception.annotated_pictures import MARKS, write_marks
from grs_agents.perception.image_geometry import mask_bounding_slices
from grs_agents.perception.picture_files import load_candidates, load_mask, save_candidates, write_png
from grs_agents.perception.segmentation.candidates import center_objects_in_workspace
from grs_agents.perception.segmentation.regrouping import Regrouping, regroup_segments, scale_box
from grs_agents.perception.types import Mask


def next_step_after_segment(state: RunState, *, runtime: Any) -> Literal["group", "describe"]:
    """The edge after ``segment``: segments are regrouped first, if there is a model that sees them."""
    services: Services = runtime.context
    if services.config.scene.group == "off" or all(item.given for item in parse_state(state)["objects"]):
        return "describe"  # masks of the user overrule a model
    return "group" if services.agents.sees_pictures("group") else "describe"


@logged_node("group")
def group_candidates(state: RunState, services: Services) -> Update:
    """Ask the grouper which segments show one object, several or none, and apply what geometry bears out."""
    frame, table, folder = services.load_photo(state), state["table"], services.folder
    objects, notes = state["objects"], state["notes"]
    scale = write_marks(frame, objects, folder)
    rows = [
        {
            "id": item.id,
            "box": _bounding_box(load_mask(folder / item.mask), scale),
            "size_m": [round(value, 3) for value in item.upright.size],
            "near": list_adjoining(item, objects),
        }
        for item in objects
    ]
    height, width = (round(scale * side) for side in frame.depth.shape)
    picture = f"The photo, {width} x {height} pixels. Each segment is outlined in colour and has its number."
    reply = roles.group_segments(services.agents, rows, (width, height), picture, [MARKS])
    if isinstance(reply, NoReply):
        return {"notes": [*notes, f"{reply}: the segmentation stays as it is"]}
    before = load_candidates(objects, folder)
    robot = load_mask(folder / state["robot"])
    said = Regrouping(
        merged=reply.merge,
        divided=[(item.segment, [scale_box(box, 1 / scale) for box in item.boxes]) for item in reply.split],
        scenery=[(item.segment, item.what) for item in reply.drop],
        missing=[(item.what, scale_box(item.box, 1 / scale), item.part_of) for item in reply.missing],
    )
    regrouped = regroup_segments(frame, table, before, robot, said)
    notes = [*notes, *(f"regrouping: {note}" for note in regrouped.notes)]
    if [item.id for item in regrouped.candidates] == [item.id for item in before]:
        services.log.append(SceneStage(stage="grouped", files={"marks": MARKS}))
        return {"notes": notes}
    table, candidates = center_objects_in_workspace(table, regrouped.candidates)
    records = save_candidates(frame, candidates, folder)
    owned = np.any([item.mask for item in candidates], axis=0)
    left_out = (load_mask(folder / state["left_out"]) | regrouped.scenery) & ~owned
    write_png(folder / state["left_out"], left_out.astype(np.uint8) * 255)
    services.log.append(
        SceneStage(
            stage="grouped",
            summary={
                "camera": state["camera"].model_copy(update={"T_robot_cam": table.T_robot_cam}),
                "table": table,
                "objects": [{"id": item.id, "name": f"candidate {item.id}", "box": item.box} for item in records],
                "dropped": regrouped.dropped,
            },
            files={"marks": MARKS, "masks": "scene/masks.png", "annotated": "scene/annotated.png"},
        )
    )
    background, remarks = build_background_asset(frame, table, candidates, robot, services)
    gone = {item.id for item in regrouped.dropped}
    return {
        "notes": [*notes, *(remark for remark in remarks if remark not in notes)],
        "background": background,
        "table": table,
        "objects": [*(item for item in objects if item.id in gone), *map(TableObject.from_record, records)],
        "dropped": [*state["dropped"], *regrouped.dropped],
    }


def _bounding_box(mask: Mask, scale: float) -> list[int]:
    """Left, top, width and height of a mask (H, W) in a picture ``scale`` times as large."""
    rows, columns = mask_bounding_slices(mask)
    sides = columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start
    return [round(scale * side) for side in sides]
