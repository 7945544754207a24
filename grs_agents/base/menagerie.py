"""Robots of MuJoCo Menagerie by name, from DeepMind's package ``mujoco-menagerie`` or a checkout of its models."""

from importlib import import_module
from pathlib import Path
from typing import Any, Final

from grs_agents.base.errors import ConfigError, UnknownNameError

PREFIX: Final = "menagerie:"


def resolve_menagerie_name(robot: str) -> str:
    """The path of the MJCF file of ``menagerie:NAME`` or ``menagerie:NAME/MODEL``; other robots as they are.

    The package downloads a robot on its first use; with the variable ``MENAGERIE_ROOT`` it takes that checkout instead.

    Raises:
        ConfigError: the package is missing, or the robot cannot be had.
        UnknownNameError: there is no such robot, or it has no such model.
    """
    if not robot.startswith(PREFIX):
        return robot
    try:
        package: Any = import_module("mujoco_menagerie")
    except ImportError as error:
        message = f"robot {robot!r} needs mujoco-menagerie, which is not installed"
        raise ConfigError(message, 'run: pip install "grs-agents[robots]"') from error
    name, _, model = robot.removeprefix(PREFIX).partition("/")
    if name not in package.names():
        raise UnknownNameError("robot of Menagerie", name, package.names())
    known = package.get(name)
    models = [entry.name for entry in known.entry_points if entry.kind == "robot" and not entry.is_mjx]
    if (model := model or known.default_model) not in models:
        raise UnknownNameError(f"model of {name}", model, models)
    try:
        file: Path = known.xml(model)
    except (package.MenagerieError, OSError) as error:
        remedy = "set MENAGERIE_ROOT to a checkout of github.com/google-deepmind/mujoco_menagerie"
        raise ConfigError(f"robot {robot!r} cannot be had: {error}", remedy) from error
    if not file.is_file():
        raise ConfigError(f"robot {robot!r} cannot be had: there is no {file}", "update that checkout")
    return str(file)
