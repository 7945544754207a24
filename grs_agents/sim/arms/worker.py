"""Sandboxed worker that loads the robot of a task folder: MuJoCo compiles the file there first."""

from pathlib import Path
from typing import Any

from grs_agents.sandbox.harness.answers import answer_or_refuse
from grs_agents.sim.arms.mjcf_arm import load_arm


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """Load the arm in the file ``robot``."""
    return answer_or_refuse(lambda: {"joints": load_arm(Path(request["robot"])).dof})
