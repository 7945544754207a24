"""The spatula: a flat upright blade in place of the suction cup, for pushing tasks."""

from typing import Any, Final

from grs_agents.base.mujoco_import import mujoco

BLADE_WIDTH: Final = 0.10
BLADE_HEIGHT: Final = 0.115
BLADE_THICKNESS: Final = 0.005
BLADE_BELOW_TIP: Final = 0.003
"""Depth of the blade below the tip, metres: a tip at the published 5 mm drags the edge 2 mm above the table."""


def replace_cup_with_spatula(spec: Any) -> None:
    """Replace the suction cup in ``spec`` by a blade across the tool's x axis, its edge below the tip."""
    length = float(spec.site("tip").pos[2])
    blade, tool = spec.geom("cup"), spec.geom("tool")
    blade.type = mujoco.mjtGeom.mjGEOM_BOX
    blade.size = (BLADE_THICKNESS / 2, BLADE_WIDTH / 2, BLADE_HEIGHT / 2)
    blade.pos = (0.0, 0.0, length + BLADE_BELOW_TIP - BLADE_HEIGHT / 2)
    blade.rgba = (0.8, 0.8, 0.8, 1.0)
    blade.solref = (0.02, 1.0)
    tool.fromto = (0.0, 0.0, 0.0, 0.0, 0.0, length - BLADE_HEIGHT)
