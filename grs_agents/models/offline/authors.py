"""The roles that invent: the task author and the simulation author."""

import json
from collections.abc import Sequence

import numpy as np

from grs_agents.models.offline.object_selection import MOST, plan_for, pool, settled
from grs_agents.models.offline.plan import ZONE, Family, Plan, in_reach
from grs_agents.models.offline.program_writer import class_name, write_program
from grs_agents.models.offline.prompt_text import Json, PromptText, Thing, read_things
from grs_agents.models.offline.task_families import FAMILIES, PALETTE, Wish
from grs_agents.models.offline.task_wording import UNTOLD, read_family, read_wish, task_description, task_name, told


def author_task(prompt: PromptText, rng: np.random.Generator) -> str:
    """Reply to the ``task`` prompt: a family by the seed among those the scene allows, and its objects."""
    things = read_things(prompt.json("scene"))
    plan = invent(things, rng)
    if plan is not None:
        task = {
            "task-name": task_name(plan),
            "task-description": task_description(plan),
            "assets-used": list(plan.assets),
        }
    else:
        first = things[0].asset if things else next((str(row.get("name")) for row in prompt.rows("fixtures")), ZONE)
        task = {
            "task-name": "place-object",
            "task-description": "Put the object on the green zone.",
            "assets-used": [first, ZONE],
        }
    return f"```json\n{json.dumps(task, indent=2, ensure_ascii=False)}\n```"


def invent(things: Sequence[Thing], rng: np.random.Generator) -> Plan | None:
    """A plan of a family drawn from those that suit the scene; None where nothing can be moved at all."""
    movable = pool(things)
    families: list[Family] = [list(FAMILIES)[int(index)] for index in rng.permutation(len(FAMILIES))]
    color = PALETTE[int(rng.integers(len(PALETTE)))]
    wish = Wish(color, _holders(things))
    for least in (2, 1):
        for family in families if least == 2 else ("place",):
            plan = plan_for(family, movable, wish, rng, least)
            if plan is not None:
                return plan
    return None


def author_simulation(prompt: PromptText) -> str:
    """Reply to the ``simulation`` prompt: a program for this task with these objects."""
    task = prompt.json("task")
    plan = plan_task(task, read_things(prompt.json("scene")))
    return f"```python\n{program_for(task, plan)}```"


def program_for(task: Json, plan: Plan | None) -> str:
    """The program text for a task; one that says so where no plan could be made."""
    name, description = str(task.get("task-name", "")), str(task.get("task-description", ""))
    if plan is None:
        return f'raise RuntimeError("no object of {name} can be placed on the table")\n'
    return write_program(plan, class_name(name), description)


def plan_task(task: Json, things: Sequence[Thing], margin: float = 1.0) -> Plan | None:
    """A plan for a task that anyone may have written.

    Args:
        task: the task definition.
        things: the objects of the scene that may be used.
        margin: factor on the free space inside containers and zones.
    """
    name, description = str(task.get("task-name", "")), str(task.get("task-description", ""))
    assets = [str(asset) for asset in task.get("assets-used", [])]
    used = [thing for thing in things if thing.asset in assets]
    used.sort(key=lambda thing: assets.index(thing.asset))
    family = read_family(name, description)
    small = [thing for thing in used if not thing.hollow]
    holders = [thing for thing in used if thing.hollow] if family == "pack" and len(small) > 1 else []
    selections = _selections([t for t in used if t not in holders] or used, description)
    wish = read_wish(name, description, [t.on_table() for t in holders if t not in selections[0] and in_reach(t)])
    wish = Wish(wish.color, wish.holders, wish.note, margin)
    foreign: list[Plan] = []
    for count in range(min(MOST, max(len(chosen) for chosen in selections)), 0, -1):
        for chosen in selections:
            ready = settled(chosen[:count])
            for name in (family, "place", "pack") if ready else ():
                plan = FAMILIES[name](ready, wish)
                if plan is not None and set(plan.assets) <= {*assets}:
                    return plan
                foreign += [plan] if plan else []
    return foreign[0] if foreign else None


def _selections(things: Sequence[Thing], description: str) -> list[list[Thing]]:
    """What a description may mean: where it counts fewer objects than are called alike, each of them in turn."""
    alike = [[other for other in things if other.label == thing.label] for thing in things]
    turns = max((len(group) for group in alike), default=1)
    selections: list[list[Thing]] = []
    for turn in range(turns):
        ranks = [(group.index(thing) - turn) % len(group) for thing, group in zip(things, alike, strict=True)]
        ordered = [things[index] for index in sorted(range(len(things)), key=ranks.__getitem__)]
        kept = _as_described(ordered, description)
        chosen = [thing for thing in things if thing in kept]
        if chosen not in selections:
            selections.append(chosen)
    return selections or [[]]


def _holders(things: Sequence[Thing]) -> tuple[Thing, ...]:
    return tuple(
        thing.on_table()
        for thing in things
        if thing.hollow and thing.standing and in_reach(thing) and thing.category not in ("mug", "cup", "plate", "bowl")
    )


def _as_described(things: Sequence[Thing], description: str) -> list[Thing]:
    """Of objects called alike, as many as the description counts; of one asset those it speaks of, at least one."""
    spoken = {thing.asset for thing in things if told(thing.label, description) < UNTOLD}
    kept: list[Thing] = []
    for thing in things:
        if thing.asset in spoken and told(thing.label, description) == UNTOLD:
            continue
        same = [other for other in kept if other.label == thing.label]
        if thing.asset not in {other.asset for other in same} or len(same) < told(thing.label, description):
            kept.append(thing)
    return kept
