"""The simulation runtime: CLIPort's ``Task`` and ``Environment`` on MuJoCo, goals, an oracle, and tasks as data."""

from grs_agents.sim import bullet as p
from grs_agents.sim import utils
from grs_agents.sim.environment import Environment
from grs_agents.sim.episode import (
    ActionRecord,
    Episode,
    NoFreeSpaceError,
    Outcome,
    SimulationBudgetError,
    SimulationError,
    UnsupportedError,
    clear_episodes,
    last_episode,
)  # fmt: skip
from grs_agents.sim.instance import (
    InstanceGoal,
    InstanceObject,
    InstanceRelation,
    InstanceTie,
    InstanceZone,
    TaskInstance,
)  # fmt: skip
from grs_agents.sim.kinematics import NEAREST, REACH
from grs_agents.sim.oracle import Oracle
from grs_agents.sim.program import task_class
from grs_agents.sim.reference import api_reference
from grs_agents.sim.relations import Relation, aligned, in_zone, inside, near, on, stacked, upright
from grs_agents.sim.rollout import InstanceTask, Rollout, instantiate, rollout, solve
from grs_agents.sim.task import Task
from grs_agents.sim.templates import configure

__all__ = [
    "NEAREST", "REACH", "ActionRecord", "Environment", "Episode", "InstanceGoal", "InstanceObject", "InstanceRelation",
    "InstanceTask", "InstanceTie", "InstanceZone", "NoFreeSpaceError", "Oracle", "Outcome", "Relation", "Rollout",
    "SimulationBudgetError", "SimulationError", "Task", "TaskInstance", "UnsupportedError", "aligned", "api_reference",
    "clear_episodes", "configure", "in_zone", "inside", "instantiate", "last_episode", "near", "on", "p", "rollout",
    "solve", "stacked", "task_class", "upright", "utils",
]  # fmt: skip
