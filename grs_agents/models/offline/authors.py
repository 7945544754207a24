"""The roles that invent: the task author and the simulation author."""

import json
from collections.abc import Iterator, Sequence, Set
from dataclasses import replace
from itertools import chain, combinations, islice, product

import numpy as np

from grs_agents.models.offline.object_selection import (
    MAX_OBJECTS,
    count_called,
    find_plan_for_family,
    is_clear_of_others,
    rank_movable_objects,
    relocate_unreachable_objects,
)
from grs_agents.models.offline.plan import Family, Plan, is_reachable_object
from grs_agents.models.offline.program_writer import class_name_for_task, write_program
from grs_agents.models.offline.prompt_text import Json, PromptText, SceneObject, parse_scene_objects
from grs_agents.models.offline.report_evidence import parse_report_evidence
from grs_agents.models.offline.task_families import FAMILIES, PALETTE, TaskRequest
from grs_agents.models.offline.task_reading import Clause, UnplannableTaskError, parse_clauses
from grs_agents.models.offline.task_wording import (
    count_mentions,
    parse_task_request,
    task_description,
    task_name,
)


def author_task(prompt: PromptText, rng: np.random.Generator) -> str:
    """Reply to the ``task`` prompt: a family by the seed among those the scene allows, and its objects."""
    task = draw_random_task(parse_scene_objects(prompt.section_json("scene")), rng)
    return _format_task(task) if task else "I cannot define a task: no family suits what stands on this table."


def _format_task(task: Json) -> str:
    return f"```json\n{json.dumps(task, indent=2, ensure_ascii=False)}\n```"


_DRAWN_FAMILIES: tuple[Family, ...] = tuple(family for family in FAMILIES if family != "exchange")
"""Those that its own tasks are of: to change places asks too little of most scenes."""


def draw_random_task(objects: Sequence[SceneObject], rng: np.random.Generator) -> Json | None:
    """A task of a family drawn from those that suit the scene and that its words tell again; None if there is none."""
    families: list[Family] = [_DRAWN_FAMILIES[int(index)] for index in rng.permutation(len(_DRAWN_FAMILIES))]
    color = PALETTE[int(rng.integers(len(PALETTE)))]
    taken = tuple(obj.footprint_rect for obj in objects)
    request = TaskRequest(color, _find_usable_containers(objects), taken=taken)
    called = count_called(objects)
    tries = ((2, called, 1.0), (2, called, _TIGHT), (2, None, 1.0), (1, called, 1.0), (1, None, 1.0))
    for least, names, margin in tries:
        allowed: list[Family] = families if least == 2 else ["place"]
        for movable, family in product(rank_movable_objects(objects), allowed):
            plan = find_plan_for_family(family, movable, replace(request, margin=margin), rng, least, names)
            task = None if plan is None else convert_plan_to_task_json(plan)
            if task is not None and is_plannable(task, objects):
                return task
    return None


def convert_plan_to_task_json(plan: Plan) -> Json:
    """The three fields of a task that asks for ``plan``."""
    name, description = task_name(plan), task_description(plan)
    return {"task-name": name, "task-description": description, "assets-used": list(plan.asset_names)}


def is_plannable(task: Json, objects: Sequence[SceneObject]) -> bool:
    """Whether the words of ``task``, which tell one plan, can be followed with these objects and mean that plan."""
    try:
        plans = make_plans_for_task(task, objects)
    except UnplannableTaskError:
        return False
    return [task_description(plan) for plan in plans] == [task["task-description"]]


def revise_task(prompt: PromptText) -> str:
    """Reply to the ``fix_task`` prompt: the task with a new container, or else without the object that hinders it."""
    task, objects = prompt.section_json("task"), parse_scene_objects(prompt.section_json("scene"))
    evidence = parse_report_evidence(prompt.section_body("test report"))
    hindering = {asset for oracle in evidence.shortfalls for asset in oracle.objects}
    try:
        clauses = parse_clauses(task, _select_objects_by_asset(objects, task.get("assets-used", [])))
    except UnplannableTaskError as error:
        return f"I cannot revise this task: {error}."
    for plan, given_up in _iterate_revised_plans(clauses, hindering, objects):
        revised = convert_plan_to_task_json(plan)
        if revised["assets-used"] != task["assets-used"] and is_plannable(revised, objects):
            return _format_task({**revised, "given-up": f"{given_up}: the task could not be done as it was."})
    return "I cannot revise this task: no family does it with fewer objects."


def _iterate_revised_plans(
    clauses: Sequence[Clause], hindering: Set[str], objects: Sequence[SceneObject]
) -> Iterator[tuple[Plan, str]]:
    """Plans of the family of the first clause: for all objects, then without one, the ``hindering`` first."""
    moved, taken = [obj for clause in clauses for obj in clause.moved], [obj.footprint_rect for obj in objects]
    for left_out in [None, *sorted(moved, key=lambda obj: obj.asset not in hindering)]:
        rest = relocate_unreachable_objects([obj for obj in moved if obj is not left_out], objects)
        request = parse_task_request(clauses[0].text, taken=taken)
        plan = FAMILIES[clauses[0].family](rest, request) if len(rest) > 1 else None
        if plan is not None:
            yield plan, f"The {left_out.label} stays" if left_out else "Another target takes the place of the old one"


def author_simulation(prompt: PromptText) -> str:
    """Reply to the ``simulation`` prompt: a program for this task with these objects, or a sentence that refuses it."""
    task = prompt.section_json("task")
    try:
        plans = make_plans_for_task(task, parse_scene_objects(prompt.section_json("scene")))
    except UnplannableTaskError as error:
        return f"I cannot write this program: {error}."
    name, description = str(task.get("task-name", "")), str(task.get("task-description", ""))
    return f"```python\n{write_program(plans, class_name_for_task(name), description)}```"


def make_plans_for_task(task: Json, objects: Sequence[SceneObject], margin: float = 1.0) -> list[Plan]:
    """Plans for a task that anyone may have written, one for each of its clauses, which use just the task's assets.

    Args:
        task: its three fields.
        objects: what is in the scene.
        margin: a factor on the free space in zones.

    Raises:
        UnplannableTaskError: the words ask for what no family does, or no family can do it with these objects.
    """
    assets = [str(asset) for asset in task.get("assets-used", [])]
    clauses = parse_clauses(task, _select_objects_by_asset(objects, assets))
    unlike = ""
    options = (_candidate_object_sets(clause.moved, clause.text) for clause in clauses)
    readings = list(islice(product(*options), _MOST_READINGS))
    for tightness, chosen in product((1.0, _TIGHT), readings):
        plans = _make_plan_per_clause(clauses, chosen, objects, margin * tightness)
        used = {asset for plan in plans for asset in plan.asset_names}
        if plans and used == {*assets}:
            return plans
        unlike = f", which would use {sorted(used)} and not {sorted(assets)}" if plans else unlike
    families = " and ".join(clause.family for clause in clauses)
    raise UnplannableTaskError(f"these objects do not suit a task of the family {families}{unlike}")


_TIGHT = 0.5
"""The share of the free space in zones that is left on a table too full for all of it: 1 cm on each side."""
_MOST_READINGS = 50
"""How many ways of choosing among objects that are called alike are tried."""


def _make_plan_per_clause(
    clauses: Sequence[Clause], chosen: Sequence[Sequence[SceneObject]], scene: Sequence[SceneObject], margin: float
) -> list[Plan]:
    """A plan for each clause with the objects chosen for it, each on what all others leave free; none if one fails."""
    supports = [clause.support for clause in clauses if clause.support]
    ready = _relocate_objects_for_picking(list(chain.from_iterable(chosen)), supports, scene)
    taken = [obj.footprint_rect for obj in (*ready.values(), *scene)]
    plans: list[Plan] = []
    for clause, objects in zip(clauses, chosen, strict=True) if ready else ():
        request = parse_task_request(clause.text, clause.support, margin, taken)
        plan = FAMILIES[clause.family]([ready[obj.name] for obj in objects], request)
        if plan is None:
            return []
        plans.append(plan)
        taken += [target.footprint_rect for target in plan.targets]
    places = [target.name for plan in plans for target in plan.targets]
    return plans if len({*places}) == len(places) else []


def _relocate_objects_for_picking(
    objects: Sequence[SceneObject], supports: Sequence[SceneObject], scene: Sequence[SceneObject]
) -> dict[str, SceneObject]:
    """The objects by their names, each where the arm can pick it; none of them if that, or a support, cannot be."""
    ready = {obj.name: obj for obj in relocate_unreachable_objects(objects, scene)}
    usable = all(is_reachable_object(obj) and obj.name not in ready for obj in supports)
    return ready if usable and len(ready) == len(objects) <= MAX_OBJECTS else {}


def _select_objects_by_asset(objects: Sequence[SceneObject], assets: Sequence[str]) -> list[SceneObject]:
    """The objects that stand for ``assets``, in their order."""
    return sorted((obj for obj in objects if obj.asset in assets), key=lambda obj: assets.index(obj.asset))


def _candidate_object_sets(objects: Sequence[SceneObject], text: str) -> Iterator[list[SceneObject]]:
    """What ``text`` may mean: of the objects that are called alike, any so many as it counts."""
    alike: dict[str, list[SceneObject]] = {}
    for obj in objects:
        alike.setdefault(obj.label, []).append(obj)
    choices = [combinations(group, min(len(group), count_mentions(label, text))) for label, group in alike.items()]
    for picked in product(*choices):
        kept = {obj.name for group in picked for obj in group}
        yield [obj for obj in objects if obj.name in kept]


def _find_usable_containers(objects: Sequence[SceneObject]) -> tuple[SceneObject, ...]:
    """Containers on the table, in reach, with nothing in them or against them."""
    ready = [obj for obj in objects if obj.hollow and abs(obj.low) < 0.025 and is_reachable_object(obj)]
    return tuple(obj for obj in ready if obj.category not in _TABLEWARE and is_clear_of_others(obj, objects, 0.0))


_TABLEWARE = ("mug", "cup", "plate", "bowl")
"""Hollow things that are too small to be packed."""
