"""Environments of a task as data: ``gymnasium.make("grs_agents.envs:GRS-v0", run=...)`` (extra ``gym``)."""

from typing import Any, cast

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)


def _register_gym_environment() -> None:
    """Tell gymnasium, if it is here, what ``GRS-v0`` is: it imports the package that an id names, then looks it up."""
    try:
        from gymnasium.envs import registration
    except ImportError:
        return
    cast(Any, registration).register(id="GRS-v0", entry_point="grs_agents.envs.gym_environment:GrsEnv")


_register_gym_environment()
