"""Small tasks that the tests of this room share."""

from collections.abc import Callable

import numpy as np

from grs_agents.base import Pose
from grs_agents.sim import Environment, Episode, Task

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
Scene = Callable[[Task, Environment], object]


class Scripted(Task):
    """A task whose scene is set up by a function."""

    def __init__(self, scene: Scene, max_steps: int = 8) -> None:
        super().__init__()
        self.scene = scene
        self.max_steps = max_steps

    def reset(self, env: Environment) -> None:
        super().reset(env)
        self.scene(self, env)


def at(x: float, y: float, z: float) -> Pose:
    return ((x, y, z), UPRIGHT)


def zone_goal(task: Task, objects: list[int], pose: Pose, size: tuple[float, float, float], reward: float = 1) -> None:
    task.add_goal(
        objs=objects,
        matches=np.ones((len(objects), 1)),
        targ_poses=[pose],
        replace=True,
        rotations=False,
        metric="zone",
        params=[(pose, size)],
        step_max_reward=reward,
    )


def pose_goal(task: Task, obj: int, pose: Pose, reward: float = 1, symmetry: float = 0) -> None:
    task.add_goal(
        objs=[obj],
        matches=np.ones((1, 1)),
        targ_poses=[pose],
        replace=False,
        rotations=True,
        metric="pose",
        params=None,
        step_max_reward=reward,
        symmetries=[symmetry],
    )


def run(scene: Scene, max_steps: int = 8, seed: int = 0) -> tuple[Episode, Environment]:
    """Let the oracle play a scene to its end."""
    task = Scripted(scene, max_steps)
    env = Environment(task=task, seed=seed)
    env.reset()
    agent, done = task.oracle(env), False
    while not done and (action := agent.act()) is not None:
        done = env.step(action)[2]
    return env.current_episode, env
