"""Environments of a task as data: ``gymnasium.make("grs_agents.envs:GRS-v0", run=...)`` (extra ``gym``)."""

from importlib import import_module
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from grs_agents.tasks.envs.controls import JointPositionControl
    from grs_agents.tasks.envs.gym_environment import GrsEnv
    from grs_agents.tasks.envs.lerobot import make_env
    from grs_agents.tasks.envs.pictures import Photographer
    from grs_agents.tasks.envs.state import StateReader
    from grs_agents.tasks.envs.task_episode import SOLVED, TaskEpisode

_HOMES = {
    "GrsEnv": "gym_environment",
    "JointPositionControl": "controls",
    "Photographer": "pictures",
    "SOLVED": "task_episode",
    "StateReader": "state",
    "TaskEpisode": "task_episode",
    "make_env": "lerobot",
}
"""The module of each export: gymnasium is an extra, and most users of a task need no environment."""
__all__ = ["SOLVED", "GrsEnv", "JointPositionControl", "Photographer", "StateReader", "TaskEpisode", "make_env"]


def __getattr__(name: str) -> Any:
    """Import an export when it is first used."""
    if name in _HOMES:
        return getattr(import_module(f"grs_agents.tasks.envs.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _register_gym_environment() -> None:
    """Register ``GRS-v0``, if gymnasium is installed: it imports the package of an id before it looks the id up."""
    try:
        from gymnasium.envs import registration
    except ImportError:
        return
    home = "grs_agents.tasks.envs"
    cast(Any, registration).register(
        id="GRS-v0",
        entry_point=f"{home}.gym_environment:GrsEnv",
        vector_entry_point=f"{home}.vector_environment:GrsVectorEnv",
    )


_register_gym_environment()
