"""Prompt files are strict: about their front matter, their variables and the role that they are for."""

from pathlib import Path

import pytest

from grs_agents.agents.prompt_template import read_prompt_template, render_prompt_template
from grs_agents.base.errors import ConfigError

HEAD = "---\nrole: tests\ninputs: code, task\nreply: python\n---\n"


def prompt_file(folder: Path, text: str) -> Path:
    file = folder / "prompt.md"
    file.write_text(text, encoding="utf-8")
    return file


def test_values_are_never_scanned_again_and_the_front_matter_is_not_shown(tmp_path: Path) -> None:
    file = prompt_file(tmp_path, f"{HEAD}code: {{{{code}}}} task: {{{{ task }}}} {{code}}")
    shown = render_prompt_template(file, "tests", {"code": "x = '{{task}}'", "task": "T"})
    assert (shown.system, shown.user) == ("", "code: x = '{{task}}' task: T {code}")
    template = read_prompt_template(file)
    assert (template.role, template.inputs, template.reply) == ("tests", ("code", "task"), "python")


def test_a_rule_ends_the_system_message_and_pictures_follow_the_text(tmp_path: Path) -> None:
    file = prompt_file(tmp_path, f"{HEAD}# Role: tests\n\n---\n\n{{{{code}}}} {{{{task}}}}\n")
    image = {"type": "image", "base64": "AAAA", "mime_type": "image/jpeg"}
    shown = render_prompt_template(file, "tests", {"code": "---\nc", "task": "T"})
    system, user = shown.to_messages([image])
    assert (system.type, system.content, user.type) == ("system", "# Role: tests", "human")
    assert user.content == [{"type": "text", "text": "---\nc T\n"}, image]


@pytest.mark.parametrize("values", [{}, {"code": "c"}, {"code": "c", "task": "t", "more": "m"}])
def test_a_prompt_gets_what_it_declares_and_nothing_else(tmp_path: Path, values: dict[str, str]) -> None:
    with pytest.raises(ConfigError, match=r"prompt\.md"):
        render_prompt_template(prompt_file(tmp_path, f"{HEAD}{{{{code}}}} {{{{task}}}}"), "tests", values)


def test_a_prompt_of_another_role_is_refused(tmp_path: Path) -> None:
    file = prompt_file(tmp_path, f"{HEAD}{{{{code}}}} {{{{task}}}}")
    with pytest.raises(ConfigError, match="role: route"):
        render_prompt_template(file, "route", {"code": "c", "task": "t"})


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("# Role: tests\n{{code}}", "no front matter"),
        (f"{HEAD}{{{{code}}}}", "task"),
        (f"{HEAD}{{{{code}}}} {{{{task}}}} {{{{more}}}}", "more"),
        (HEAD.replace("python", "poem"), "reply"),
        (HEAD.replace("role", "roll"), "role"),
    ],
)
def test_a_prompt_that_does_not_declare_itself_is_refused(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        read_prompt_template(prompt_file(tmp_path, text))
