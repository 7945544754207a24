"""The simulation runtime: CLIPort's ``Task`` and ``Environment`` on MuJoCo, goals, an oracle, and tasks as data."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from grs_agents.sim.arms.ur5e import NEAREST, REACH
    from grs_agents.sim.cliport import p, utils
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
    from grs_agents.sim.world.context import set_environment_defaults

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
_EXPORTS = {
    "arms.ur5e": "NEAREST REACH",
    "cliport": "p utils",
    "cliport.api_documentation": "api_reference",
    "cliport.environment": "Environment rollout",
    "cliport.instantiation": "instantiate",
    "cliport.probing": "EpisodeMemory EpisodeReplay Probe",
    "cliport.task": "Task defines_task_class find_task_class",
    "expert.oracle": "Oracle",
    "goals.contacts": "Overlap Support",
    "instance.episode": "ActionRecord Episode GoalOutcome InvalidValueError NoFreeSpaceError ObjectLimitError "
    "ObjectMotion Outcome SimulationBudgetError SimulationError UnsupportedError VertexLimitError "
    "clear_last_episode last_episode",
    "instance.faults": "describe_first_error",
    "instance.goal": "Goal Relation Zone aligned in_zone inside near on stacked upright",
    "instance.task_instance": "InstanceError InstanceObject InstanceTie TaskInstance hash_instance parse_instance_json",
    "pick_trials": "explain_unpickable_objects find_objects_overlapping_robot",
    "rollouts": "HAND_NOISE NoisyTrial Rollout run_oracle",
    "tabletop_episode": "InstanceTask",
    "world.budget": "describe_reached_limit latest_limit_error reset_before_test",
    "world.bystanders": "place_bystanders",
    "world.context": "set_environment_defaults",
}
_HOMES = {name: home for home, names in _EXPORTS.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    """Import an export when it is first used: a worker that reads a photo needs the types of an instance alone."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def prepare_process() -> None:
    """Load every export and the shared parts of every simulation, so that forked processes have them."""
    from grs_agents.library.library import Library
    from grs_agents.sim.arms.registry import get_arm

    globals().update({name: __getattr__(name) for name in _HOMES})
    Library()
    _ = get_arm().link_names
