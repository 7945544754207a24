"""Pictures of assets for people to look at: with OpenGL where there is one, else by the z-buffer."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from grs_agents.base import Vec3
from grs_agents.errors import ConfigError, InputError
from grs_agents.library.library import Library
from grs_agents.library.views import AssetView, asset_views

Renderer = Literal["auto", "gl", "plain"]
"""OpenGL if it works, OpenGL alone, or the z-buffer alone."""
PLAIN = "z-buffer"
_LONGEST = 30.0
"""Seconds to start, and as many more for each asset, after which a graphics driver is taken to hang."""


@dataclass(frozen=True)
class Drawn:
    """Views of assets.

    Attributes:
        renderer: what drew them: EGL, OSMesa, OpenGL or z-buffer.
        views: of each asset, or why it cannot be drawn.
    """

    renderer: str
    views: tuple[tuple[AssetView, ...] | InputError, ...]


def drawn(
    library: Library,
    names: Sequence[str],
    directions: Sequence[Vec3],
    *,
    size: int = 224,
    field_of_view: float = 30.0,
    renderer: Renderer = "auto",
) -> Drawn:
    """The views of assets that `asset_views` gives, for people to look at.

    Args:
        library: where the assets are.
        names: of them.
        directions: as in `asset_views`.
        size: height and width, px.
        field_of_view: degrees.
        renderer: what to draw with.

    Raises:
        ConfigError: OpenGL alone may draw, and there is none.
    """
    for backend in () if renderer == "plain" else _backends():
        found = _with(backend, library, names, directions, size, field_of_view)
        if found is not None:
            return found
    if renderer == "gl":
        raise ConfigError("neither EGL nor OSMesa can draw here", "see `grs doctor`, or draw with --renderer plain")
    return Drawn(PLAIN, tuple(_plain(library, name, directions, size, field_of_view) for name in names))


def _plain(
    library: Library, name: str, directions: Sequence[Vec3], size: int, field_of_view: float
) -> tuple[AssetView, ...] | InputError:
    try:
        return asset_views(library, name, directions, size=size, field_of_view=field_of_view)
    except InputError as error:
        return error


def _backends() -> tuple[tuple[str, str], ...]:
    """What ``MUJOCO_GL`` may say and what that is called, best first; MuJoCo's own choice outside Linux."""
    return (("egl", "EGL"), ("osmesa", "OSMesa")) if sys.platform.startswith("linux") else (("", "OpenGL"),)


def _with(
    backend: tuple[str, str],
    library: Library,
    names: Sequence[str],
    directions: Sequence[Vec3],
    size: int,
    field_of_view: float,
) -> Drawn | None:
    """The views drawn with a graphics library; ``None`` if it cannot draw."""
    environment = {key: value for key, value in os.environ.items() if key != "MUJOCO_GL"}
    environment |= {"MUJOCO_GL": backend[0]} if backend[0] else {}
    with tempfile.TemporaryDirectory(prefix="grs-drawing-") as folder:
        order = {
            "roots": [str(root.resolve()) for root in library.roots],
            "names": list(names), "directions": list(directions), "size": size, "field_of_view": field_of_view,
            "folder": folder,
        }  # fmt: skip
        try:
            subprocess.run(
                [sys.executable, "-m", "grs_agents.library.drawing_worker"],
                input=json.dumps(order).encode(), env=environment, check=True, capture_output=True,
                timeout=_LONGEST * (1 + len(names)),
            )  # fmt: skip
            views = [_read(Path(folder) / str(number)) for number in range(len(names))]
        except (subprocess.SubprocessError, OSError):
            return None
    return Drawn(backend[1], tuple(views))


def _read(file: Path) -> tuple[AssetView, ...] | InputError:
    """What the drawing process wrote of an asset: its views, or why it cannot be drawn."""
    if (wrong := file.with_suffix(".json")).is_file():
        return InputError(*json.loads(wrong.read_text("utf-8")))
    with np.load(file.with_suffix(".npz")) as told:
        distance, focal = (float(value) for value in told["camera"])
        return tuple(
            AssetView(rgba, depth, (float(x), float(y), float(z)), distance, focal)
            for rgba, depth, (x, y, z) in zip(told["rgba"], told["depth"], told["directions"], strict=True)
        )
