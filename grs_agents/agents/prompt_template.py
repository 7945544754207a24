"""Prompt files: front matter that declares role, inputs and form of the reply, then a text with ``{{variables}}``."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, get_args

from pydantic import ValidationError

from grs_agents.base import Frozen
from grs_agents.base.errors import ConfigError

ReplyForm = Literal["json", "python", "verdict"]
_FRONT_MATTER = re.compile(r"---\n(.*?\n)---\n", re.DOTALL)
_VARIABLE = re.compile(r"\{\{\s*([a-z_]+)\s*\}\}")


class PromptTemplate(Frozen):
    """A parsed prompt file."""

    role: str  # the agent that answers
    inputs: tuple[str, ...]  # exactly the variables of the text
    reply: ReplyForm  # form of the end of the reply: a JSON object, a Python program or a verdict
    text: str  # the prompt, with variables


def render_prompt_template(file: Path, role: str, values: Mapping[str, str]) -> str:
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
    return _VARIABLE.sub(lambda match: values[match.group(1)], template.text)


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
    try:
        template = PromptTemplate.model_validate({**fields, "text": content[head.end() :]})
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigError(f"prompt {file.name}: {first['loc'][0]}: {first['msg']}", remedy) from error
    used = frozenset(_VARIABLE.findall(template.text))
    if used != frozenset(template.inputs):
        differing = sorted(used ^ frozenset(template.inputs))
        raise ConfigError(
            f"prompt {file.name}: {differing} are either declared or used, not both",
            f"declare what the text uses: inputs: {', '.join(sorted(used))}",
        )
    return template
