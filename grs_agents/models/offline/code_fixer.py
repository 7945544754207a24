"""The code fixer: the smallest change that the evidence calls for, else the same task with less to do."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from grs_agents.models.offline import program_edits
from grs_agents.models.offline.authors import plan_task
from grs_agents.models.offline.program_writer import write_program
from grs_agents.models.offline.prompt_text import Json, PromptText, SceneObject, parse_scene_objects
from grs_agents.models.offline.report_evidence import Evidence, parse_report_evidence

_PARTIAL_OUTCOMES = frozenset({"dropped", "partial", "step_limit", "stopped", "target_occupied"})
_LARGER = 1.25
_RELOCATION_COMMENT = "stand somewhere free"
"""Stands in those that put an object elsewhere than the photo shows it."""


def fix_code(prompt: PromptText) -> str:
    """Reply to the ``fix_code`` prompt: the next version of the program."""
    source, evidence = prompt.section_body("program"), parse_report_evidence(prompt.section_body("test report"))
    task, objects = prompt.section_json("task"), parse_scene_objects(prompt.section_json("scene"))
    fixed = fix_python_error(source, evidence) or _increase_steps_or_areas(source, evidence)
    fixed = fixed or _write_replanned_program(source, evidence, task, objects)
    return f"```python\n{fixed.rstrip()}\n```"


def fix_python_error(source: str, evidence: Evidence) -> str | None:
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
        return program_edits.replace_identifier(source, wrong[1], meant[1])
    return None


def _increase_steps_or_areas(source: str, evidence: Evidence) -> str | None:
    """An edit that keeps the objects: more steps, larger areas."""
    steps = 2 * max(1, len(_list_program_objects(source)))  # as many as any oracle needs
    for oracle in evidence.oracles:
        if oracle.outcome == "step_limit" and oracle.most < steps:
            return program_edits.set_max_steps(source, steps)
        if oracle.outcome == "target_too_small":
            return program_edits.scale_target_sizes(source, _LARGER)
    return None


def _list_program_objects(source: str) -> list[str]:
    """The assets that ``source`` names, but for the templates of containers and zones."""
    return [asset for asset in program_edits.find_asset_names(source) if "template" not in asset]


@dataclass(frozen=True)
class Replan:
    """One way to plan the task anew."""

    without: frozenset[str] = frozenset()  # names of objects to leave out
    away: frozenset[str] = frozenset()  # names of objects to put elsewhere than the photo shows them
    spots: bool = False  # give each object a spot of its own
    margin: float = 1.0  # factor on the free space around objects

    def apply_to_objects(self, objects: Sequence[SceneObject]) -> list[SceneObject]:
        """The objects that are left, those to put elsewhere marked as out of reach."""
        left = [obj for obj in objects if obj.name not in self.without]
        return [replace(obj, reachable=False) if obj.name in self.away else obj for obj in left]


def _write_replanned_program(source: str, evidence: Evidence, task: Json, objects: Sequence[SceneObject]) -> str:
    """The same task planned anew with what the evidence teaches; with fewer objects where it teaches nothing."""
    named = [obj for obj in objects if obj.asset in task.get("assets-used", ())] or list(objects)
    used = program_edits.find_asset_names(source)
    present = [obj for obj in named if obj.asset in used]
    if {"moved", "assets_of_task"} & set(evidence.findings) or len(present) < 2:
        present = named
    title, description = program_edits.find_task_class_name(source), str(task.get("task-description", ""))
    for option in _list_replan_options(present, evidence, "spot" in source, _RELOCATION_COMMENT in source):
        plan = plan_task(task, option.apply_to_objects(present), option.margin)
        if plan is None or len(plan.moved_objects) < min(2, len(named)):
            continue
        text = write_program(plan, title, description, option.spots)
        if text.strip() != source.strip():
            return text
    return source


def _list_replan_options(
    present: Sequence[SceneObject], evidence: Evidence, spots: bool, relocated: bool
) -> list[Replan]:
    """What to try in turn: first what keeps every object that the task names, as the audit wants them all."""
    concerned = {asset for oracle in evidence.oracles for asset in oracle.objects}
    worst = sorted((obj for obj in present if not obj.hollow), key=_object_difficulty_score, reverse=True)
    suspects = [obj.name for obj in worst if obj.asset in concerned]
    everyone = frozenset(obj.name for obj in present)
    return [
        *_replan_options_keeping_all(evidence, frozenset(suspects), spots, relocated),
        *(Replan(frozenset({name}), spots=spots) for name in suspects),
        Replan(spots=spots, margin=1.5),
        *(Replan(frozenset(obj.name for obj in worst[:count]), spots=spots) for count in range(1, len(worst))),
        Replan(away=everyone, spots=True),
        Replan(away=everyone, spots=True, margin=1.5),
    ]


def _replan_options_keeping_all(
    evidence: Evidence, suspects: frozenset[str], spots: bool, relocated: bool
) -> Iterator[Replan]:
    outcomes = {oracle.outcome for oracle in evidence.oracles}
    if not evidence.oracles and not evidence.findings:
        yield Replan(spots=spots)
    if outcomes & (_PARTIAL_OUTCOMES | {"toppled"}) and not spots:
        yield Replan(spots=True)
    if "toppled" in outcomes and not relocated:
        yield Replan(away=suspects, spots=True)
    if "unreachable" in outcomes:
        yield Replan(away=suspects, spots=spots)


def _object_difficulty_score(obj: SceneObject) -> float:
    """How likely the object is to make trouble: tall, thin or large."""
    return obj.size[2] / min(obj.size[:2]) + 4 * max(obj.size[:2])
