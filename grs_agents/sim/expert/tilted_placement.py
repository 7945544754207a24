"""Placing with the tool tilted: where a task of six degrees of freedom has a target that is itself tilted."""

from typing import Final

import numpy as np

from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.sim.goals.scene_view import SceneView, is_target_tilted
from grs_agents.sim.goals.task_accounting import ScoredTask
from grs_agents.sim.instance.goal import Goal

TRIES: Final = 2
"""How often an object is placed tilted before it is let down upright, in case the arm cannot tilt so far."""


def find_tilted_place_pose(goal: Goal, row: int, task: ScoredTask, view: SceneView, hold: Vec3) -> Pose | None:
    """The cup's pose that brings an object, held upright at ``hold`` (m), to its nearest target, tilted as that is.

    None for goals whose targets are upright, and for tasks that place upright alone.
    """
    if goal.metric != "pose" or not task.sixdof:
        return None
    pose = view.object_pose(goal.objects[row])
    targets = [goal.targets[index] for index in goal.allowed_target_indices(row)]
    if not targets or not all(map(is_target_tilted, targets)):
        return None
    nearest = min(targets, key=lambda target: float(np.linalg.norm(np.subtract(target[0], pose[0]))))
    moved = transforms.compose_poses(nearest, transforms.invert_pose(pose))
    return transforms.compose_poses(moved, (hold, transforms.IDENTITY))
