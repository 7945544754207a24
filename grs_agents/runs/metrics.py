"""Measured quantities of experiments, with their bounds."""

import resource
from collections.abc import Sequence
from typing import Any

from rich.table import Table

from grs_agents.base import Frozen


class Figure(Frozen):
    """A measured quantity."""

    name: str
    value: float | None  # None if not measured
    target: float | None = None  # its bound; None for an explanatory quantity
    unit: str = ""
    smaller_is_better: bool = True  # the target is an upper bound

    @property
    def is_target_met(self) -> bool | None:
        """True if the target is met; None without a value or a target."""
        if self.value is None or self.target is None:
            return None
        return self.value <= self.target if self.smaller_is_better else self.value >= self.target

    def format_target_value(self) -> str:
        """The target with its sign and unit; empty without a target."""
        sign = "<=" if self.smaller_is_better else ">="
        return "" if self.target is None else f"{sign} {self.target:g} {self.unit}".rstrip()


def metrics_to_dicts(figures: Sequence[Figure]) -> list[dict[str, Any]]:
    """The figures as plain JSON, each with ``reached``."""
    return [{**figure.model_dump(), "reached": figure.is_target_met} for figure in figures]


def figures_table(figures: Sequence[Figure]) -> list[dict[str, str]]:
    """The measured figures as rows of a table."""
    return [
        {
            "figure": figure.name,
            "measured": f"{figure.value:.3g} {figure.unit}".rstrip(),
            "target": figure.format_target_value(),
        }
        for figure in figures
        if figure.value is not None
    ]


def metrics_table(title: str, figures: Sequence[Figure]) -> Table:
    """The measured figures as a table for the terminal."""
    table = Table("figure", "measured", "target", "", title=title)
    for figure in figures:
        if figure.value is not None:
            missed = "missed" if figure.is_target_met is False else ""
            table.add_row(figure.name, f"{figure.value:.3g} {figure.unit}", figure.format_target_value(), missed)
    return table


def cpu_seconds() -> float:
    """CPU time of this process and of its ended children, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)
