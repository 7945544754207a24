"""Things in a world of their own: pushed apart without gravity, then at rest under it."""

import numpy as np

from grs_agents.engine import mujoco
from grs_agents.perception.settling.depenetration import deepest
from grs_agents.sim.world.compilation import World

EASED = 0.0005
"""Things are eased apart until they overlap by less than this, m."""
EASING = 200
"""In at most so many steps."""
LONGEST = 2.0
"""Simulated seconds in which everything should come to rest."""
STILL = 0.01
"""What is slower than this (m/s) rests."""
CHUNK = 25
ROLLING = 0.004
"""Arm of the rolling resistance (m): nothing in a photo rolls."""


def prepare(world: World) -> None:
    """Take the robot out of the way, and let nothing roll."""
    model, owners = world.model, np.asarray(world.owners)
    # What is eased apart never moves by itself, falls asleep at once, and would sleep through gravity.
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    robot = owners < 0
    robot[model.geom("table").id] = False
    model.geom_contype[robot], model.geom_conaffinity[robot] = 0, 0
    model.geom_condim[owners >= 0] = 6
    model.geom_friction[owners >= 0, 2] = ROLLING


def ease(world: World) -> None:
    """Push overlaps apart, without gravity and without speed, so that nothing is thrown.

    And without friction: what sticks to what it is pushed out of goes farther.
    """
    model, data = world.model, world.data
    gravity, dimensions = np.array(model.opt.gravity), np.array(model.geom_condim)
    model.opt.gravity[:], model.geom_condim[:] = 0, 1
    for _ in range(EASING):
        data.qvel[:] = 0
        mujoco.mj_step(model, data)
        if deepest(world) < EASED:
            break
    model.opt.gravity[:], model.geom_condim[:] = gravity, dimensions
    data.qvel[:] = 0


def fall(world: World) -> bool:
    """Let gravity act until everything rests; whether it does in time."""
    model, data = world.model, world.data
    first, still = world.arm.dof, 0
    for _ in range(int(LONGEST / model.opt.timestep / CHUNK)):
        mujoco.mj_step(model, data, CHUNK)
        speed = np.abs(data.qvel[first:].reshape(-1, 6)) * (1, 1, 1, 0.1, 0.1, 0.1)
        still = still + 1 if speed.max(initial=0.0) < STILL else 0
        if still == 3:
            return True
    return False
