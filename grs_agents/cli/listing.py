"""``grs list`` and ``grs config``."""

import ast
import json
import re
import shlex
from importlib.metadata import entry_points
from pathlib import Path

from rich.table import Table
from rich.text import Text

from grs_agents.base import content, terminal
from grs_agents.base.config.load import EffectiveConfig, flatten_tree
from grs_agents.base.python_parsing import parse_python
from grs_agents.base.terminal import print_json


def list_content(as_json: bool) -> None:
    """Print every name a configuration may hold, with its first line of documentation."""
    listed = _collect_content_descriptions()
    if as_json:
        print_json(listed)
        return
    console = terminal.make_console()
    for kind, entries in listed.items():
        table = Table("name", "what it is", title=kind, title_justify="left", expand=False)
        for name, text in entries.items():
            table.add_row(Text(name), Text(text))
        console.print(table)


def _collect_content_descriptions() -> dict[str, dict[str, str]]:
    """By kind, each name with what it is."""
    from grs_agents.graph.policies.policy_registry import POLICIES
    from grs_agents.library.library import Library

    listed: dict[str, dict[str, str]] = {kind: _read_file_summaries(kind) for kind in content.KINDS if kind != "assets"}
    listed["assets"] = {asset.name: asset.description for asset in Library().assets()}
    listed["scenes"] = {name: f"a sample scene: grs run {shlex.quote(name)}" for name in content.sample_scenes()}
    listed["cassettes"] = {
        name: f"a recorded run: grs run --cassette {shlex.quote(name)}" for name in content.shipped_cassettes()
    }
    listed["policies"] = {name: _first_line(policy.__doc__) for name, policy in POLICIES.items()}
    listed["models"] = _describe_model_providers()
    for kind in ("policies", "models"):
        installed = {entry.name: entry.value for entry in entry_points(group=f"grs_agents.{kind}")}
        listed[kind] |= _read_file_summaries(kind) | installed
    return listed


def list_config(effective: EffectiveConfig, as_json: bool) -> None:
    """Print each key with its value and where the value came from."""
    values = flatten_tree(effective.config.model_dump(mode="json"))
    sources = {key: effective.sources.get(key, "default") for key in values}
    if as_json:
        print_json({key: {"value": value, "source": sources[key]} for key, value in values.items()})
        return
    table = Table("key", "value", "source")
    for key, value in values.items():
        table.add_row(key, Text(json.dumps(value)), Text(sources[key]))
    terminal.make_console().print(table)


def _describe_model_providers() -> dict[str, str]:
    """What a model's name may begin with, and whose client then asks it."""
    from grs_agents.models.factory import OFFLINE, PROVIDERS

    clients = {
        f"{name}:NAME": f"{provider.model_class} of {provider.module}; {provider.install_command}"
        for name, provider in PROVIDERS.items()
    }
    return {OFFLINE: "Rules; needs no key.", **clients}


def _read_file_summaries(kind: content.Kind) -> dict[str, str]:
    """Each content file of a kind by name, with what it says it is."""
    return {name: _read_file_summary(content.content_path(kind, name)) for name in content.content_names(kind)}


def _read_file_summary(file: Path) -> str:
    """The first line of a module's docstring, or the first sentence of a prompt, without importing anything."""
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".py":
        return _first_line(ast.get_docstring(parse_python(text)))
    paragraphs = [part for part in text.split("\n\n") if not part.startswith(("#", "---"))]
    return " ".join(paragraphs[0].split()).partition(". ")[0].rstrip(".") + "."


def _first_line(text: str | None) -> str:
    """The first line of a docstring; names in the backticks of reStructuredText stand in quotation marks."""
    return re.sub("`+", "'", (text or "").strip().split("\n", 1)[0])
