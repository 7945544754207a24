"""README of an exported scene: its contents, names, and the use of suction."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from grs_agents.base.control_characters import escape_control_chars
from grs_agents.base.mujoco_import import mujoco
from grs_agents.base.version import __version__
from grs_agents.library.library import Library
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import hash_instance
from grs_agents.sim.world.suction import HOLDING_FORCE, PEELING_MOMENT
from grs_agents.tasks.export.mjcf_scene import GoalSite, MjcfScene

_OPEN: Final = """\
## Open it

```sh
python -m mujoco.viewer --mjcf=scene.xml
```

All files are named relative to `scene.xml`: the folder may lie anywhere. Everything begins in the keyframe `start`
(in the viewer *Simulation*, *Load key*): the objects as they have settled, the arm at home, its commands set.

```python
import mujoco

model = mujoco.MjModel.from_xml_path("scene.xml")
data = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
mujoco.mj_step(model, data)
```
"""
_DM_CONTROL: Final = """
With dm_control: `mjcf.from_path("scene.xml")`, or `mujoco.Physics.from_xml_path("scene.xml")` and `physics.reset(0)`.
"""
_WELDS: Final = f"""\
## Suction

For each object that the cup may take there is a weld `suction_<id>` between it and the body `cup`, switched off. A weld
keeps the relative pose that is in the model, so write the present one before you switch it on. What is held and the cup
must not collide meanwhile.

```python
import mujoco
import numpy as np


def take(model, data, number):
    cup, body = model.body("cup").id, model.body(f"object_{{number}}").id
    weld = model.equality(f"suction_{{number}}").id
    inverse, position, rotation = np.empty(4), np.empty(3), np.empty(4)
    mujoco.mju_negQuat(inverse, data.xquat[cup])
    mujoco.mju_rotVecQuat(position, data.xpos[body] - data.xpos[cup], inverse)
    mujoco.mju_mulQuat(rotation, inverse, data.xquat[body])
    model.eq_data[weld, :3], model.eq_data[weld, 3:6] = 0, position
    model.eq_data[weld, 6:10], model.eq_data[weld, 10] = rotation, 1
    model.geom_contype[model.geom("cup").id] = 0
    data.eq_active[weld] = 1


def release(model, data, number):
    data.eq_active[model.equality(f"suction_{{number}}").id] = 0
    model.geom_contype[model.geom("cup").id] = 2
    data.joint(f"object_{{number}}").qvel[2] = -0.01  # what was held still would fall asleep in the air
```

In GRS the cup takes what it touches when most of its lip lies on it, and lets go of what pulls with more than
{HOLDING_FORCE:g} N or bends it with more than {PEELING_MOMENT:g} N m; the arm bears the weight of what it holds
(`qfrc_applied`). Beads of ropes are held at a point (`eq_data[weld, 10] = 0`). A weld alone does neither.
"""
_ADHESION: Final = f"""\
## Suction

The actuator `suction` pulls whatever touches the cup towards it, with {HOLDING_FORCE:g} N at a command of 1 and not at
all at 0. Lower the cup onto an object until they touch (2 mm further is well), command 1, wait a tenth of a second,
lift.

## What this version lacks

It is for MuJoCo 3.3 and later, and for dm_control. `grs export` without `--portable` has, for MuJoCo 4:

- *sleep*: there, what rests costs no time;
- *welds* for suction: here the cup holds by contact and friction, so things may turn or slip on it, and curved tops
  hold worse; eight balls around the cup's end (`cup_lip_<n>`) and its core (`cup_core`) touch in the place of `cup`;
- the part of a rope's damping that grows with the square and the cube of its speed, if there is a rope;
- the word that tells what a command means (`input`), which changes no motion.

Bodies, masses, friction, ties, joints and their commands are the same. What something touches moves a little otherwise
in each version of MuJoCo; the arm keeps to the same joint positions.
"""
_SPATULA: Final = """\
## Pushing

The arm has a flat blade in the place of the suction cup; there is nothing to switch.
"""
_SPATULA_LACKS: Final = """
This version is for MuJoCo 3.3 and later, and for dm_control. It lacks *sleep*, by which in MuJoCo 4 what rests costs no
time, and the word that tells what a command means (`input`), which changes no motion.
"""


@dataclass(frozen=True)
class Words:
    """Name and description of a task; empty if unknown."""

    name: str
    description: str


def write_readme_text(scene: MjcfScene, model: Any, library: Library, words: Words) -> str:
    """The README in Markdown; ``model`` is the scene's ``mujoco.MjModel``."""
    instance = scene.instance
    if instance.primitive == "push":
        suction = _SPATULA + (_SPATULA_LACKS if scene.portable else "")
    else:
        suction = _ADHESION if scene.portable else _WELDS
    origin = [
        f"- task instance: seed {instance.seed}, in `instance.json`",
        f"- its SHA-256: `{hash_instance(instance)}`, also in the model's text `grs_instance`",
        f"- written by grs-agents {__version__} with MuJoCo {mujoco.__version__}",
        f"- {'portable: MuJoCo 3.3 and later, dm_control' if scene.portable else 'exact: MuJoCo 4'}",
    ]
    parts = [
        f"# {_escape_markdown(words.name) or scene.spec.modelname}\n",
        *([f"{_escape_markdown(words.description)}\n"] if words.description else []),
        "A robot task as a scene of [MuJoCo](https://mujoco.org).\n",
        _OPEN + (_DM_CONTROL if scene.portable else ""),
        "## The task\n\n" + "\n".join(_goal_lines(instance.goals, scene.sites)) + "\n",
        "## What is in it\n\n" + "\n".join(_body_and_actuator_lines(scene, model, library)) + "\n",
        suction,
        "## Where it comes from\n\n" + "\n".join(origin) + "\n",
    ]
    return "\n".join(parts)


def _escape_markdown(text: str) -> str:
    """Foreign text as a line of Markdown without markup."""
    line = escape_control_chars(" ".join(text.split()))
    return "".join(f"\\{letter}" if letter in "\\`*_{}[]<>#|" else letter for letter in line)


def _goal_lines(goals: Sequence[Goal], sites: Sequence[GoalSite]) -> Iterator[str]:
    """A line for each goal: its kind, objects, sentence and sites."""
    for index, goal in enumerate(goals):
        what = f"{goal.metric} goal" if goal.relation is None else f"relation *{goal.relation_kind}*"
        named = ", ".join(f"`object_{number}`" for number in goal.objects)
        shown = "; ".join(f"`{site.name}`: {site.shows}" for site in sites if site.goal == index)
        words = f" “{_escape_markdown(goal.language)}”" if goal.language else ""
        yield f"{index + 1}. {what} of {named}.{words}{f' Sites: {shown}.' if shown else ''}"
    if sites:
        yield "\nThe goals' sites are in group 1: `option.sitegroup[1] = 0` hides them, in the viewer Shift+1."


def _body_and_actuator_lines(scene: MjcfScene, model: Any, library: Library) -> Iterator[str]:
    instance = scene.instance
    yield "Metres, kilograms, seconds and radians; x forward from the robot's base, z up, the table top at z = 0.\n"
    yield "| body | what it is | kg | moves | from |\n|---|---|---|---|---|"
    for item in instance.objects:
        mass = float(model.body(f"object_{item.id}").mass[0])
        moves = "freely" if item.id in scene.world.free else "no"
        asset = library.asset(item.asset)
        role = ", a bystander: it should stay" if item.role == "bystander" else ""
        what = _escape_markdown((f"{asset.kind}, filled in by the task" if item.fill else asset.description) + role)
        cells = (what, f"{mass:.3g}", moves, _describe_origin(item.asset, library))
        yield f"| `object_{item.id}` | {' | '.join(cells)} |"
    if instance.background is not None:
        yield f"| `background` | what stands around, as photographed | | no | {_escape_markdown(instance.background)} |"
    links = ", ".join(f"`{name}`" for name in scene.world.arm.link_names)
    yield f"| {links} | the robot, {_escape_markdown(instance.robot.rsplit('/', 1)[-1])} | | | |"
    yield "\nA free object's joint is called like its body."
    yield "\n| actuator | moves | command |\n|---|---|---|"
    for index in range(model.nu):
        low, high = model.actuator_ctrlrange[index].tolist()
        adhesion = model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_BODY
        what = (
            "the suction cup | 0 off, 1 on" if adhesion else f"the joint of that name | position, {low:.3g}..{high:.3g}"
        )
        yield f"| `{model.actuator(index).name}` | {what} |"
    yield "\n| other | what it is |\n|---|---|"
    yield f"| site `tip` | the end of the {'blade' if instance.primitive == 'push' else 'suction cup'} |"
    if instance.camera is not None:
        size = f"{instance.camera.width} x {instance.camera.height}"
        yield f"| camera `photo` | the camera that took the photo, {size} pixels, with its intrinsics |"
    if instance.ties:
        yield "| equalities `tie_<n>` | what keeps objects together |"
    yield "| geom groups | 0 the table; 1 the robot; 2 what is seen of objects; 3 what touches (hidden at first) |"
    yield f"| time step | {instance.timestep:g} s |"


def _describe_origin(name: str, library: Library) -> str:
    """Asset with its origin and licence, as far as known."""
    asset = library.asset(name)
    if asset.origin is not None:
        return _escape_markdown(
            f"{name}: {asset.origin.collection}, {asset.origin.source}; licence: {asset.origin.license}"
        )
    if asset.category == "proxy":
        return _escape_markdown(f"{name}: made of the photo")
    shipped = any(library.asset_path(name).is_relative_to(root.resolve()) for root in Library().roots)
    return _escape_markdown(f"{name}: " + ("shipped with GRS, Apache-2.0" if shipped else "licence unknown"))
