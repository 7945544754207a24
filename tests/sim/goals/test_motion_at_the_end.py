"""An object in motion earns nothing strictly."""

import numpy as np
from sim_scenes import Scripted, at, pose_goal

from grs_agents.sim import Environment, Task
from grs_agents.sim.goals.strict_score import StrictScorer


def test_an_object_that_moves_over_its_target_scores_nothing() -> None:
    def scene(task: Task, env: Environment) -> None:
        pose_goal(
            task, env.add_object("block/red_block.urdf", at(0.45, -0.2, 0.02)), at(0.5, 0.1, 0.02), symmetry=np.pi / 2
        )

    task = Scripted(scene)
    env = Environment(task=task)
    env.reset()
    env.set_object_pose(1, at(0.5, 0.1, 0.02))
    env.step_simulation(100)
    scorer = StrictScorer(task, env)
    assert scorer.measure_scene().strict == 1.0
    env.physics.data.qvel[env.physics.dof] = 0.2  # m/s along x, at its target still
    moving = scorer.measure_scene()
    assert moving.strict == 0.0
    assert "still" in moving.shortfalls[0]
