"""The simulation runtime: CLIPort's ``Task`` and ``Environment`` on MuJoCo, goals, an oracle, and tasks as data."""

from grs_agents.sim.arms.ur5e import NEAREST, REACH
from grs_agents.sim.cliport import pybullet as p
from grs_agents.sim.cliport import utils
from grs_agents.sim.cliport.api_documentation import api_reference
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.cliport.task import Task, names_task, task_class
from grs_agents.sim.expert.oracle import Oracle
from grs_agents.sim.instance.episode import (
    ActionRecord,
    Episode,
    NoFreeSpaceError,
    ObjectLimitError,
    Outcome,
    SimulationBudgetError,
    SimulationError,
    UnsupportedError,
    VertexLimitError,
    clear_episodes,
    last_episode,
)
from grs_agents.sim.instance.goal import Goal, Relation, Zone, aligned, in_zone, inside, near, on, stacked, upright
from grs_agents.sim.instance.instance import (
    InstanceError,
    InstanceObject,
    InstanceTie,
    TaskInstance,
    first_fault,
    read_instance,
)
from grs_agents.sim.instance_runs import InstanceTask, Rollout, instantiate, rollout, solve
from grs_agents.sim.world.budget import begin_test, reached, reached_limit
from grs_agents.sim.world.templates import configure

__all__ = [
    "NEAREST",
    "REACH",
    "ActionRecord",
    "Environment",
    "Episode",
    "Goal",
    "InstanceError",
    "InstanceObject",
    "InstanceTask",
    "InstanceTie",
    "NoFreeSpaceError",
    "ObjectLimitError",
    "Oracle",
    "Outcome",
    "Relation",
    "Rollout",
    "SimulationBudgetError",
    "SimulationError",
    "Task",
    "TaskInstance",
    "UnsupportedError",
    "VertexLimitError",
    "Zone",
    "aligned",
    "api_reference",
    "begin_test",
    "clear_episodes",
    "configure",
    "first_fault",
    "in_zone",
    "inside",
    "instantiate",
    "last_episode",
    "names_task",
    "near",
    "on",
    "p",
    "reached",
    "reached_limit",
    "read_instance",
    "rollout",
    "solve",
    "stacked",
    "task_class",
    "upright",
    "utils",
]
