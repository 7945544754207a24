"""The code fixer: the smallest change that the evidence calls for, else the same task with less to do."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from grs_agents.models.offline import program_edits
from grs_agents.models.offline.authors import plan_task
from grs_agents.models.offline.program_writer import write_program
from grs_agents.models.offline.prompt_text import Json, PromptText, SceneObject, parse_scene_objects
from grs_agents.models.offline.report_evidence import Evidence, parse_report_evidence
from grs_agents.models.offline.task_reading import UnplannableTaskError

_MISPLACED = frozenset({"unreachable", "toppled"})
"""The outcomes that a program mends by putting an object elsewhere than the photo shows it."""
_LARGER = 1.25
_OWN_PROGRAM_MARK = "for item, label, place, pose"
"""Stands in every program that this model writes."""


def fix_code(prompt: PromptText) -> str:
    """Reply to the ``fix_code`` prompt: the next version of the program, or a sentence that says why there is none.

    Another author's program is edited where a rule knows how; any other fix is the task written anew.
    """
    source, evidence = prompt.section_body("program"), parse_report_evidence(prompt.section_body("test report"))
    edited = None
    if _OWN_PROGRAM_MARK not in source:
        edited = fix_python_error(source, evidence) or _increase_steps_or_areas(source, evidence)
    try:
        fixed = edited or _write_next_variant(prompt, source, evidence)
    except UnplannableTaskError as error:
        return f"I cannot mend this program: {error}."
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
    for oracle in evidence.shortfalls:
        if oracle.outcome == "step_limit" and oracle.most < steps:
            return program_edits.set_max_steps(source, steps)
        if oracle.outcome == "target_too_small":
            return program_edits.scale_target_sizes(source, _LARGER)
    return None


def _list_program_objects(source: str) -> list[str]:
    """The assets that ``source`` names, but for the templates of containers and zones."""
    return [asset for asset in program_edits.find_asset_names(source) if "template" not in asset]


@dataclass(frozen=True)
class Variant:
    """One way to plan the task."""

    away: frozenset[str] = frozenset()  # assets to put elsewhere than the photo shows them
    spots: bool = False  # give each object a spot of its own
    margin: float = 1.0  # factor on the free space around objects


def _write_next_variant(prompt: PromptText, source: str, evidence: Evidence) -> str:
    """The task as its author would write it; where that is what ``source`` is, the next way to do the same."""
    task, objects = prompt.section_json("task"), parse_scene_objects(prompt.section_json("scene"))
    imported = re.search(r"^from task_code import (\w+)", prompt.section_body("tests"), re.MULTILINE)
    title = imported[1] if imported else program_edits.find_task_class_name(source)
    texts: list[str] = []
    for variant in _list_variants(task, objects, evidence):
        placed = [replace(obj, reachable=False) if obj.asset in variant.away else obj for obj in objects]
        try:
            plans = plan_task(task, placed, variant.margin)
        except UnplannableTaskError:
            if variant == Variant():
                raise
            continue
        text = write_program(plans, title, str(task.get("task-description", "")), variant.spots)
        if text.strip() not in texts:
            texts.append(text.strip())
    tried = texts.index(source.strip()) if source.strip() in texts else -1
    return texts[(tried + 1) % len(texts)]


def _list_variants(task: Json, objects: Sequence[SceneObject], evidence: Evidence) -> list[Variant]:
    """All that can be tried, the plainest first, then what the evidence speaks for."""
    named = [obj for obj in objects if obj.asset in task.get("assets-used", ()) and not obj.hollow]
    worst = [obj.asset for obj in sorted(named, key=_object_difficulty_score, reverse=True)]
    variants = [
        Variant(spots=True),
        Variant(margin=1.5),
        *(Variant(frozenset({asset}), spots=True) for asset in worst),
        Variant(frozenset(worst), spots=True),
        Variant(frozenset(worst), spots=True, margin=1.5),
    ]
    suspects = frozenset(asset for oracle in evidence.shortfalls for asset in oracle.objects)
    outcomes = {oracle.outcome for oracle in evidence.shortfalls}
    wanted = [variant for variant in variants if outcomes & _MISPLACED and variant.away & suspects]
    return [Variant(), *wanted, *variants]


def _object_difficulty_score(obj: SceneObject) -> float:
    """How likely the object is to make trouble: tall, thin or large."""
    return obj.size[2] / min(obj.size[:2]) + 4 * max(obj.size[:2])
