"""Read what a task of any author asks for: the clauses of its description, each with what it moves and whereto.

Words that no family covers are refused, never taken for something else.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from grs_agents.base.errors import GrsError
from grs_agents.models.offline.plan import Family
from grs_agents.models.offline.prompt_text import Json, SceneObject, split_words
from grs_agents.models.offline.task_wording import infer_task_family


class UnplannableTaskError(GrsError):
    """A task that asks for what the offline model cannot write; the message says for what."""


@dataclass(frozen=True)
class Clause:
    """One thing that a task asks for."""

    family: Family
    text: str  # its words, lower case
    moved: tuple[SceneObject, ...]  # the objects to move, in the order in which they are named
    support: SceneObject | None  # the object of the scene that they go into or onto, which stays where it is


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


def parse_clauses(task: Json, objects: Sequence[SceneObject]) -> list[Clause]:
    """What ``task`` asks for; ``objects`` are those of the scene that it names.

    Raises:
        UnplannableTaskError: it asks for something that no family does.
    """
    name, description = str(task.get("task-name", "")), str(task.get("task-description", "")).strip()
    texts = [text.strip(" .").lower() for text in _NEXT_CLAUSE.split(description) if text.strip(" .")] or [""]
    spoken = [_find_mentioned_objects(text, objects) for text in texts]
    named = {obj.name for mentions in spoken for obj in mentions}
    unnamed = [obj for obj in objects if obj.name not in named]
    return [
        _parse_clause(name if len(texts) == 1 else "", text, mentions, unnamed)
        for text, mentions in zip(texts, spoken, strict=True)
    ]


def _parse_clause(name: str, text: str, mentions: Mapping[SceneObject, str], unnamed: Sequence[SceneObject]) -> Clause:
    ends = _find_objects_used_as_places(text, mentions)
    plain = _replace_object_mentions(text, mentions, ends)
    family = infer_task_family(name, plain)
    _require_words_are_plannable(plain, family)
    support = _choose_support_object(family, ends, mentions, unnamed)
    if family == "place" and support:
        family = "pack" if support.hollow else "stack"
    moved = tuple(obj for obj in mentions if obj is not support) or tuple(unnamed)
    return Clause(family, text, tuple(obj for obj in moved if obj is not support), support)


def _find_objects_used_as_places(text: str, mentions: Mapping[SceneObject, str]) -> list[SceneObject]:
    """The objects that ``text`` puts others into or onto; hollow ones alone where there are such."""
    ends = [obj for obj, pattern in mentions.items() if re.search(f"{_WHERETO}{pattern}", text)]
    return [obj for obj in ends if obj.hollow] or ends


def _require_words_are_plannable(text: str, family: Family) -> None:
    order = _ORDER_NOT_COVERED.search(text) if family in ("sort", "line") else None
    if found := _NOT_COVERED.search(text) or order:
        raise UnplannableTaskError(f"the words {found[0]!r} of the task ask for what no task family here does")


def _replace_object_mentions(text: str, mentions: Mapping[SceneObject, str], ends: Sequence[SceneObject]) -> str:
    """``text`` with what it calls the objects replaced, so that no label passes for a word about the family."""
    for obj, pattern in sorted(mentions.items(), key=lambda item: -len(item[1])):
        text = re.sub(pattern, "container" if obj in ends and obj.hollow else "it", text)
    return text


def _choose_support_object(
    family: Family, ends: Sequence[SceneObject], mentions: Iterable[SceneObject], unnamed: Sequence[SceneObject]
) -> SceneObject | None:
    """The object that others are put into or onto: one that the words put there, or a container that they only call so.

    Raises:
        UnplannableTaskError: there are several.
    """
    if family not in ("pack", "stack", "place"):
        return None
    if len(ends) > 1:
        raise UnplannableTaskError(f"{ends[0].label} and {ends[1].label} are both places for things in one sentence")
    spoken = {obj.asset for obj in mentions}
    containers = [obj for obj in unnamed if obj.hollow and obj.asset not in spoken] if family == "pack" else []
    return next(iter([*ends, *containers]), None)


def find_assets_said_to_move(task: Json) -> tuple[str, ...]:
    """The assets that the words of ``task`` call by their own names and do not only name as the place to put things."""
    text = str(task.get("task-description", "")).lower()
    stems = {str(asset): _split_asset_name(str(asset)) for asset in task.get("assets-used", [])}
    ends = [asset for asset, stem in stems.items() if re.search(f"{_WHERETO}{_make_label_regex(stem)}", text)]
    called = [asset for asset, stem in stems.items() if stem and re.search(_make_label_regex(stem), text)]
    return tuple(asset for asset in called if asset not in ends)


def _split_asset_name(asset: str) -> str:
    return " ".join(split_words(asset.rsplit("/", 1)[-1].removesuffix(".urdf")))


def _find_mentioned_objects(text: str, objects: Sequence[SceneObject]) -> dict[SceneObject, str]:
    """The objects that ``text`` speaks of, in its order, each with the pattern of the words it uses."""
    labelled = {obj.asset for obj in objects if re.search(_make_label_regex(obj.label), text)}
    found: list[tuple[int, SceneObject, str]] = []
    for obj in objects:
        patterns = [_make_label_regex(obj.label), *([] if obj.asset in labelled else _make_other_name_regexes(obj))]
        places = [(place.start(), obj, pattern) for pattern in patterns if (place := re.search(pattern, text))]
        found += places[:1]
    return {obj: pattern for _, obj, pattern in sorted(found, key=lambda item: item[0])}


def _make_label_regex(label: str) -> str:
    return rf"\b{re.escape(label)}(?:e?s)?\b"


def _make_other_name_regexes(obj: SceneObject) -> list[str]:
    """Patterns of what people may call an object where they do not use its label, the most telling first."""
    kinds = [f"{obj.color} {obj.category}", *([] if obj.asset.startswith("proxy/") else [_split_asset_name(obj.asset)])]
    plural = rf"\b(?:the|all|both)(?: two| three| four| \d)? {re.escape(obj.category)}e?s\b"
    return [*map(_make_label_regex, kinds), *([plural] if obj.category else [])]
