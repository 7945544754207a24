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


def fix_code(prompt: PromptText) -> str:
    """Reply to the ``fix_code`` prompt: the task written anew, or a sentence that says why that cannot be.

    Where the program is what its author would write, the next way to do the same takes its place.
    """
    source, evidence = prompt.section_body("program"), parse_report_evidence(prompt.section_body("test report"))
    try:
        return f"```python\n{_write_next_variant(prompt, source.strip(), evidence)}\n```"
    except UnplannableTaskError as error:
        return f"I cannot mend this program: {error}."


@dataclass(frozen=True)
class Variant:
    """One way to plan the task."""

    away: frozenset[str] = frozenset()  # assets to put elsewhere than the photo shows them
    spots: bool = False  # give each object a spot of its own
    margin: float = 1.0  # factor on the free space around objects


def _write_next_variant(prompt: PromptText, source: str, evidence: Evidence) -> str:
    """The first way to write the task, or that which follows on ``source``."""
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
    tried = texts.index(source) if source in texts else -1
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
