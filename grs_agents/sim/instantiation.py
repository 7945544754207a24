"""From a program to data: what its ``reset`` set up, as a task instance."""

from grs_agents.library import Library
from grs_agents.sim.cliport import Environment, Task, end_effectors
from grs_agents.sim.instance import Goal, TaskInstance


def instantiate(task: Task, seed: int, library: Library | None = None) -> TaskInstance:
    """Run a program's ``reset`` once and write down what it set up.

    Raises ``SimulationError`` for no such scene, ``ValidationError`` for one that is out of range.
    """
    env = Environment(library=library, seed=seed)
    env.set_task(task)
    env.reset(settle=False)
    return describe_instance(env, task, seed)


def describe_instance(env: Environment, task: Task, seed: int) -> TaskInstance:
    """What stands in an environment that a task has just set up, written down; errors as ``instantiate``."""
    return TaskInstance(
        task=type(task).__name__[:200],
        seed=seed,
        max_steps=int(task.max_steps),
        timestep=env.timestep,
        hz=env.hz,
        primitive="push" if end_effectors.uses_push_primitive(task.ee, task.primitive) else "pick_place",
        sixdof=bool(task.sixdof),
        pos_eps=task.pos_eps,
        rot_eps=task.rot_eps,
        objects=env.objects,
        ties=env.object_ties,
        goals=tuple(Goal.model_validate(goal.model_dump()) for goal in task.grs.stated),
        warnings=tuple(warning[:500] for warning in env.warnings),
    )
