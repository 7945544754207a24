"""Prompt files: front matter that declares role, inputs and form of the reply, then a text with ``{{variables}}``.

A rule ``---`` ends the system message, which holds what stays equal between calls (role, rules, API), so that a
provider's prompt cache serves it; the user message follows. A file without the rule is a user message.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from pydantic import ValidationError

from grs_agents.base import Frozen
from grs_agents.base.errors import ConfigError

if TYPE_CHECKING:  # takes long to import
    from langchain_core.messages import BaseMessage

ReplyForm = Literal["json", "python", "verdict"]
_FRONT_MATTER = re.compile(r"---\n(.*?\n)---\n", re.DOTALL)
_SYSTEM_END = re.compile(r"^---\n+", re.MULTILINE)
_VARIABLE = re.compile(r"\{\{\s*([a-z_]+)\s*\}\}")


class PromptTemplate(Frozen):
    """A parsed prompt file."""

    role: str  # the agent that answers
    inputs: tuple[str, ...]  # exactly the variables of the text
    reply: ReplyForm  # form of the end of the reply: a JSON object, a Python program or a verdict
    system: str  # text of the system message, with variables; may be empty
    user: str  # text of the user message, with variables


@dataclass(frozen=True)
class RenderedPrompt:
    """The texts of a prompt's messages."""

    system: str
    user: str

    def to_messages(self, images: Sequence[Mapping[str, str]] = ()) -> list["BaseMessage"]:
        """The system message, if any, and the user message, whose ``images`` (blocks) follow its text."""
        from langchain_core.messages import HumanMessage, SystemMessage

        blocks: list[str | dict[Any, Any]] = [{"type": "text", "text": self.user}, *map(dict[Any, Any], images)]
        return [*([SystemMessage(self.system)] if self.system else []), HumanMessage(content=blocks)]


def render_prompt_template(file: Path, role: str, values: Mapping[str, str]) -> RenderedPrompt:
    """Fill in the prompt in ``file``; inserted text is not scanned.

    Raises:
        ConfigError: it is no prompt of ``role``, or its inputs differ from the role's.
    """
    template = read_prompt_template(file)
    if (template.role, set(template.inputs)) != (role, set(values)):
        raise ConfigError(
            f"prompt {file.name} is one of {template.role} with the inputs {', '.join(sorted(template.inputs))}",
            f"declare role: {role} and inputs: {', '.join(sorted(values))}",
        )
    system, user = (
        _VARIABLE.sub(lambda match: values[match.group(1)], text) for text in (template.system, template.user)
    )
    return RenderedPrompt(system, user)


def read_prompt_template(file: Path) -> PromptTemplate:
    """Read a prompt file.

    Raises:
        ConfigError: it has no front matter, or its text's variables differ from the declared inputs.
    """
    content = file.read_text(encoding="utf-8")
    remedy = f"begin it with --- and the lines role: NAME, inputs: A, B, reply: {' | '.join(get_args(ReplyForm))}, ---"
    head = _FRONT_MATTER.match(content)
    if head is None:
        raise ConfigError(f"prompt {file.name} has no front matter", remedy)
    pairs = (line.partition(":") for line in head.group(1).splitlines())
    fields: dict[str, object] = {key.strip(): value.strip() for key, _, value in pairs}
    fields["inputs"] = tuple(filter(None, (name.strip() for name in str(fields.get("inputs", "")).split(","))))
    *before, user = _SYSTEM_END.split(content[head.end() :], maxsplit=1)
    system = before[0].strip() if before else ""
    try:
        template = PromptTemplate.model_validate({**fields, "system": system, "user": user})
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigError(f"prompt {file.name}: {first['loc'][0]}: {first['msg']}", remedy) from error
    used = frozenset(_VARIABLE.findall(template.system + template.user))
    if used != frozenset(template.inputs):
        differing = sorted(used ^ frozenset(template.inputs))
        raise ConfigError(
            f"prompt {file.name}: {differing} are either declared or used, not both",
            f"declare what the text uses: inputs: {', '.join(sorted(used))}",
        )
    return template
