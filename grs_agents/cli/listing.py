"""``grs list`` and ``grs config``."""

import ast
import json
import re
import shlex
from importlib.metadata import entry_points

from rich.table import Table
from rich.text import Text

from grs_agents.base import content, terminal
from grs_agents.base.config.load import EffectiveConfig, flatten_tree
from grs_agents.base.python_parsing import parse_python
from grs_agents.base.terminal import print_json


def list_content(as_json: bool) -> None:
    """Print all names for the configuration, with the first line of their documentation."""
    from grs_agents.graph.policies.policy_registry import POLICIES
    from grs_agents.library.library import Library
    from grs_agents.models.factory import OFFLINE, PROVIDERS

    listed: dict[str, dict[str, str]] = {kind: _read_file_summaries(kind) for kind in content.KINDS if kind != "assets"}
    listed["assets"] = {asset.name: asset.description for asset in Library().assets()}
    listed["scenes"] = {name: f"a sample scene: grs run {shlex.quote(name)}" for name in content.sample_scenes()}
    listed["cassettes"] = {
        name: f"a recorded run: grs run --cassette {shlex.quote(name)}" for name in content.shipped_cassettes()
    }
    listed["policies"] = {name: _first_line(policy.__doc__) for name, policy in POLICIES.items()}
    listed["models"] = {OFFLINE: "Rules; needs no key."} | {
        f"{name}:NAME": f"{provider.model_class} of {provider.module}; {provider.install_command}"
        for name, provider in PROVIDERS.items()
    }
    for kind in ("policies", "models"):
        installed = {entry.name: entry.value for entry in entry_points(group=f"grs_agents.{kind}")}
        listed[kind] |= _read_file_summaries(kind) | installed
    if as_json:
        print_json(listed)
        return
    console = terminal.make_console()
    for kind, entries in listed.items():
        table = Table("name", "what it is", title=kind, title_justify="left", expand=False)
        for name, text in entries.items():
            table.add_row(Text(name), Text(text))
        console.print(table)


def list_config(effective: EffectiveConfig, as_json: bool) -> None:
    """Print each key with its value and source."""
    values = flatten_tree(effective.config.model_dump(mode="json"))
    sources = {key: effective.sources.get(key, "default") for key in values}
    if as_json:
        print_json({key: {"value": value, "source": sources[key]} for key, value in values.items()})
        return
    table = Table("key", "value", "source")
    for key, value in values.items():
        table.add_row(key, Text(json.dumps(value)), Text(sources[key]))
    terminal.make_console().print(table)


def _read_file_summaries(kind: content.Kind) -> dict[str, str]:
    """First line of the docstring of each module, or first sentence of each prompt; nothing is imported."""
    summaries: dict[str, str] = {}
    for name in content.content_names(kind):
        file = content.content_path(kind, name)
        text = file.read_text(encoding="utf-8")
        if file.suffix == ".py":
            summaries[name] = _first_line(ast.get_docstring(parse_python(text)))
        else:
            paragraphs = [part for part in text.split("\n\n") if not part.startswith(("#", "---"))]
            summaries[name] = " ".join(paragraphs[0].split()).partition(". ")[0].rstrip(".") + "."
    return summaries


def _first_line(text: str | None) -> str:
    """The first line of a docstring, with quotation marks instead of backticks."""
    return re.sub("`+", "'", (text or "").strip().split("\n", 1)[0])
