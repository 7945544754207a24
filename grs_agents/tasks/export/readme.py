"""README of an exported scene: its contents, names, and the use of suction."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grs_agents.base.control_characters import escape_control_chars
from grs_agents.base.mujoco_import import mujoco
from grs_agents.base.templates import load_template
from grs_agents.base.version import __version__
from grs_agents.library.library import Library
from grs_agents.sim.hands.two_fingers import TwoFingerHand
from grs_agents.sim.instance.task_instance import hash_instance
from grs_agents.sim.world.suction import HOLDING_FORCE, PEELING_MOMENT
from grs_agents.tasks.export.mjcf_scene import MjcfScene


@dataclass(frozen=True)
class Words:
    """Name and description of a task; empty if unknown."""

    name: str
    description: str


def write_readme_text(scene: MjcfScene, model: Any, library: Library, words: Words) -> str:
    """The README in Markdown; ``model`` is the scene's ``mujoco.MjModel``."""
    hand = scene.world.arm.hand
    return load_template(Path(__file__).with_name("readme.md"), markdown=_escape_markdown).render(
        scene=scene,
        fingers=hand if isinstance(hand, TwoFingerHand) else None,
        instance=scene.instance,
        words=words,
        goals=list(_describe_goals(scene)),
        bodies=list(_describe_bodies(scene, model, library)),
        actuators=list(_describe_actuators(model)),
        timestep=f"{scene.instance.timestep:g}",
        holding_force=f"{HOLDING_FORCE:g}",
        peeling_moment=f"{PEELING_MOMENT:g}",
        sha256=hash_instance(scene.instance),
        version=__version__,
        mujoco_version=mujoco.__version__,
    )


def _escape_markdown(text: str) -> str:
    """Foreign text as a line of Markdown without markup."""
    line = escape_control_chars(" ".join(text.split()))
    return "".join(f"\\{letter}" if letter in "\\`*_{}[]<>#|" else letter for letter in line)


def _describe_goals(scene: MjcfScene) -> Iterator[dict[str, str]]:
    """Kind, objects, sentence and sites of each goal."""
    for index, goal in enumerate(scene.instance.goals):
        yield {
            "kind": f"{goal.metric} goal" if goal.relation is None else f"relation *{goal.relation_kind}*",
            "objects": ", ".join(f"`object_{number}`" for number in goal.objects),
            "language": goal.language,
            "sites": "; ".join(f"`{site.name}`: {site.shows}" for site in scene.sites if site.goal == index),
        }


def _describe_bodies(scene: MjcfScene, model: Any, library: Library) -> Iterator[dict[str, str]]:
    """Number, description, mass, joint and origin of each object."""
    for item in scene.instance.objects:
        asset = library.asset(item.asset)
        role = ", a bystander: it should stay" if item.role == "bystander" else ""
        yield {
            "number": str(item.id),
            "description": (f"{asset.kind}, filled in by the task" if item.fill else asset.description) + role,
            "mass": f"{float(model.body(f'object_{item.id}').mass[0]):.3g}",
            "moves": "freely" if item.id in scene.world.free else "no",
            "origin": f"{item.asset}: {_describe_origin(item.asset, library)}",
        }


def _describe_actuators(model: Any) -> Iterator[dict[str, str]]:
    for index in range(model.nu):
        low, high = model.actuator_ctrlrange[index].tolist()
        adhesion = model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_BODY
        joint = f"the joint of that name | position, {low:.3g}..{high:.3g}"
        yield {"name": model.actuator(index).name, "effect": "the suction cup | 0 off, 1 on" if adhesion else joint}


def _describe_origin(name: str, library: Library) -> str:
    """Origin of an asset and its licence, as far as known."""
    asset = library.asset(name)
    if asset.origin is not None:
        return f"{asset.origin.collection}, {asset.origin.source}; licence: {asset.origin.license}"
    if asset.category == "proxy":
        return "made of the photo"
    shipped = any(library.asset_path(name).is_relative_to(root.resolve()) for root in Library().roots)
    return "shipped with GRS, Apache-2.0" if shipped else "licence unknown"
