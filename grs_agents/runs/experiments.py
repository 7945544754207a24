"""Discovery of experiments, and their tables for the terminal and in Markdown."""

import argparse
import sys
from collections.abc import Sequence
from types import ModuleType
from typing import Any

from rich.table import Table
from rich.text import Text

from grs_agents.base import content
from grs_agents.base.errors import InputError

CHECKOUT_ONLY = (
    "ablation",
    "confidence",
    "correspondence",
    "perception",
    "retrieval_scale",
    "routing",
    "shapes",
    "twin",
)
"""Experiments on synthetic scenes, which need a checkout: wheels contain neither them nor their helpers."""


def load_experiment(name: str) -> ModuleType:
    """Load an experiment. In a checkout, the root is put first in ``sys.path``."""
    root = content.content_root()
    if name in CHECKOUT_ONLY and name not in content.content_names("evals"):
        remedy = "pip install -e '.[eval]' in a checkout of GRS, and run it there"
        raise InputError(f"experiment {name!r} needs a checkout: an installed GRS does not hold it", remedy)
    if root == content.package_root().parent and str(root) not in sys.path[:1]:
        sys.path.insert(0, str(root))
    return content.load_module("evals", name)


def terminal_table(title: str, columns: Sequence[str], rows: Sequence[dict[str, Any]]) -> Table:
    """The rows as a table for the terminal."""
    result = Table(*columns, title=title)
    for row in rows:
        result.add_row(*(Text(str(row[column])) for column in columns))
    return result


def markdown_table(columns: Sequence[str], rows: Sequence[dict[str, Any]]) -> str:
    """The rows as a Markdown table."""
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    lines += ["| " + " | ".join(str(row[column]).replace("|", "/") for column in columns) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def positive_int(text: str) -> int:
    """A whole number from 1, for ``argparse``."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{number} is less than 1")
    return number
