"""API reference for language models, generated from signatures and docstrings so that it cannot go stale."""

import inspect
import re
from collections.abc import Callable, Mapping
from typing import Any, Literal

from grs_agents.sim.arms.registry import DEFAULT, get_arm
from grs_agents.sim.cliport import pybullet, utils
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.cliport.task import Task
from grs_agents.sim.expert.oracle import Oracle
from grs_agents.sim.hands.hand import DEFAULT_HAND, Tool
from grs_agents.sim.hands.registry import get_tool
from grs_agents.sim.instance import goal
from grs_agents.sim.world.colors import COLORS

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
_FOR_TESTS_ALONE = frozenset({"goals_met", "reset", "step"})
_RARE = {
    "make_piles": re.compile(r"make_piles|\b(piles?|heaps?|grains?|crumbs?|swe(ep|pt)\w*|strew\w*)\b", re.IGNORECASE),
    "make_ropes": re.compile(r"make_ropes|\b(ropes?|cords?|cables?|strings?|threads?|laces?|beads?)\b", re.IGNORECASE),
}
"""Names for few tasks, each with the words of a task, or the name in a program, that call for it."""
_HOLDS_BY: Mapping[Tool, str] = {"suction": "suction", "fingers": "two fingers"}

Reader = Literal["program", "tests"]


def api_reference(
    reader: Reader = "program", about: str | None = None, robot: str = DEFAULT, hand: str = DEFAULT_HAND
) -> str:
    """Markdown on ``Task``, ``Environment``, the oracle, ``utils`` and ``p``, as far as the reader needs it.

    Args:
        reader: author of programs or of tests.
        about: words of the task, and programs; piles and ropes are left out unless it mentions them. All is in for
            None.
        robot: ``"ur5e"``, ``"panda"`` or the path of an MJCF file.
        hand: name of the hand at its flange.
    """
    arm, held_by = get_arm(robot, hand), _HOLDS_BY[get_tool(hand)]
    lines = [
        "```python",
        "from grs_agents.sim import Task, Environment, utils, p",
        f"from grs_agents.sim import {', '.join(_GOALS)}  # typed goals",
        "import numpy as np",
        "```",
        "Metres, radians; robot base at the origin, x forward, y left, z up, table top z = 0. A pose is "
        "`((x, y, z), (qx, qy, qz, qw))` of the centre of an object's bounding box.",
        f"The arm picks from above with {held_by} between {arm.nearest:.2f} m and {arm.farthest:.2f} m from its base; "
        "random places lie in x 0.25..0.75, y -0.5..0.5.",
        "",
        "### Task",
        _cut_example(_format_docstring(Task)),
    ]
    for name in _select_names(_TASK, reader, about):
        lines += _format_entry(f"task.{name}", getattr(Task, name))
    lines += [
        "### Typed goals",
        "`self.add_goal(inside(cans, box), step_max_reward=1, language_goal=...)`; scored strictly: the objects lie "
        "still, let go, no more tilted than at the start. Arguments are ids that `env.add_object` returned.",
    ]
    for name in _GOALS:
        function = getattr(goal, name)
        lines.append(f"- `{name}{_format_signature(function)}`: {_format_docstring(function)}")
    lines += ["### Environment", _format_docstring(Environment).partition("\n\n")[0]]
    for name in _select_names(_ENVIRONMENT, reader, about):
        lines += _format_entry(f"env.{name}", getattr(Environment, name))
    oracle = _format_docstring(Oracle)
    lines += ["### Oracle: `task.oracle(env)`", oracle if reader == "tests" else _cut_example(oracle), "### utils"]
    for name in _select_names(_UTILS, reader, about):
        function = getattr(utils, name)
        lines.append(f"- `utils.{name}{_format_signature(function)}`: {_format_docstring(function).splitlines()[0]}")
    lines.append(f"- `utils.COLORS`: {', '.join(COLORS)}")
    call = pybullet.getBasePositionAndOrientation
    lines.append(f"- `p.getBasePositionAndOrientation(id)`: {_format_docstring(call).splitlines()[0]}")
    return "\n".join(lines) + "\n"


def _select_names(names: tuple[str, ...], reader: Reader, about: str | None) -> list[str]:
    if reader == "tests":
        return [name for name in names if name in _FOR_TESTS]
    needed = [name for name in names if name not in _FOR_TESTS_ALONE]
    return [name for name in needed if about is None or name not in _RARE or _RARE[name].search(about)]


def _cut_example(text: str) -> str:
    """``text`` without the example at its end: prompts show whole programs."""
    return text.partition("\n\nExample:")[0]


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
