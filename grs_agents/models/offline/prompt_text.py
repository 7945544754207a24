"""Parser of the prompts: a role line, ``## `` sections, fenced bodies, the scene's objects."""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

Json = dict[str, Any]
_ROLE = re.compile(r"^# Role:[ \t]*([a-z_]+)[ \t]*$", re.MULTILINE)
_FENCE = re.compile(r"^(`{3,}|~{3,})")


@dataclass(frozen=True)
class PromptText:
    """A parsed prompt."""

    role: str  # of the `# Role:` line
    # lower-case title -> body: the content of the section's first fenced block, or its plain text
    sections: Mapping[str, str]

    def section_body(self, title: str) -> str:
        """The body of a section; empty if there is none."""
        return self.sections.get(title, "")

    def section_json(self, title: str) -> Json:
        """The section's JSON object; empty if the body is not an object."""
        value = parse_json_or_none(self.section_body(title))
        return cast(Json, value) if isinstance(value, dict) else {}

    def section_json_rows(self, title: str) -> list[Json]:
        """The section's JSON objects, a line each or in an array."""
        body = self.section_body(title)
        whole = parse_json_or_none(body)
        values = (
            cast(list[Any], whole)
            if isinstance(whole, list)
            else [parse_json_or_none(row) for row in body.splitlines()]
        )
        return [cast(Json, value) for value in values if isinstance(value, dict)]


def parse_prompt(text: str) -> PromptText | None:
    """Parse a prompt; None if no line names a role."""
    role = _ROLE.search(text)
    if role is None:
        return None
    plain: dict[str, list[str]] = {}
    fenced: dict[str, list[str]] = {}
    closed: set[str] = set()
    title, fence = "", ""
    for line in text[role.end() :].splitlines():
        mark = _FENCE.match(line)
        if fence:
            if mark and line.strip().startswith(fence) and not line.strip().strip(fence[0]):
                closed.add(title)
                fence = ""
            elif title not in closed:
                fenced.setdefault(title, []).append(line)
        elif mark:
            fence = mark.group(1)
        elif line.startswith("## "):
            title = line[3:].strip().lower()
        else:
            plain.setdefault(title, []).append(line)
    bodies = {name: "\n".join(lines).strip() for name, lines in plain.items()}
    return PromptText(role.group(1), bodies | {name: "\n".join(lines) for name, lines in fenced.items()})


def parse_json_or_none(text: str) -> Any:
    """The JSON value of ``text``, or None."""
    try:
        return json.loads(text)
    except ValueError:
        return None


def split_words(text: str) -> list[str]:
    """The lower-case words of a name or sentence; CamelCase and digits are split."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    return re.findall(r"[a-z]+", spaced.lower())


def make_identifier(text: str) -> str:
    """A Python identifier that resembles ``text``."""
    slug = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_") or "thing"
    return slug if slug[0].isalpha() else f"thing_{slug}"


Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

NEAR, FAR = 0.28, 0.80
"""Radii of the comfortable workspace from the robot's base, m."""
_RESERVE = 0.05
"""Difference of the reach and the comfortable reach, m."""
GAP = 0.02
"""The clearance left between neighbours, in metres."""
CUP_ROOM = 0.03
"""Free space (m) on every side of an object, within which the cup and its load touch no neighbour."""
_SEEN_HEIGHT = 0.02
"""Least visible difference in height (m)."""
HOLLOW_WORDS = frozenset({"bowl", "mug", "cup", "plate", "container", "basket", "tray", "bin"})
ROUND_WORDS = frozenset({"bottle", "jar", "ball", "sphere", "fruit", "bag", "pear", "apple", "banana", "toy"})
COLORS = ("red", "orange", "yellow", "green", "blue", "purple", "pink", "brown", "white", "gray", "black")
"""The colour names in use; the simulator has a value for each."""


@dataclass(frozen=True)
class Rect:
    """An axis-aligned rectangle on the table: centre and full extents in metres, robot frame."""

    x: float
    y: float
    width: float
    depth: float

    def overlaps(self, rect: "Rect", gap: float = 0.0) -> bool:
        """True if the two come closer than ``gap`` along both axes."""
        return (
            abs(self.x - rect.x) < (self.width + rect.width) / 2 + gap
            and abs(self.y - rect.y) < (self.depth + rect.depth) / 2 + gap
        )


@dataclass(frozen=True)
class PromptObject:
    """An object of the scene in a prompt."""

    name: str  # unique in the scene
    asset: str  # library name
    category: str  # lower case
    color: str  # name of its dominant colour
    position: Vector  # centre, metres, robot frame
    orientation: Quaternion  # rotation (xyzw)
    size: Vector  # extents along the robot's axes at its place, metres
    reachable: bool  # the arm can pick it there
    hollow: bool  # other objects can be put inside or on it
    floats: bool = False  # held at its place, since the photo does not show its support
    uneven_top: bool = False  # other objects would tip on it
    can_be_picked: bool = True  # the robot picked it at its place in a trial
    is_doubtful: bool = False  # the photo shows too little of it for a task
    far: float = FAR  # greatest comfortable radius from the robot's base, metres
    relocated: bool = False  # the program puts it elsewhere than the photo
    height: str = ""  # `tall`, `tallest`, `low` or `lowest`, if that distinguishes it from its kind and colour

    @property
    def footprint_rect(self) -> Rect:
        """Its footprint."""
        return Rect(self.position[0], self.position[1], self.size[0], self.size[1])

    @property
    def room(self) -> Vector:
        """Extents of its free space at another place: its size, and room for the cup on every side."""
        return (self.size[0] + 2 * CUP_ROOM, self.size[1] + 2 * CUP_ROOM, self.size[2])

    @property
    def label(self) -> str:
        """Everyday name, e.g. ``macaroni and cheese box`` or ``blue box``."""
        return f"{self.height} {self.kind}".strip()

    @property
    def kind(self) -> str:
        """Everyday name without a word for its height."""
        stem = self.asset.rsplit("/", 1)[-1].removesuffix(".urdf")
        if self.asset.startswith("proxy/"):
            kind = self.category if self.category not in ("proxy", "") else "object"
            return f"{self.color} {kind}".strip()
        name = split_words(stem)
        return " ".join(name if self.category in name or not self.category else [*name, self.category])

    @property
    def low(self) -> float:
        """The height of its underside, in metres."""
        return self.position[2] - self.size[2] / 2

    @property
    def is_flat_topped(self) -> bool:
        """True if another object would rest on it."""
        kinds = {*split_words(self.category), *split_words(self.asset.rsplit("/", 1)[-1]), *split_words(self.name)}
        return not self.hollow and not self.uneven_top and not kinds & ROUND_WORDS

    def relocate_to(self, x: float, y: float) -> "PromptObject":
        """The same object at another place on the table."""
        return replace(self, position=(x, y, self.size[2] / 2), relocated=True)


def parse_scene_objects(scene: Json) -> list[PromptObject]:
    """The objects of a scene section; entries without a name, asset, position or size are left out."""
    workspace = scene.get("workspace")
    radius = parse_finite_floats([cast(Json, workspace).get("radius")], 1) if isinstance(workspace, dict) else None
    far = FAR if radius is None else min(FAR, round(radius[0] - _RESERVE, 3))
    objects: list[PromptObject] = []
    for entry in (cast(Json, entry) for entry in _to_list_or_empty(scene.get("objects")) if isinstance(entry, dict)):
        position, size = parse_finite_floats(entry.get("position"), 3), parse_finite_floats(entry.get("size"), 3)
        asset = str(entry.get("asset") or "")
        if position is None or size is None or min(size) <= 0 or not asset:
            continue
        orientation = parse_finite_floats(entry.get("orientation"), 4) or (0.0, 0.0, 0.0, 1.0)
        category = str(entry.get("category") or "").lower()
        hollow_by_name = {category, *split_words(asset)} & HOLLOW_WORDS and not asset.startswith("proxy/")
        objects.append(
            PromptObject(
                name=str(entry.get("name") or asset),
                asset=asset,
                category=category,
                color=str(entry.get("color") or "").lower(),
                position=cast(Vector, position),
                orientation=cast(Quaternion, orientation),
                size=cast(Vector, size),
                reachable=bool(entry.get("reachable", True)),
                hollow=bool(entry.get("hollow") or hollow_by_name),
                floats=bool(entry.get("floats")),
                uneven_top=bool(entry.get("uneven_top")),
                can_be_picked=not entry.get("cannot_be_picked"),
                is_doubtful="too sparsely" in str(entry.get("cannot_be_picked")),
                far=far,
            )
        )
    heights: list[str] = []
    for obj in objects:
        rivals = [fellow.size[2] for fellow in objects if fellow is not obj and fellow.kind == obj.kind]
        height = ""
        if rivals and obj.size[2] >= max(rivals) + _SEEN_HEIGHT:
            height = "tall" if len(rivals) == 1 else "tallest"
        elif rivals and obj.size[2] <= min(rivals) - _SEEN_HEIGHT:
            height = "low" if len(rivals) == 1 else "lowest"
        heights.append(height)
    return [replace(obj, height=height) for obj, height in zip(objects, heights, strict=True)]


def parse_finite_floats(value: Any, count: int) -> tuple[float, ...] | None:
    """``value`` as a tuple of ``count`` finite floats, or None."""
    items = _to_list_or_empty(value)
    if len(items) != count or not all(isinstance(item, int | float) for item in items):
        return None
    floats = tuple(float(item) for item in items)
    return floats if all(math.isfinite(item) for item in floats) else None


def _to_list_or_empty(value: Any) -> list[Any]:
    return list(cast("list[Any] | tuple[Any, ...]", value)) if isinstance(value, list | tuple) else []
