"""Read a prompt as the offline model gets it: a role line, ``## `` sections, fenced bodies."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

Json = dict[str, Any]
_ROLE = re.compile(r"^# Role:[ \t]*([a-z_]+)[ \t]*$", re.MULTILINE)
_FENCE = re.compile(r"^(`{3,}|~{3,})")


@dataclass(frozen=True)
class PromptText:
    """A prompt taken apart.

    Attributes:
        role: what the ``# Role:`` line says.
        sections: lower-case title -> body: the content of the section's first fenced block, or its plain text.
    """

    role: str
    sections: Mapping[str, str]

    def body(self, title: str) -> str:
        """The body of a section, empty where there is none."""
        return self.sections.get(title, "")

    def json(self, title: str) -> Json:
        """The section's JSON object; an empty one where the body is something else."""
        value = read_json(self.body(title))
        return cast(Json, value) if isinstance(value, dict) else {}

    def rows(self, title: str) -> list[Json]:
        """The section's JSON objects: one a line, or an array of them."""
        body = self.body(title)
        whole = read_json(body)
        values = cast(list[Any], whole) if isinstance(whole, list) else [read_json(row) for row in body.splitlines()]
        return [cast(Json, value) for value in values if isinstance(value, dict)]


def read_prompt(text: str) -> PromptText | None:
    """Take a prompt apart; None where no line names a role."""
    found = _ROLE.search(text)
    return None if found is None else PromptText(found.group(1), _sections(text[found.end() :]))


def read_json(text: str) -> Any:
    """The value that ``text`` spells, or None."""
    try:
        return json.loads(text)
    except ValueError:
        return None


def _sections(text: str) -> dict[str, str]:
    plain: dict[str, list[str]] = {}
    fenced: dict[str, list[str]] = {}
    closed: set[str] = set()
    title, fence = "", ""
    for line in text.splitlines():
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
    return bodies | {name: "\n".join(lines) for name, lines in fenced.items()}


def words(text: str) -> list[str]:
    """The lower-case words of a name or sentence; CamelCase and digits are split."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    return re.findall(r"[a-z]+", spaced.lower())


def identifier(text: str) -> str:
    """A Python identifier that resembles ``text``."""
    slug = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_") or "thing"
    return slug if slug[0].isalpha() else f"thing_{slug}"
