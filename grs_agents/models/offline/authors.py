"""The authors of tasks and simulation programs, and their fixers."""

import json
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations, islice, product

import numpy as np

from grs_agents.models.offline import program_edits
from grs_agents.models.offline.plan import (
    Family,
    PlacementPlan,
    Table,
    is_hard_to_topple,
    is_pickable_object,
    is_reachable_object,
    select_objects_without_overlap,
)
from grs_agents.models.offline.program_writer import class_name_for_task, write_program
from grs_agents.models.offline.prompt_text import CUP_ROOM, FAR, Json, PromptObject, PromptText, parse_scene_objects
from grs_agents.models.offline.router import parse_report_evidence
from grs_agents.models.offline.task_families import FAMILIES, PALETTE, TaskRequest
from grs_agents.models.offline.task_reading import Clause, UnplannableTaskError, parse_clauses
from grs_agents.models.offline.task_wording import (
    count_mentions,
    parse_task_request,
    task_description,
    task_name,
)

MAX_OBJECTS = 6
"""Most objects of a task."""
_OBJECT_COUNTS: dict[Family, tuple[int, int]] = {
    "pack": (3, MAX_OBJECTS),
    "stack": (2, 3),
    "sort": (3, MAX_OBJECTS),
    "line": (3, 5),
    "clear": (2, 4),
    "match": (2, 4),
    "place": (2, 4),
}
"""Least and most objects of a family; fewer if the scene has fewer."""
_GAPS = (CUP_ROOM, 0.012, 0.004)
"""Free space around an object (m), the most first; with the least of it nothing touches."""
_LEVEL = 0.003
"""Difference in height (m) below which undersides are level: coordinates are rounded, and resting objects sink in a
little."""
_DRAWN_FAMILIES: tuple[Family, ...] = tuple(family for family in FAMILIES if family != "exchange")
"""Families of the tasks that it draws; an exchange is too easy for most scenes."""
_TIGHT = 0.5
"""Factor on the free space in zones on a crowded table: 1 cm on each side."""
_MOST_READINGS = 50
"""Most selections among objects with equal labels that are tried."""
_TABLEWARE = ("mug", "cup", "plate", "bowl")
"""Categories of hollow objects that are too small as containers."""


def author_task(prompt: PromptText, rng: np.random.Generator) -> str:
    """Reply to the ``task`` prompt: a family drawn among the suitable families, and its objects."""
    task = draw_random_task(parse_scene_objects(prompt.section_json("scene")), rng)
    return _format_task(task) if task else "I cannot define a task: no family suits what stands on this table."


def _format_task(task: Json) -> str:
    return f"```json\n{json.dumps(task, indent=2, ensure_ascii=False)}\n```"


def draw_random_task(objects: Sequence[PromptObject], rng: np.random.Generator) -> Json | None:
    """Draw a task of a family that suits the scene, whose words parse back to the same plan; None if there is none."""
    families: list[Family] = [_DRAWN_FAMILIES[int(index)] for index in rng.permutation(len(_DRAWN_FAMILIES))]
    color = PALETTE[int(rng.integers(len(PALETTE)))]
    taken = tuple(obj.footprint_rect for obj in objects)
    ready = [obj for obj in objects if obj.hollow and abs(obj.low) < 0.025 and is_reachable_object(obj)]
    request = TaskRequest(
        color,
        tuple(obj for obj in ready if obj.category not in _TABLEWARE and is_clear_of_others(obj, objects, 0.0)),
        taken=taken,
    )
    called = count_called(objects)
    ranked = rank_movable_objects(objects)
    # a crowded table may have room for a pair with a bowl alone, which no family prefers
    with_bowls = [obj for obj in objects if is_uncovered_object(obj, objects) and is_reachable_object(obj)]
    tries = (
        (2, called, 1.0, ranked),
        (2, called, _TIGHT, ranked),
        (2, None, 1.0, ranked),
        (2, None, _TIGHT, [*ranked, [obj for obj in with_bowls if not obj.is_doubtful]]),
        (1, called, 1.0, ranked),
        (1, None, 1.0, ranked),
    )
    for least, names, margin, groups in tries:
        allowed: list[Family] = families if least == 2 else ["place"]
        for movable, family in product(groups, allowed):
            plan = find_plan_for_family(family, movable, replace(request, margin=margin), rng, least, names)
            task = None if plan is None else convert_plan_to_task_json(plan)
            if task is not None and is_plannable(task, objects):
                return task
    return None


def convert_plan_to_task_json(plan: PlacementPlan) -> Json:
    """The three fields of a task that asks for ``plan``."""
    name, description = task_name(plan), task_description(plan)
    return {"task-name": name, "task-description": description, "assets-used": list(plan.asset_names)}


def is_plannable(task: Json, objects: Sequence[PromptObject]) -> bool:
    """True if the words of ``task`` can be planned with these objects, and the plan gives back the same words."""
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
    # For all objects, then for all but a single object, the hindering objects first
    moved, taken = [obj for clause in clauses for obj in clause.moved], [obj.footprint_rect for obj in objects]
    for left_out in [None, *sorted(moved, key=lambda obj: obj.asset not in hindering)]:
        rest = relocate_unreachable_objects([obj for obj in moved if obj is not left_out], objects)
        request = parse_task_request(clauses[0].text, taken=taken)
        plan = FAMILIES[clauses[0].family](rest, request) if len(rest) > 1 else None
        if plan is None:
            continue
        revised = convert_plan_to_task_json(plan)
        given_up = f"The {left_out.label} stays" if left_out else "Another target takes the place of the old one"
        if revised["assets-used"] != task["assets-used"] and is_plannable(revised, objects):
            return _format_task({**revised, "given-up": f"{given_up}: the task could not be done as it was."})
    return "I cannot revise this task: no family does it with fewer objects."


def author_simulation(prompt: PromptText) -> str:
    """Reply to the ``simulation`` prompt: a program for this task with these objects, or a sentence that refuses it."""
    task = prompt.section_json("task")
    try:
        plans = make_plans_for_task(task, parse_scene_objects(prompt.section_json("scene")))
    except UnplannableTaskError as error:
        return f"I cannot write this program: {error}."
    name, description = str(task.get("task-name", "")), str(task.get("task-description", ""))
    return f"```python\n{write_program(plans, class_name_for_task(name), description)}```"


@dataclass(frozen=True)
class PlanningVariant:
    """Options of a plan."""

    spots: bool = False  # give each object its spot
    margin: float = 1.0  # factor on the free space around objects
    still: bool = False  # keep the plan's places of targets for every seed


_VARIANTS = (
    PlanningVariant(),
    PlanningVariant(spots=True),
    PlanningVariant(still=True),
    PlanningVariant(margin=1.5),
    PlanningVariant(spots=True, margin=1.5, still=True),
)


def fix_code(prompt: PromptText) -> str:
    """Reply to the ``fix_code`` prompt: a new program for the task, or a sentence that explains why there is none.

    If the program equals a variant of the author, the next variant replaces it.
    """
    task, objects = prompt.section_json("task"), parse_scene_objects(prompt.section_json("scene"))
    source = prompt.section_body("program").strip()
    imported = re.search(r"^from task_code import (\w+)", prompt.section_body("tests"), re.MULTILINE)
    title = imported[1] if imported else program_edits.find_task_class_name(source)
    texts: list[str] = []
    for variant in _VARIANTS:
        try:
            plans = make_plans_for_task(task, objects, variant.margin)
        except UnplannableTaskError as error:
            if variant == PlanningVariant():
                return f"I cannot mend this program: {error}."
            continue
        if variant.still:
            plans = [
                replace(plan, targets=tuple(replace(target, moves=False) for target in plan.targets)) for plan in plans
            ]
        text = write_program(plans, title, str(task.get("task-description", "")), variant.spots).strip()
        if text not in texts:
            texts.append(text)
    tried = texts.index(source) if source in texts else -1
    return f"```python\n{texts[(tried + 1) % len(texts)]}\n```"


def make_plans_for_task(task: Json, objects: Sequence[PromptObject], margin: float = 1.0) -> list[PlacementPlan]:
    """Plan a task of any author: a plan for each clause, which together use exactly the task's assets.

    Args:
        task: its three fields.
        objects: the objects of the scene.
        margin: a factor on the free space in zones.

    Raises:
        UnplannableTaskError: no family covers the words, or suits these objects.
    """
    assets = [str(asset) for asset in task.get("assets-used", [])]
    clauses = parse_clauses(task, _select_objects_by_asset(objects, assets))
    unlike = ""
    # For each clause, every selection of its objects with, for each label, as many objects as the clause mentions.
    options: list[list[list[PromptObject]]] = []
    for clause in clauses:
        alike: dict[str, list[PromptObject]] = {}
        for obj in clause.moved:
            alike.setdefault(obj.label, []).append(obj)
        choices = [
            combinations(group, min(len(group), count_mentions(label, clause.text))) for label, group in alike.items()
        ]
        kept = [{obj.name for group in picked for obj in group} for picked in product(*choices)]
        options.append([[obj for obj in clause.moved if obj.name in names] for names in kept])
    readings = list(islice(product(*options), _MOST_READINGS))
    for tightness, chosen in product((1.0, _TIGHT), readings):
        plans = _make_plan_per_clause(clauses, chosen, objects, margin * tightness)
        used = {asset for plan in plans for asset in plan.asset_names}
        if plans and used == {*assets}:
            return plans
        unlike = f", which would use {sorted(used)} and not {sorted(assets)}" if plans else unlike
    families = " and ".join(clause.family for clause in clauses)
    raise UnplannableTaskError(f"these objects do not suit a task of the family {families}{unlike}")


def _make_plan_per_clause(
    clauses: Sequence[Clause], chosen: Sequence[Sequence[PromptObject]], scene: Sequence[PromptObject], margin: float
) -> list[PlacementPlan]:
    """Plan each clause with its chosen objects in the remaining free space. Returns: no plans if a clause fails."""
    supports = [clause.support for clause in clauses if clause.support]
    picked = list(chain.from_iterable(chosen))
    ready = {obj.name: obj for obj in relocate_unreachable_objects(picked, scene)}
    usable = all(is_reachable_object(obj) and obj.name not in ready for obj in supports)
    if not ready or not usable or not len(ready) == len(picked) <= MAX_OBJECTS:
        return []
    taken = [obj.footprint_rect for obj in (*ready.values(), *scene)]
    plans: list[PlacementPlan] = []
    for clause, objects in zip(clauses, chosen, strict=True):
        request = parse_task_request(clause.text, clause.support, margin, taken)
        plan = FAMILIES[clause.family]([ready[obj.name] for obj in objects], request)
        if plan is None:
            return []
        plans.append(plan)
        taken += [target.footprint_rect for target in plan.targets]
    places = [target.name for plan in plans for target in plan.targets]
    return plans if len({*places}) == len(places) else []


def _select_objects_by_asset(objects: Sequence[PromptObject], assets: Sequence[str]) -> list[PromptObject]:
    """The objects of ``assets``, in their order."""
    return sorted((obj for obj in objects if obj.asset in assets), key=lambda obj: assets.index(obj.asset))


def rank_movable_objects(objects: Sequence[PromptObject]) -> list[list[PromptObject]]:
    """Sets of objects that a task can move, in descending order of free space.

    Sets of objects with unique labels come first, since words cannot tell equal labels apart. Supports of other objects
    are left out. If fewer than two objects can be picked at their places, the two that are easiest to pick, unique
    labels first, are moved to a free part of the table; not those that a trial failed to pick, which the audit expects
    where the photo shows them.
    """
    called = count_called(objects)
    loose = [obj for obj in objects if is_uncovered_object(obj, objects) and not obj.is_doubtful]
    usable = [obj for obj in filter(is_pickable_object, loose) if is_reachable_object(obj)]
    sure = [obj for obj in usable if is_hard_to_topple(obj) and obj.is_flat_topped]
    ranked = [
        [obj for obj in group if is_clear_of_others(obj, objects, gap)] for group in (sure, usable) for gap in _GAPS
    ]
    if len(usable) < 2:
        rest = [obj for obj in loose if obj not in usable and obj.can_be_picked]
        rest.sort(
            key=lambda obj: (
                called[obj.label] > 1,
                not is_pickable_object(obj),
                not obj.reachable,
                not is_hard_to_topple(obj),
                max(obj.size[:2]) + 0.5 * obj.size[2],
            )
        )
        ranked = [relocate_unreachable_objects([*usable, *rest][:2], objects)]
    ranked.append(usable)
    return [*([obj for obj in group if called[obj.label] == 1] for group in ranked), *ranked]


def count_called(objects: Sequence[PromptObject]) -> Counter[str]:
    """Number of objects that each name fits: "the brown box" also fits the tallest brown box."""
    return Counter(name for obj in objects for name in {obj.label, obj.kind})


def is_uncovered_object(obj: PromptObject, objects: Sequence[PromptObject]) -> bool:
    """True if nothing rests on it, according to the boxes of ``objects``."""
    return not any(
        neighbor is not obj
        and neighbor.low > obj.low + _LEVEL
        and obj.footprint_rect.overlaps(neighbor.footprint_rect, -0.01)
        for neighbor in objects
    )


def is_clear_of_others(obj: PromptObject, objects: Sequence[PromptObject], gap: float) -> bool:
    """True if none of ``objects`` comes closer to it than ``gap`` (m), seen from above."""
    return not any(
        neighbor is not obj and obj.footprint_rect.overlaps(neighbor.footprint_rect, gap) for neighbor in objects
    )


def relocate_unreachable_objects(objects: Sequence[PromptObject], scene: Sequence[PromptObject]) -> list[PromptObject]:
    """Move objects that are held or out of reach to a free part of the table; objects without a free place are left
    out."""
    table = Table([obj.footprint_rect for obj in scene], min((obj.far for obj in scene), default=FAR))
    placed: list[PromptObject] = []
    for obj in objects:
        if is_reachable_object(obj):
            placed.append(obj)
        elif spot := table.reserve_free_place(*obj.room[:2]):
            placed.append(obj.relocate_to(*spot))
    return placed


def list_candidate_object_sets(
    family: Family, objects: Sequence[PromptObject], rng: np.random.Generator
) -> list[list[PromptObject]]:
    """Selections of objects for a family, the most interesting first."""
    shuffled = [objects[int(index)] for index in rng.permutation(len(objects))]
    if family in ("pack", "stack"):
        shuffled = [obj for obj in shuffled if not obj.hollow]
    least, most = _OBJECT_COUNTS[family]
    if family == "stack":
        order = sorted(shuffled, key=lambda obj: -obj.size[0] * obj.size[1])
        chains: list[list[PromptObject]] = []
        for start in range(len(order)):
            tower: list[PromptObject] = []
            for obj in order[start:]:
                fits = not tower or all(b >= a - 0.004 for a, b in zip(obj.size[:2], tower[-1].size[:2], strict=True))
                low = obj.size[2] <= 2.0 * min(obj.size[:2])
                if fits and low and len(select_objects_without_overlap([*tower, obj], len(tower) + 1)) > len(tower):
                    tower.append(obj)
            if len(tower) >= 2 and all(obj.is_flat_topped for obj in tower[:-1]):
                chains.append(tower)
        return [chains[int(index)][:count] for index in rng.permutation(len(chains)) for count in (most, least)]
    if family == "clear":
        clusters: list[list[PromptObject]] = []
        for seed in shuffled:
            pairs = [(math.dist(obj.position[:2], seed.position[:2]), obj) for obj in shuffled]
            near = [obj for distance, obj in sorted(pairs, key=lambda pair: pair[0]) if distance < 0.28]
            clusters.append(select_objects_without_overlap(near, most))
        return [cluster for cluster in clusters if len(cluster) >= 2]
    if family == "sort":
        properties = ([obj.category for obj in shuffled], [obj.color for obj in shuffled])
        groups = [
            [obj for obj, value in zip(shuffled, values, strict=True) if value in [*dict.fromkeys(values)][:count]]
            for values in properties
            for count in (3, 2)
        ]
        return [select_objects_without_overlap(group, most) for group in groups]
    free = select_objects_without_overlap(shuffled, int(rng.integers(least, most + 1)))
    pairs = sorted(combinations(shuffled, 2), key=lambda pair: sum(obj.size[0] * obj.size[1] for obj in pair))
    return [*(free[:size] for size in range(len(free), 1, -1)), *map(list, pairs), *([obj] for obj in shuffled)]


def find_plan_for_family(
    family: Family,
    objects: Sequence[PromptObject],
    request: TaskRequest,
    rng: np.random.Generator,
    least: int = 2,
    called: Mapping[str, int] | None = None,
) -> PlacementPlan | None:
    """The plan for the first set of ``objects`` that suits ``family`` and has at least ``least`` members.

    ``called`` counts the objects of the scene by label: of equal labels, all are moved or none.
    """
    for chosen in list_candidate_object_sets(family, objects, rng):
        labels = Counter(obj.label for obj in chosen)
        counted = family in ("pack", "place", "clear")  # "the 2 gray cans", if there are no more
        apart = called is None or all(
            called[label] == count and (counted or count == 1) for label, count in labels.items()
        )
        plan = FAMILIES[family](chosen, request) if apart and len(chosen) >= least else None
        if plan is not None:
            return plan
    return None
