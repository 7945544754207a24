"""The code fixer: the smallest change that the evidence calls for, else the same task with less to do."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from grs_agents.models.offline import program_edits
from grs_agents.models.offline.authors import plan_task
from grs_agents.models.offline.program_writer import write_program
from grs_agents.models.offline.prompt_text import Json, PromptText, Thing, read_things
from grs_agents.models.offline.report_evidence import Evidence, read_evidence

_MISSED = frozenset({"dropped", "partial", "step_limit", "stopped", "target_occupied"})
_LARGER = 1.25
_ELSEWHERE = "stand somewhere free"
"""Stands in those that put an object elsewhere than the photo shows it."""
_OWN = "for item, label, place, pose"
"""Stands in every program that this model writes."""


def fix_code(prompt: PromptText) -> str:
    """Reply to the ``fix_code`` prompt: the next version of the program."""
    source, evidence = prompt.body("program"), read_evidence(prompt.body("test report"))
    task, things = prompt.json("task"), read_things(prompt.json("scene"))
    fixed = mend_python(source, evidence) or _edited(source, evidence) or _shortened(source, evidence)
    fixed = fixed or _replanned(source, evidence, task, things)
    return f"```python\n{fixed.rstrip()}\n```"


def mend_python(source: str, evidence: Evidence) -> str | None:
    """``source`` without the Python error that the report ends in; None where no rule knows it."""
    faults = [(kind, message) for kind, message in evidence.errors if kind != "AssertionError"]
    if not faults:
        return None
    kind, message = faults[-1]
    meant = re.search(r"Did you mean: '(?:[\w]+\.)?(\w+)'", message)
    wrong = re.search(r"(?:no attribute|cannot import name|name|keyword argument) '(\w+)'", message)
    if kind == "NameError" and wrong:
        added = program_edits.add_import(source, wrong[1])
        if added:
            return added
    if meant and wrong and kind in ("NameError", "AttributeError", "ImportError", "TypeError"):
        return program_edits.replace_attribute(source, wrong[1], meant[1])
    return None


def _edited(source: str, evidence: Evidence) -> str | None:
    """An edit that keeps the objects: more steps, larger areas."""
    for oracle in evidence.oracles:
        if oracle.outcome == "step_limit" and oracle.most < _plenty(source):
            return program_edits.set_max_steps(source, _plenty(source))
        if oracle.outcome == "target_too_small":
            return program_edits.scale_areas(source, _LARGER)
    return None


def _shortened(source: str, evidence: Evidence) -> str | None:
    """Another author's program without the object that the oracle has trouble with, while two others remain."""
    objects = [asset for asset in program_edits.assets_in(source) if "template" not in asset]
    concerned = [asset for oracle in evidence.oracles for asset in oracle.objects if asset in objects]
    if _OWN in source or len(objects) <= 2 or not concerned:
        return None
    return program_edits.drop_asset(source, concerned[0])


def _plenty(source: str) -> int:
    """As many steps as any oracle needs for the objects that ``source`` names."""
    objects = [asset for asset in program_edits.assets_in(source) if "template" not in asset]
    return 2 * max(1, len(objects))


@dataclass(frozen=True)
class Attempt:
    """One way to plan the task anew.

    Attributes:
        without: names of things to leave out.
        away: names of things to put elsewhere than the photo shows them.
        spots: give each object a spot of its own.
        margin: factor on the free space around objects.
    """

    without: frozenset[str] = frozenset()
    away: frozenset[str] = frozenset()
    spots: bool = False
    margin: float = 1.0


def _replanned(source: str, evidence: Evidence, task: Json, things: Sequence[Thing]) -> str:
    """The same task planned anew with what the evidence teaches; with fewer objects where it teaches nothing."""
    named = [thing for thing in things if thing.asset in task.get("assets-used", ())] or list(things)
    used = program_edits.assets_in(source)
    present = [thing for thing in named if thing.asset in used]
    if {"moved", "assets_of_task"} & set(evidence.findings) or len(present) < 2:
        present = named
    for attempt in _attempts(present, evidence, "spot" in source, _ELSEWHERE in source):
        chosen = [thing for thing in present if thing.name not in attempt.without]
        chosen = [replace(thing, reachable=False) if thing.name in attempt.away else thing for thing in chosen]
        plan = plan_task(task, chosen, attempt.margin)
        if plan is None or len(plan.things) < min(2, len(named)):
            continue
        text = write_program(
            plan, program_edits.task_class(source), str(task.get("task-description", "")), attempt.spots
        )
        if text.strip() != source.strip():
            return text
    return source


def _attempts(present: Sequence[Thing], evidence: Evidence, spots: bool, elsewhere: bool) -> list[Attempt]:
    """What to try in turn: first what keeps every object that the task names, as the audit wants them all."""
    concerned = {asset for oracle in evidence.oracles for asset in oracle.objects}
    outcomes = {oracle.outcome for oracle in evidence.oracles}
    worst = sorted((thing for thing in present if not thing.hollow), key=_trouble, reverse=True)
    suspects = [thing.name for thing in worst if thing.asset in concerned]
    everyone = frozenset(thing.name for thing in present)
    tries = [] if evidence.oracles or evidence.findings else [Attempt(spots=spots)]
    if outcomes & (_MISSED | {"toppled"}) and not spots:
        tries.append(Attempt(spots=True))
    if "toppled" in outcomes and not elsewhere:
        tries.append(Attempt(away=frozenset(suspects), spots=True))
    if "unreachable" in outcomes:
        tries.append(Attempt(away=frozenset(suspects), spots=spots))
    tries += [Attempt(frozenset({name}), spots=spots) for name in suspects]
    tries.append(Attempt(spots=spots, margin=1.5))
    tries += [Attempt(frozenset(thing.name for thing in worst[:count]), spots=spots) for count in range(1, len(worst))]
    tries += [Attempt(away=everyone, spots=True), Attempt(away=everyone, spots=True, margin=1.5)]
    return tries


def _trouble(thing: Thing) -> float:
    """How likely the thing is to make trouble: tall, thin or large."""
    return thing.size[2] / min(thing.size[:2]) + 4 * max(thing.size[:2])
