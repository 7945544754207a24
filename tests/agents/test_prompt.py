"""Prompt templates are strict about their variables."""

from pathlib import Path

import pytest

from grs_agents.agents import find_template_variables, render_prompt_template
from grs_agents.errors import ConfigError


def template(folder: Path, text: str) -> Path:
    file = folder / "prompt.md"
    file.write_text(text, encoding="utf-8")
    return file


def test_values_are_never_scanned_again(tmp_path: Path) -> None:
    file = template(tmp_path, "code: {{code}} task: {{ task }}")
    assert render_prompt_template(file, {"code": "x = '{{task}}'", "task": "T"}) == "code: x = '{{task}}' task: T"


@pytest.mark.parametrize("values", [{}, {"code": "c"}, {"code": "c", "task": "t", "more": "m"}])
def test_missing_and_unused_variables_are_errors(tmp_path: Path, values: dict[str, str]) -> None:
    with pytest.raises(ConfigError, match=r"prompt\.md"):
        render_prompt_template(template(tmp_path, "{{code}} {{task}}"), values)


def test_single_braces_are_text() -> None:
    assert find_template_variables("{code} {{code}} {'a': {1: 2}}") == {"code"}
