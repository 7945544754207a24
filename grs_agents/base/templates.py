"""Jinja templates: HTML and Markdown files of the package, beside the module that fills them in."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grs_agents.base.control_characters import escape_control_chars

if TYPE_CHECKING:
    from jinja2 import Template


def load_template(file: Path, **filters: Callable[[str], str]) -> "Template":
    """The template in ``file``, which may use ``filters`` and the templates beside it.

    A name without a value is an error. In ``.html`` files values are escaped, with control characters spelt out;
    Markdown has no such rule, so its templates pass foreign text through a filter.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined  # spares most commands 45 ms

    html = file.suffix == ".html"
    environment = Environment(
        loader=FileSystemLoader(file.parent),
        undefined=StrictUndefined,
        autoescape=html,
        finalize=_spell_out_control_chars if html else None,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(filters)
    return environment.get_template(file.name)


def _spell_out_control_chars(value: Any) -> Any:
    """A value as text without control characters; markup of the template's macros as it is."""
    return value if hasattr(value, "__html__") else escape_control_chars(str(value))
