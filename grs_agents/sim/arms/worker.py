"""The worker's part of looking at the robot of a task folder: MuJoCo compiles it there first."""

from functools import partial
from pathlib import Path
from typing import Any

from grs_agents.sandbox.harness.answers import answer_or_refuse
from grs_agents.sim.arms.mjcf_arm import load_arm


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """Load the arm in the file ``robot``."""
    return answer_or_refuse(partial(_load, Path(request["robot"])))


def _load(path: Path) -> dict[str, Any]:
    return {"joints": load_arm(path).dof}
