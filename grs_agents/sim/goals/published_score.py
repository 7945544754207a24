"""How far goals are met, as published with CLIPort: z and tilt do not count."""

import numpy as np

from grs_agents.base import Pose
from grs_agents.geometry import transforms
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.instance import POSITION_TOLERANCE, ROTATION_TOLERANCE
from grs_agents.sim.world.collision_volumes import Volume, share_inside


def angle_between(first: float, second: float, symmetry: float) -> float:
    """The smallest turn (rad) that aligns two yaws of something that repeats every ``symmetry``; 0 = any yaw."""
    if symmetry <= 0:
        return 0.0
    difference = abs(first - second) % symmetry
    return float(min(difference, symmetry - difference))


def pose_matches(
    pose: Pose, target: Pose, symmetry: float,
    pos_eps: float = POSITION_TOLERANCE, rot_eps: float = ROTATION_TOLERANCE,
) -> bool:  # fmt: skip
    """Whether ``pose`` is at ``target``: xy within ``pos_eps`` metres, yaw within ``rot_eps`` radians."""
    distance = float(np.hypot(pose[0][0] - target[0][0], pose[0][1] - target[0][1]))
    turn = angle_between(transforms.yaw_of(pose[1]), transforms.yaw_of(target[1]), symmetry)
    return distance < pos_eps and turn < rot_eps


def object_scores(
    goal: Goal, poses: dict[int, Pose], volumes: dict[int, Volume], ceiling: float,
    pos_eps: float = POSITION_TOLERANCE, rot_eps: float = ROTATION_TOLERANCE,
) -> list[float]:  # fmt: skip
    """For each object of a ``pose`` or ``zone`` goal, how far (0..1) it is where it should be."""
    if goal.metric == "zone":
        return [share_inside(volumes[number], poses[number], goal.params, ceiling) for number in goal.objs]
    return [
        float(
            any(
                pose_matches(poses[number], goal.targ_poses[index], goal.symmetries[row], pos_eps, rot_eps)
                for index in np.flatnonzero(goal.matches[row])
            )
        )
        for row, number in enumerate(goal.objs)
    ]
