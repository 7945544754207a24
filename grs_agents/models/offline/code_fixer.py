"""The code fixer: the same task written anew, each time in the next of a few ways."""

import re
from dataclasses import dataclass, replace

from grs_agents.models.offline import program_edits
from grs_agents.models.offline.authors import make_plans_for_task
from grs_agents.models.offline.plan import Plan
from grs_agents.models.offline.program_writer import write_program
from grs_agents.models.offline.prompt_text import PromptText, parse_scene_objects
from grs_agents.models.offline.task_reading import UnplannableTaskError


def fix_code(prompt: PromptText) -> str:
    """Reply to the ``fix_code`` prompt: the task written anew, or a sentence that says why that cannot be.

    Where the program is what its author would write, the next way to do the same takes its place.
    """
    try:
        return f"```python\n{_write_next_program_variant(prompt, prompt.section_body('program').strip())}\n```"
    except UnplannableTaskError as error:
        return f"I cannot mend this program: {error}."


@dataclass(frozen=True)
class PlanningVariant:
    """One way to plan the task."""

    spots: bool = False  # give each object a spot of its own
    margin: float = 1.0  # factor on the free space around objects
    still: bool = False  # lay targets out where the plan has them, for every seed


_VARIANTS = (
    PlanningVariant(),
    PlanningVariant(spots=True),
    PlanningVariant(still=True),
    PlanningVariant(margin=1.5),
    PlanningVariant(spots=True, margin=1.5, still=True),
)


def _write_next_program_variant(prompt: PromptText, source: str) -> str:
    """The first way to write the task, or that which follows on ``source``."""
    task, objects = prompt.section_json("task"), parse_scene_objects(prompt.section_json("scene"))
    imported = re.search(r"^from task_code import (\w+)", prompt.section_body("tests"), re.MULTILINE)
    title = imported[1] if imported else program_edits.find_task_class_name(source)
    texts: list[str] = []
    for variant in _VARIANTS:
        try:
            plans = make_plans_for_task(task, objects, variant.margin)
        except UnplannableTaskError:
            if variant == PlanningVariant():
                raise
            continue
        plans = list(map(_fix_target_positions, plans)) if variant.still else plans
        text = write_program(plans, title, str(task.get("task-description", "")), variant.spots).strip()
        if text not in texts:
            texts.append(text)
    tried = texts.index(source) if source in texts else -1
    return texts[(tried + 1) % len(texts)]


def _fix_target_positions(plan: Plan) -> Plan:
    return replace(plan, targets=tuple(replace(target, moves=False) for target in plan.targets))
