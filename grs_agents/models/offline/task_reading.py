"""Parser of tasks into clauses, each with its objects and their destination.

Words that no family covers are refused.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from grs_agents.base.errors import GrsError
from grs_agents.models.offline.plan import Family
from grs_agents.models.offline.prompt_text import Json, PromptObject, split_words
from grs_agents.models.offline.task_wording import infer_task_family


class UnplannableTaskError(GrsError):
    """A task that the offline model cannot write; the message gives the reason."""


@dataclass(frozen=True)
class Clause:
    """A part of a task."""

    family: Family
    text: str  # its words, lower case
    moved: tuple[PromptObject, ...]  # the objects to move, in the order in which they are named
    support: PromptObject | None  # the object of the scene that receives them and keeps its place


_VERB = r"(?:put|place|pack|stack|sort|group|line up|arrange|clear|move|swap|exchange|set|lay|stand|bring)\b"
_BACK_REFERENCE = r"(?:it|them|both|each|all|everything)\b"
_NEXT_CLAUSE = re.compile(rf"[.;]\s+|,?\s+(?:and )?then\s+|,?\s+and\s+(?={_VERB}(?!\s+{_BACK_REFERENCE}))", re.I)
_WHERETO = r"\b(?:into|onto|inside|upon|on|in)(?: top of)?(?: (?:the|a|an|its|their))?(?: \w+)? "
_NOT_COVERED = re.compile(
    r"\bnext to|\bbeside|\bbetween|\bleft\b|\bright\b|\bbehind|\bin front|\baround|\bcircle|\btriangle|\bpyramid"
    r"|\bmirror|\bupside|\bpour|\bpush|\bsweep|\brotate|\bturn\b|\btilt|\bhang|\balternat|\bexcept\b|\bleave|\bnear\b"
    r"|\bclose to\b|\bedge\b|\bcorner|\bsmall|\blarge|\bbig|\bheav|\blight"
)
_ORDER_NOT_COVERED = re.compile(r"\bby (?!side|colou?r|kind|categor|type|height|their (?:colou?r|kind|type|height))\w+")


def parse_clauses(task: Json, objects: Sequence[PromptObject]) -> list[Clause]:
    """Parse the clauses of ``task``; ``objects`` are the scene's objects that it names.

    Raises:
        UnplannableTaskError: no family covers the words.
    """
    name, description = str(task.get("task-name", "")), str(task.get("task-description", "")).strip()
    texts = [text.strip(" .").lower() for text in _NEXT_CLAUSE.split(description) if text.strip(" .")] or [""]
    spoken = [_find_mentioned_objects(text, objects) for text in texts]
    named = {obj.name for mentions in spoken for obj in mentions}
    unnamed = [obj for obj in objects if obj.name not in named]
    clauses: list[Clause] = []
    for text, mentions in zip(texts, spoken, strict=True):
        ends = [obj for obj, pattern in mentions.items() if re.search(f"{_WHERETO}{pattern}", text)]
        ends = [obj for obj in ends if obj.hollow] or ends
        plain = text  # without labels, which might pass for a word about the family
        for obj, pattern in sorted(mentions.items(), key=lambda item: -len(item[1])):
            plain = re.sub(pattern, "container" if obj in ends and obj.hollow else "it", plain)
        family = infer_task_family(name if len(texts) == 1 else "", plain)
        order = _ORDER_NOT_COVERED.search(plain) if family in ("sort", "line") else None
        if beyond := _NOT_COVERED.search(plain) or order:
            raise UnplannableTaskError(f"the words {beyond[0]!r} of the task ask for what no task family here does")
        # The object that receives the others: a mentioned object in that place, or an unnamed container.
        support = None
        if family in ("pack", "stack", "place"):
            if len(ends) > 1:
                places = f"{ends[0].label} and {ends[1].label}"
                raise UnplannableTaskError(f"{places} are both places for things in one sentence")
            assets = {obj.asset for obj in mentions}
            containers = [obj for obj in unnamed if obj.hollow and obj.asset not in assets] if family == "pack" else []
            support = next(iter([*ends, *containers]), None)
        if family == "place" and support:
            family = "pack" if support.hollow else "stack"
        moved = tuple(obj for obj in mentions if obj is not support) or tuple(unnamed)
        clauses.append(Clause(family, text, tuple(obj for obj in moved if obj is not support), support))
    return clauses


def find_assets_said_to_move(task: Json) -> tuple[str, ...]:
    """Assets that the words of ``task`` name as objects to move, not only as places."""
    text = str(task.get("task-description", "")).lower()
    stems = {str(asset): _split_asset_name(str(asset)) for asset in task.get("assets-used", [])}
    ends = [asset for asset, stem in stems.items() if re.search(f"{_WHERETO}{_make_label_regex(stem)}", text)]
    called = [asset for asset, stem in stems.items() if stem and re.search(_make_label_regex(stem), text)]
    return tuple(asset for asset in called if asset not in ends)


def _split_asset_name(asset: str) -> str:
    return " ".join(split_words(asset.rsplit("/", 1)[-1].removesuffix(".urdf")))


def _find_mentioned_objects(text: str, objects: Sequence[PromptObject]) -> dict[PromptObject, str]:
    """The objects that ``text`` mentions, in order, each with the pattern of its words."""
    labelled = {obj.asset for obj in objects if re.search(_make_label_regex(obj.label), text)}
    mentions: list[tuple[int, PromptObject, str]] = []
    for obj in objects:
        names, plurals = [obj.label], list[str]()
        if obj.asset not in labelled:  # names other than the label, the most specific first
            names += [f"{obj.color} {obj.category}"]
            names += [] if obj.asset.startswith("proxy/") else [_split_asset_name(obj.asset)]
            plural = rf"\b(?:the|all|both)(?: two| three| four| \d)? {re.escape(obj.category)}e?s\b"
            plurals += [plural] if obj.category else []
        patterns = [*map(_make_label_regex, names), *plurals]
        places = [(place.start(), obj, pattern) for pattern in patterns if (place := re.search(pattern, text))]
        mentions += places[:1]
    return {obj: pattern for _, obj, pattern in sorted(mentions, key=lambda item: item[0])}


def _make_label_regex(label: str) -> str:
    return rf"\b{re.escape(label)}(?:e?s)?\b"
