"""Prompt templates: Markdown with strict ``{{variables}}``."""

import re
from collections.abc import Mapping
from pathlib import Path

from grs_agents.errors import ConfigError

_VARIABLE = re.compile(r"\{\{\s*([a-z_]+)\s*\}\}")


def variables(template: str) -> frozenset[str]:
    """The names of the variables in ``template``."""
    return frozenset(_VARIABLE.findall(template))


def render(file: Path, values: Mapping[str, str]) -> str:
    """Fill the template in ``file``; inserted text is never scanned for variables again.

    Raises:
        ConfigError: the template wants a variable that is not given, or leaves a given one out.
    """
    template = file.read_text(encoding="utf-8")
    wanted = variables(template)
    if wanted != frozenset(values):
        unknown, unused = sorted(wanted - set(values)), sorted(set(values) - wanted)
        raise ConfigError(
            f"prompt {file.name} has unknown variables {unknown} and leaves out {unused}",
            f"use exactly: {', '.join(sorted(values))}",
        )
    return _VARIABLE.sub(lambda found: values[found.group(1)], template)
