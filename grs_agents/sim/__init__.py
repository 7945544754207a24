"""The simulation runtime: CLIPort's ``Task`` and ``Environment`` on MuJoCo, goals, an oracle, and tasks as data."""

from grs_agents.sim.arms.ur5e import NEAREST, REACH
from grs_agents.sim.cliport import pybullet as p
from grs_agents.sim.cliport import utils
from grs_agents.sim.cliport.api_documentation import api_reference
from grs_agents.sim.cliport.environment import Environment, rollout
from grs_agents.sim.cliport.instantiation import instantiate
from grs_agents.sim.cliport.probing import EpisodeMemory, EpisodeReplay, Probe
from grs_agents.sim.cliport.task import Task, defines_task_class, find_task_class
from grs_agents.sim.expert.oracle import Oracle
from grs_agents.sim.goals.contacts import Overlap, Support
from grs_agents.sim.instance.episode import (
    ActionRecord,
    Episode,
    GoalOutcome,
    InvalidValueError,
    NoFreeSpaceError,
    ObjectLimitError,
    ObjectMotion,
    Outcome,
    SimulationBudgetError,
    SimulationError,
    UnsupportedError,
    VertexLimitError,
    clear_last_episode,
    last_episode,
)
from grs_agents.sim.instance.faults import describe_first_error
from grs_agents.sim.instance.goal import Goal, Relation, Zone, aligned, in_zone, inside, near, on, stacked, upright
from grs_agents.sim.instance.task_instance import (
    InstanceError,
    InstanceObject,
    InstanceTie,
    TaskInstance,
    hash_instance,
    parse_instance_json,
)
from grs_agents.sim.pick_trials import explain_unpickable_objects, find_objects_overlapping_robot
from grs_agents.sim.rollouts import HAND_NOISE, NoisyTrial, Rollout, run_oracle
from grs_agents.sim.tabletop_episode import InstanceTask
from grs_agents.sim.world.budget import describe_reached_limit, latest_limit_error, reset_before_test
from grs_agents.sim.world.bystanders import place_bystanders
from grs_agents.sim.world.context import prepare_process, set_environment_defaults

__all__ = [
    "HAND_NOISE",
    "NEAREST",
    "REACH",
    "ActionRecord",
    "Environment",
    "Episode",
    "EpisodeMemory",
    "EpisodeReplay",
    "Goal",
    "GoalOutcome",
    "InstanceError",
    "InstanceObject",
    "InstanceTask",
    "InstanceTie",
    "InvalidValueError",
    "NoFreeSpaceError",
    "NoisyTrial",
    "ObjectLimitError",
    "ObjectMotion",
    "Oracle",
    "Outcome",
    "Overlap",
    "Probe",
    "Relation",
    "Rollout",
    "SimulationBudgetError",
    "SimulationError",
    "Support",
    "Task",
    "TaskInstance",
    "UnsupportedError",
    "VertexLimitError",
    "Zone",
    "aligned",
    "api_reference",
    "clear_last_episode",
    "defines_task_class",
    "describe_first_error",
    "describe_reached_limit",
    "explain_unpickable_objects",
    "find_objects_overlapping_robot",
    "find_task_class",
    "hash_instance",
    "in_zone",
    "inside",
    "instantiate",
    "last_episode",
    "latest_limit_error",
    "near",
    "on",
    "p",
    "parse_instance_json",
    "place_bystanders",
    "prepare_process",
    "reset_before_test",
    "rollout",
    "run_oracle",
    "set_environment_defaults",
    "stacked",
    "upright",
    "utils",
]
