"""The scene that the page corrects, and the run that goes on from it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from grs_agents.library.library import Library
from grs_agents.perception.edits import Add, CorrectMask, Edit, Pixel, Split
from grs_agents.perception.types import Mask, RGBDFrame, SceneDescription


class Editor(Protocol):
    """A scene that is corrected: `grs_agents.runs.scene_editor.SceneEditor`."""

    @property
    def folder(self) -> Path: ...
    @property
    def photo(self) -> RGBDFrame: ...
    @property
    def scene(self) -> SceneDescription: ...
    @property
    def masks(self) -> Mapping[str, Mask]: ...
    @property
    def library(self) -> Library: ...
    @property
    def edits(self) -> tuple[Edit, ...]: ...
    @property
    def undone(self) -> tuple[Edit, ...]: ...
    def apply(self, edit: Edit) -> None: ...
    def undo(self) -> None: ...
    def redo(self) -> None: ...
    def place_of(self, name: str) -> Pixel: ...
    def preview_part(self, edit: Add | Split | CorrectMask) -> Mask | None: ...
    def ranked_assets(self, place: Pixel) -> tuple[str, ...]: ...
    def overlaps(self, place: Pixel, position: tuple[float, float], yaw: float) -> tuple[str, ...]: ...
    def save(self) -> Path: ...


@dataclass(frozen=True)
class EndedRun:
    """A run from the corrected scene."""

    folder: Path
    status: str
    reason: str
    report: bytes  # an HTML page


GoOn = Callable[[Callable[[str], None]], EndedRun]
"""Runs the graph from the saved scene; the given function shows a step, a line of text."""
