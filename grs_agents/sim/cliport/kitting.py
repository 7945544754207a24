"""Kitting shapes on the table, as GenSim's ``make_kitting_objects`` puts them there."""

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.world import templates
from grs_agents.sim.world.tabletop import Tabletop

_TURN: Final = 2 * np.pi
SYMMETRIES: Final = (
    _TURN, _TURN, _TURN / 3, _TURN / 4, _TURN / 4, _TURN, _TURN / 2, _TURN / 5, _TURN / 2, _TURN / 4,
    _TURN / 5, 0.0, _TURN, _TURN, _TURN, _TURN, 0.0, _TURN / 6, _TURN, _TURN,
)  # fmt: skip
"""For each kitting shape the angle (rad) after which it looks the same; 0 = any."""
SCALE: Final = (0.003, 0.003, 0.001)
SIZE: Final = (0.08, 0.08, 0.02)
"""The most room, metres, that a shape of this scale takes."""


def kitting_objects(
    env: Tabletop, place: Callable[[Sequence[float]], Any], targets: Sequence[Any], shapes: Sequence[int],
    colors: Sequence[Any],
) -> tuple[list[tuple[int, tuple[float, None]]], list[npt.NDArray[np.float64]]]:  # fmt: skip
    """Put one object of each shape at a free place.

    Args:
        env: where they are put.
        place: gives a free pose for a size (m).
        targets: target poses, one for each of ``shapes``.
        shapes: numbers 0..19.
        colors: one for each shape, (r, g, b) or a name.

    Returns:
        ``[(id, (symmetry, None)), ...]``, and for each object its row of ``matches``: 1 at targets of its own shape.

    Raises:
        SimulationError: a shape does not exist, or there are too few colours.
        NoFreeSpaceError: there is no room.
    """
    unknown = [shape for shape in shapes if not 0 <= shape < len(SYMMETRIES)]
    if unknown or len(colors) < len(shapes):
        raise SimulationError(
            f"make_kitting_objects: shapes {list(shapes)} with {len(colors)} colours",
            f"give shapes 0..{len(SYMMETRIES) - 1} and a colour for each",
        )
    kinds = np.asarray(shapes)
    objects: list[tuple[int, tuple[float, None]]] = []
    matches: list[npt.NDArray[np.float64]] = []
    for shape, color in zip(shapes, colors, strict=False):
        replace = {"FNAME": f"{shape:02d}.obj", "SCALE": SCALE, "COLOR": color}
        urdf = templates.fill(env.library, "kitting/object-template.urdf", replace)
        number = env.add_object(urdf, place(SIZE))
        objects.append((number, (SYMMETRIES[shape], None)))
        row = np.zeros(len(targets))
        row[np.flatnonzero(kinds[: len(targets)] == shape)] = 1
        matches.append(row)
    return objects, matches
