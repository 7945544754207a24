"""Task instances from programs: the scene and the goals that a ``reset`` set up, as data."""

from pydantic import ValidationError

from grs_agents.library.library import Library
from grs_agents.sim.cliport import end_effectors
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.cliport.task import Task
from grs_agents.sim.instance.episode import InvalidValueError
from grs_agents.sim.instance.faults import describe_first_error
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.tabletop_episode import parse_max_steps


def instantiate(task: Task, seed: int, library: Library | None = None) -> TaskInstance:
    """Run a program's ``reset`` once and describe the scene that it set up.

    Raises ``SimulationError`` for a scene that cannot be set up, ``InvalidValueError`` for values out of range.
    """
    env = Environment(library=library, seed=seed)
    env.set_task(task)
    env.reset(settle=False)
    return describe_instance(env, task, seed)


def describe_instance(env: Environment, task: Task, seed: int) -> TaskInstance:
    """Describe the scene and goals that a task has just set up; errors as ``instantiate``."""
    goals: list[Goal] = []
    for number, stated in enumerate(task.grs.stated, start=1):
        try:
            goals.append(Goal.model_validate(stated.model_dump()))
        except ValidationError as error:
            raise InvalidValueError(describe_first_error(error, f"goal {number}")) from error
    try:
        return TaskInstance(
            task=type(task).__name__[:200],
            seed=seed,
            max_steps=parse_max_steps(task.max_steps),
            timestep=env.timestep,
            hz=env.hz,
            primitive=end_effectors.find_end_effector(task).primitive,
            sixdof=bool(task.sixdof),
            pos_eps=task.pos_eps,
            rot_eps=task.rot_eps,
            objects=env.objects,
            ties=env.object_ties,
            goals=tuple(goals),
            warnings=tuple(warning[:500] for warning in env.warnings),
        )
    except ValidationError as error:
        objects = [{"id": item.id, "asset": item.asset} for item in env.objects]
        raise InvalidValueError(describe_first_error(error, data={"objects": objects})) from error
