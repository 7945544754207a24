"""What room the arm itself takes, before anything is put around it."""

import numpy as np
import numpy.typing as npt

from grs_agents.engine import mujoco
from grs_agents.library import Library
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.world import compilation


def arm_at_home(robot: str, library: Library) -> npt.NDArray[np.float64]:
    """(N, 4) spheres, centre and radius (m, robot frame), around each part of an arm at its home position.

    Args:
        robot: ``ur5e``, ``panda`` or the path of an MJCF file.
        library: 3D assets.

    Raises:
        InputError: its file cannot be read or holds no arm.
    """
    arm = get_arm(robot)
    built = compilation.build((), library, arm=arm)
    built.data.qpos[: arm.dof] = arm.home
    mujoco.mj_forward(built.model, built.data)
    mine = built.model.geom_bodyid > 0
    return np.column_stack([built.data.geom_xpos[mine], built.model.geom_rbound[mine]])
