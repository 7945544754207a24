"""A picture of how the robot's episode ended, with the objects at fault outlined, for models that see."""

from collections.abc import Mapping
from pathlib import Path

import cv2

from grs_agents.base.files import write_bytes
from grs_agents.base.foreign.pictures import read_picture
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState
from grs_agents.graph.task_instances import instantiate_program_for_seeds
from grs_agents.models.factory import is_offline
from grs_agents.perception.types import SceneDescription
from grs_agents.sim.instance.episode import Episode
from grs_agents.sim.instance.robot_file import resolve_robot_path
from grs_agents.sim.instance.task_instance import TaskInstance, parse_instance_json
from grs_agents.sim.rollouts import Rollout

MARKED = 3
"""The most objects that are outlined."""
_COLOR = (255, 0, 255)  # blue first
_FONT = 0.45


def draw_end_of_episode(state: RunState, services: Services, role: str) -> list[str]:
    """The picture's path in the run folder; none where the model of ``role`` sees none, or none can be made."""
    config = services.config
    if (
        not (config.end_picture and state.get("image"))
        or role == "fix_tests"
        or is_offline(config.model_for_role(role).model)
    ):
        return []
    path = f"history/end_{state.get('fixes', 0):03d}.png"
    output = services.folder / path
    if output.is_file():
        return [path]
    last = _find_last_rollout(state, services)
    if last is None:
        return []
    instance, rollout = last
    marked = find_ids_of_failed_objects(rollout.episode)
    drawn = services.run_tool(
        "render",
        instance=instance.model_dump(mode="json"),
        output=str(output.resolve()),
        poses=rollout.final,
        marked=marked,
        **services.library_root_fields,
    )
    if drawn.image is None:
        return []
    write_names_beside_boxes(output, drawn.boxes, {item.id: item.asset for item in instance.objects})
    return [path]


def _find_last_rollout(state: RunState, services: Services) -> tuple[TaskInstance, Rollout] | None:
    """That of the audit's seed which fell shortest; before an audit, one of the first seed, made for the picture."""
    rollouts = [Rollout.model_validate(rollout) for rollout in state.get("audit", {}).get("rollouts", [])]
    if rollouts:
        last = min(rollouts, key=lambda rollout: rollout.episode.strict)
        file = services.folder / f"instances/seed_{last.seed}.json"
        return resolve_robot_path(parse_instance_json(file.read_text(encoding="utf-8")), services.folder), last
    scene = SceneDescription.model_validate(state["scene"])
    drawn, _ = instantiate_program_for_seeds(state["simulation"], [services.config.seed], services, scene)
    if not drawn:
        return None
    done = services.run_tool("rollout", instance=drawn[0].model_dump(mode="json"), **services.library_root_fields)
    return None if done.rollout is None else (drawn[0], Rollout.model_validate(done.rollout))


def find_ids_of_failed_objects(episode: Episode) -> list[int]:
    """The ids of the objects that miss in the goals that hold least; else those that the episode's end concerns."""
    for goal in sorted(episode.goals, key=lambda goal: goal.strict):
        missed = [
            motion.object
            for motion in episode.motions
            if any(clause.startswith(f"{motion.asset} #{motion.object} ") for clause in goal.shortfalls)
        ]
        if missed:
            return missed[:MARKED]
    return [motion.object for motion in episode.motions if motion.asset in episode.objects][:MARKED]


def write_names_beside_boxes(
    file: Path, boxes: Mapping[int, tuple[int, int, int, int]], names: Mapping[int, str]
) -> None:
    """Write names into a picture file, above or below boxes (left, top, right, bottom) in pixels."""
    picture = read_picture(file, cv2.IMREAD_COLOR)
    for number, (left, top, _, bottom) in boxes.items():
        text = f"{names[number]} #{number}"
        (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, _FONT, 1)
        x = max(0, min(left, picture.shape[1] - width - 4))
        y = top - 6 if top > height + 8 else bottom + height + 6
        cv2.rectangle(picture, (x, y - height - 3), (x + width + 4, y + 4), (255, 255, 255), -1)
        cv2.putText(picture, text, (x + 2, y), cv2.FONT_HERSHEY_SIMPLEX, _FONT, _COLOR, 1, cv2.LINE_AA)
    write_bytes(file, cv2.imencode(".png", picture)[1].tobytes())
