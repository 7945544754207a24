"""API reference for language models, generated from signatures and docstrings so that it cannot go stale."""

import inspect
from collections.abc import Callable
from typing import Any, Literal

from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.cliport import pybullet, utils
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.cliport.task import Task
from grs_agents.sim.expert.oracle import Oracle
from grs_agents.sim.instance import goal
from grs_agents.sim.world.colors import COLORS
from grs_agents.sim.world.context import PROCESS_CONTEXT

_TASK = (
    "additional_reset",
    "add_goal",
    "get_random_pose",
    "get_random_size",
    "fill_template",
    "make_piles",
    "make_ropes",
    "goals_met",
)
_ENVIRONMENT = ("add_object", "find", "get_object_pose", "get_object_size", "set_color", "reset", "step")
_GOALS = ("inside", "on", "stacked", "near", "aligned", "upright", "in_zone")
_UTILS = ("eulerXYZ_to_quatXYZW", "quatXYZW_to_eulerXYZ", "multiply", "invert", "apply")
_FOR_TESTS = frozenset(
    {"add_goal", "goals_met", "find", "get_object_pose", "get_object_size", "reset", "step", *_UTILS}
)
"""Names for readers who test: to read goals, run a task and look at the scene, not to build it."""

Reader = Literal["program", "tests"]


def api_reference(reader: Reader = "program") -> str:
    """Markdown on ``Task``, ``Environment``, the oracle, ``utils`` and ``p``, as far as the reader needs it."""
    arm = get_arm(PROCESS_CONTEXT.robot)
    lines = [
        "```python",
        "from grs_agents.sim import Task, Environment, utils, p",
        f"from grs_agents.sim import {', '.join(_GOALS)}  # typed goals",
        "import numpy as np",
        "```",
        "Metres, radians; robot base at the origin, x forward, y left, z up, table top z = 0. A pose is "
        "`((x, y, z), (qx, qy, qz, qw))` of the centre of an object's bounding box.",
        f"The arm picks from above with suction between {arm.nearest:.2f} m and {arm.farthest:.2f} m from its base; "
        "random places lie in x 0.25..0.75, y -0.5..0.5.",
        "",
        "### Task",
        _format_docstring(Task) if reader == "program" else _format_docstring(Task).partition("\n\nExample:")[0],
    ]
    for name in _select_names(_TASK, reader):
        lines += _format_entry(f"task.{name}", getattr(Task, name))
    lines += [
        "### Typed goals",
        "`self.add_goal(inside(cans, box), step_max_reward=1, language_goal=...)`; scored strictly: the objects lie "
        "still, let go, no more tilted than at the start. Arguments are ids that `env.add_object` returned.",
    ]
    for name in _GOALS:
        function = getattr(goal, name)
        lines.append(f"- `{name}{_format_signature(function)}`: {_format_docstring(function)}")
    lines += ["### Environment", _format_docstring(Environment)]
    for name in _select_names(_ENVIRONMENT, reader):
        lines += _format_entry(f"env.{name}", getattr(Environment, name))
    lines += ["### Oracle: `task.oracle(env)`", _format_docstring(Oracle), "### utils"]
    for name in _select_names(_UTILS, reader):
        function = getattr(utils, name)
        lines.append(f"- `utils.{name}{_format_signature(function)}`: {_format_docstring(function).splitlines()[0]}")
    lines.append(f"- `utils.COLORS`: {', '.join(COLORS)}")
    call = pybullet.getBasePositionAndOrientation
    lines.append(f"- `p.getBasePositionAndOrientation(id)`: {_format_docstring(call).splitlines()[0]}")
    return "\n".join(lines) + "\n"


def _select_names(names: tuple[str, ...], reader: Reader) -> list[str]:
    return [name for name in names if reader == "program" or name in _FOR_TESTS]


def _format_entry(label: str, function: Callable[..., Any]) -> list[str]:
    return [f"#### `{label}{_format_signature(function)}`", _format_docstring(function)]


def _format_signature(function: Callable[..., Any]) -> str:
    signature = inspect.signature(function)
    shown = [
        parameter.replace(annotation=inspect.Parameter.empty)
        for name, parameter in signature.parameters.items()
        if name != "self" and not name.startswith("_")
    ]
    return str(signature.replace(parameters=shown, return_annotation=inspect.Signature.empty))


def _format_docstring(thing: Any) -> str:
    return inspect.cleandoc(thing.__doc__ or "").replace("Example::\n", "Example:\n")
