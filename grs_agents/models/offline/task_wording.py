"""Plans in words: the task's name and description, and the reading of any task's words back into a family."""

import re
from collections.abc import Sequence

from grs_agents.models.offline.plan import Family, PlacementPlan
from grs_agents.models.offline.prompt_text import COLORS, PromptObject, Rect
from grs_agents.models.offline.task_families import PALETTE, TaskRequest

_FAMILY_WORDS: tuple[tuple[Family, str], ...] = (
    ("exchange", r"swap|exchange|(change|switch|trade) (their )?places"),
    ("sort", r"sort|group|categor|separat"),
    ("stack", r"stack|pile|tower|on top of"),
    ("line", r"\bline\b|\brow\b|\border\b|shortest|tallest|arrange|align"),
    ("clear", r"clear|tidy|empty|make room|free up"),
    ("match", r"mark of its own|own mark|each on|match|distribut"),
    ("pack", r"pack|container|into|inside|\bbox up|basket|bowl|tray|\bbin\b"),
    ("place", r"."),
)
_VERBS: dict[Family, str] = {
    "pack": "pack",
    "stack": "stack",
    "sort": "sort",
    "line": "line-up",
    "clear": "clear-away",
    "match": "distribute",
    "place": "place",
    "exchange": "exchange",
}


def task_name(plan: PlacementPlan) -> str:
    """A kebab-case name with the family and some of the objects."""
    labels = list(dict.fromkeys(obj.label for obj in plan.moved_objects))
    what = "-and-".join(labels[:2]) + ("-and-more" if len(labels) > 2 else "")
    target = plan.targets[0]
    preposition = "into" if target.kind in ("container", "object") else "on"
    where = f"-{preposition}-{target.label}" if plan.family in ("pack", "stack", "place") else ""
    how = {"sort": f"-by-{plan.criterion}", "line": "-by-height", "match": "-on-marks"}.get(plan.family, "")
    return re.sub(r"[^a-z0-9]+", "-", f"{_VERBS[plan.family]}-{what}{how}{where}".lower()).strip("-")[:90].strip("-")


def task_description(plan: PlacementPlan) -> str:
    """A task description in a sentence or two."""
    templates = {
        "pack": "Pick up {what} and put everything into the {where}.",
        "stack": "Stack {what} on the {where}, in this order from the bottom to the top.",
        "line": "Line up {what} on the {where}, side by side from the shortest to the tallest.",
        "clear": "Clear the {where}: move {what} out of it to a free part of the table.",
        "sort": "Sort the objects by {note}: put {placements}.",
        "match": "Put each object on a mark of its own: {placements}.",
        "place": "Put {what} on the {where}.",
        "exchange": "Let {what} exchange their places.",
    }
    what = format_label_list([obj.label for obj in plan.moved_objects])
    parts: list[str] = []
    for target in plan.targets:
        labels = [move.obj.label for move in plan.moves if move.target is target]
        if labels:
            parts.append(f"{format_label_list(labels)} on the {target.label}")
    where, placements = plan.targets[0].label, ", and ".join(filter(None, [", ".join(parts[:-1]), parts[-1]]))
    return templates[plan.family].format(what=what, where=where, note=plan.criterion, placements=placements)


def infer_task_family(name: str, description: str) -> Family:
    """The family that a task's words call for; the name weighs more than the description."""
    begins: list[Family] = [family for family, verb in _VERBS.items() if name.lower().startswith(f"{verb}-")]
    if begins:
        return begins[0]
    for text in (name.lower().replace("-", " "), description.lower()):
        for family, pattern in _FAMILY_WORDS[:-1]:
            if re.search(pattern, text):
                return family
    return "place"


def parse_task_request(
    text: str, support: PromptObject | None = None, margin: float = 1.0, taken: Sequence[Rect] = ()
) -> TaskRequest:
    """Parse the colour and the order from a task's words; the table is given."""
    colors = "|".join(COLORS)
    color = re.search(rf"\b({colors}) (?:container|zone|strip|area|mark|place|square)\b", text)
    color = color or re.search(rf"\b({colors}) box\b", text)  # a box may also be an object to move
    by_kind = "kind" if re.search(r"by (kind|category|type)", text) else ""
    return TaskRequest(
        color=color.group(1) if color else PALETTE[0],
        containers=() if support is None else (support,),
        criterion="color" if re.search(r"by colou?r", text) else by_kind,
        margin=margin,
        support=support,
        ordered="order" in text,
        taken=tuple(taken),
    )


def format_label_list(labels: Sequence[str]) -> str:
    """``the a, the b and the c``; equal labels are counted."""
    counts = {label: list(labels).count(label) for label in labels}
    parts: list[str] = []
    for label, count in counts.items():
        plural = f"{label}es" if label.endswith(("s", "x", "ch", "sh")) else f"{label}s"
        parts.append(f"the {label}" if count == 1 else f"the {count} {plural}")
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


NOT_MENTIONED = 1000
"""More than any description counts: it does not mention them."""


def count_mentions(label: str, description: str) -> int:
    """Number of objects called ``label`` in a description; ``NOT_MENTIONED`` if it does not mention them."""
    counts = re.findall(rf"\bthe (?:(\d+) )?{re.escape(label)}(?:e?s)?\b", description)
    return sum(int(number or 1) for number in counts) if counts else NOT_MENTIONED
