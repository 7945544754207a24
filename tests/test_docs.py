"""The documentation says what the code does: every key, verb, option and event, with its default."""

import json
import re
from pathlib import Path
from typing import Any, get_args

import pytest
from typer.core import TyperGroup
from typer.main import get_command

from grs_agents.cli.app import app
from grs_agents.config import Config
from grs_agents.config.model import ROLE_ALIASES, ROLES
from grs_agents.trace import Event

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])


def page(name: str) -> str:
    """A page of the documentation."""
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


def rows(text: str) -> list[list[str]]:
    """The cells of every table row, with the code marks taken off."""
    lines = [line for line in text.splitlines() if line.startswith("| `")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def leaves(tree: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Dotted key to value."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        flat.update(leaves(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value})
    return flat


def test_every_configuration_key_is_documented_with_its_default() -> None:
    documented = {cells[0].strip("`"): json.loads(cells[1].strip("`")) for cells in rows(page("configuration.md"))}
    actual = {
        key.replace("models.default.", "models.ROLE."): value for key, value in leaves(Config().model_dump()).items()
    }
    assert documented == actual


def test_every_role_is_documented() -> None:
    text = page("configuration.md")
    assert all(f"`{role}`" in text for role in [*ROLES, *ROLE_ALIASES])


def commands() -> dict[str, Any]:
    """The verbs of the command line."""
    group = get_command(app)
    assert isinstance(group, TyperGroup)
    return dict(group.commands)


def test_every_verb_is_documented() -> None:
    documented = {cells[0].strip("`").split()[1] for cells in rows(page("cli.md")) if cells[0].startswith("`grs ")}
    assert documented == set(commands())


def test_every_option_is_documented_with_its_verbs() -> None:
    documented = {
        cells[0].strip("`").split()[0]: {verb.strip() for verb in cells[1].split(",")}
        for cells in rows(page("cli.md"))
        if cells[0].startswith("`--")
    }
    actual: dict[str, set[str]] = {}
    for verb, command in commands().items():
        for parameter in command.params:
            for option in parameter.opts:
                if option.startswith("--") and option != "--help":
                    actual.setdefault(option, set()).add(verb)
    assert documented == actual


def test_every_event_is_documented() -> None:
    union = get_args(get_args(Event)[0])
    assert {cells[0].strip("`") for cells in rows(page("traces.md"))} >= {
        kind.model_fields["kind"].default for kind in union
    }


def test_the_readme_opens_with_the_two_commands() -> None:
    opening = (ROOT / "README.md").read_text(encoding="utf-8")[:1500]
    targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    for target in ("demo", "test"):
        assert f"make {target}" in opening
        assert target in targets


@pytest.mark.parametrize("file", PAGES, ids=lambda file: file.name)
def test_every_link_to_a_file_leads_somewhere(file: Path) -> None:
    text = re.sub(r"```.*?```", "", file.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", text):
        if not target.startswith(("http://", "https://")):
            assert (file.parent / target).exists(), f"{file.name} links to {target}"
