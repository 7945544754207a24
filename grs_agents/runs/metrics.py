"""Measured quantities with the bounds they should keep, as experiments show them."""

import resource
from collections.abc import Sequence
from typing import Any

from rich.table import Table

from grs_agents.base import Frozen


class Figure(Frozen):
    """One measured quantity."""

    name: str
    value: float | None  # None where nothing was
    target: float | None = None  # the bound it should keep; None for what only explains another
    unit: str = ""
    smaller_is_better: bool = True  # which side of the target is good

    @property
    def is_target_met(self) -> bool | None:
        """Whether the target is kept; None without a value or a target."""
        if self.value is None or self.target is None:
            return None
        return self.value <= self.target if self.smaller_is_better else self.value >= self.target

    def format_target_value(self) -> str:
        """The target with its sign and unit; empty without one."""
        sign = "<=" if self.smaller_is_better else ">="
        return "" if self.target is None else f"{sign} {self.target:g} {self.unit}".rstrip()


def metrics_to_dicts(figures: Sequence[Figure]) -> list[dict[str, Any]]:
    """The figures as plain JSON, each with whether its target is kept."""
    return [{**figure.model_dump(), "reached": figure.is_target_met} for figure in figures]


def figures_table(figures: Sequence[Figure]) -> list[dict[str, str]]:
    """The figures that were measured as rows of a table, in words for people."""
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
    """The figures that were measured, for a terminal."""
    table = Table("figure", "measured", "target", "", title=title)
    for figure in figures:
        if figure.value is not None:
            missed = "missed" if figure.is_target_met is False else ""
            table.add_row(figure.name, f"{figure.value:.3g} {figure.unit}", figure.format_target_value(), missed)
    return table


def cpu_seconds() -> float:
    """CPU time of this process and of all its children that have ended, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)
