"""The roles that invent: the task author and the simulation author."""

import json
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from grs_agents.models.offline.object_selection import (
    MAX_OBJECTS,
    find_plan_for_family,
    relocate_misplaced_objects,
    select_movable_objects,
)
from grs_agents.models.offline.plan import ZONE, Family, Plan, is_reachable_object
from grs_agents.models.offline.program_writer import class_name_for_task, write_program
from grs_agents.models.offline.prompt_text import Json, PromptText, SceneObject, parse_scene_objects
from grs_agents.models.offline.task_families import FAMILIES, PALETTE, TaskRequest
from grs_agents.models.offline.task_wording import (
    NOT_MENTIONED,
    count_mentions,
    infer_task_family,
    parse_task_request,
    task_description,
    task_name,
)


def author_task(prompt: PromptText, rng: np.random.Generator) -> str:
    """Reply to the ``task`` prompt: a family by the seed among those the scene allows, and its objects."""
    objects = parse_scene_objects(prompt.section_json("scene"))
    plan = draw_random_plan(objects, rng)
    if plan is not None:
        name, description, assets = task_name(plan), task_description(plan), list(plan.asset_names)
    else:
        first = (
            objects[0].asset
            if objects
            else next((str(row.get("name")) for row in prompt.section_json_rows("fixtures")), ZONE)
        )
        name, description, assets = "place-object", "Put the object on the green zone.", [first, ZONE]
    task = {"task-name": name, "task-description": description, "assets-used": assets}
    return f"```json\n{json.dumps(task, indent=2, ensure_ascii=False)}\n```"


def draw_random_plan(objects: Sequence[SceneObject], rng: np.random.Generator) -> Plan | None:
    """A plan of a family drawn from those that suit the scene; None where nothing can be moved at all."""
    movable = select_movable_objects(objects)
    families: list[Family] = [list(FAMILIES)[int(index)] for index in rng.permutation(len(FAMILIES))]
    color = PALETTE[int(rng.integers(len(PALETTE)))]
    request = TaskRequest(color, _find_usable_containers(objects))
    for least in (2, 1):
        for family in families if least == 2 else ("place",):
            plan = find_plan_for_family(family, movable, request, rng, least)
            if plan is not None:
                return plan
    return None


def author_simulation(prompt: PromptText) -> str:
    """Reply to the ``simulation`` prompt: a program for this task with these objects."""
    task = prompt.section_json("task")
    plan = plan_task(task, parse_scene_objects(prompt.section_json("scene")))
    name, description = str(task.get("task-name", "")), str(task.get("task-description", ""))
    if plan is None:
        return f'```python\nraise RuntimeError("no object of {name} can be placed on the table")\n```'
    return f"```python\n{write_program(plan, class_name_for_task(name), description)}```"


def plan_task(task: Json, objects: Sequence[SceneObject], margin: float = 1.0) -> Plan | None:
    """A plan for a task that anyone may have written; ``margin`` is a factor on the free space in zones."""
    name, description = str(task.get("task-name", "")), str(task.get("task-description", ""))
    assets = [str(asset) for asset in task.get("assets-used", [])]
    family, used = infer_task_family(name, description), _objects_for_assets(objects, assets)
    moved = [obj for obj in used if not obj.hollow] if family == "pack" else []
    moved = moved if len(moved) > 1 else used
    containers = [obj.snap_to_table() for obj in used if obj not in moved and is_reachable_object(obj)]
    request = parse_task_request(name, description, containers, margin)
    foreign: Plan | None = None
    for plan in _candidate_plans(family, _candidate_object_sets(moved, description), request):
        if {*plan.asset_names} <= {*assets}:
            return plan
        foreign = foreign or plan
    return foreign


def _objects_for_assets(objects: Sequence[SceneObject], assets: Sequence[str]) -> list[SceneObject]:
    """The objects that stand for ``assets``, in their order."""
    return sorted((obj for obj in objects if obj.asset in assets), key=lambda obj: assets.index(obj.asset))


def _candidate_plans(
    family: Family, selections: Sequence[Sequence[SceneObject]], request: TaskRequest
) -> Iterator[Plan]:
    """Plans for as many objects as possible; of as many objects, those of ``family`` first."""
    most = min(MAX_OBJECTS, max(map(len, selections)))
    for count, chosen in product(range(most, 0, -1), selections):
        ready = relocate_misplaced_objects(chosen[:count])
        for name in (family, "place", "pack") if ready else ():
            plan = FAMILIES[name](ready, request)
            if plan is not None:
                yield plan


def _candidate_object_sets(objects: Sequence[SceneObject], description: str) -> list[list[SceneObject]]:
    """What a description may mean: where it counts fewer objects than are called alike, each of them in turn."""
    alike = [[other for other in objects if other.label == obj.label] for obj in objects]
    turns = max((len(group) for group in alike), default=1)
    selections: list[list[SceneObject]] = []
    for turn in range(turns):
        ranks = [(group.index(obj) - turn) % len(group) for obj, group in zip(objects, alike, strict=True)]
        ordered = [objects[index] for index in sorted(range(len(objects)), key=ranks.__getitem__)]
        kept = _filter_by_description(ordered, description)
        chosen = [obj for obj in objects if obj in kept]
        if chosen not in selections:
            selections.append(chosen)
    return selections or [[]]


def _find_usable_containers(objects: Sequence[SceneObject]) -> tuple[SceneObject, ...]:
    ready = [obj for obj in objects if obj.hollow and obj.stands_on_table and is_reachable_object(obj)]
    return tuple(obj.snap_to_table() for obj in ready if obj.category not in ("mug", "cup", "plate", "bowl"))


def _filter_by_description(objects: Sequence[SceneObject], description: str) -> list[SceneObject]:
    """Of objects called alike, as many as the description counts; of one asset those it speaks of, at least one."""
    spoken = {obj.asset for obj in objects if count_mentions(obj.label, description) < NOT_MENTIONED}
    kept: list[SceneObject] = []
    for obj in objects:
        if obj.asset in spoken and count_mentions(obj.label, description) == NOT_MENTIONED:
            continue
        same = [other for other in kept if other.label == obj.label]
        if obj.asset not in {other.asset for other in same} or len(same) < count_mentions(obj.label, description):
            kept.append(obj)
    return kept
