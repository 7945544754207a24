"""Data that a program hands on: instances, templates and descriptions that name what they should not."""

import inspect
import json
from pathlib import Path
from typing import Any

import pytest

from grs_agents.base.config.schema import Limits
from grs_agents.library.library import Library
from grs_agents.toolkit import ToolContext, load_tool
from tests.sandbox.attacks import descriptions
from tests.sandbox.attacks.conftest import Door
from tests.sandbox.attacks.world import Canaries

KIT = descriptions.KIT
PROGRAM = """
from grs_agents import sim
class Hostile(sim.Task):
    def reset(self, env):
        super().reset(env)
        found = {name}(self, env, {secret!r})
        self.add_goal(objs=[found], matches=[[1]], targ_poses=[POSE], replace=False, rotations=False, metric="pose",
                      params=None, step_max_reward=1.0)
"""
ASKING = [
    name
    for name, thing in vars(descriptions).items()
    if inspect.isfunction(thing) and list(inspect.signature(thing).parameters) == ["task", "env", "secret"]
]


def tools(door: Door, **limits: float) -> ToolContext:
    return ToolContext(sandbox=door.sandbox, library=Library(), limits=Limits().model_copy(update=limits))


@pytest.mark.parametrize("name", ASKING)
def test_a_program_gets_no_file_through_the_library(name: str, door: Door, watched: Canaries) -> None:
    hostile = inspect.getsource(descriptions) + PROGRAM.format(name=name, secret=watched.world["key_file"])
    tool = load_tool("instantiate")
    result = tool.run(tool.Request(simulation=hostile, seeds=(0,)), tools(door, wall_seconds=20))
    assert not result.instances
    assert result.failures[0].outcome not in ("timeout", "memory", "crashed"), result
    assert watched.secret not in repr(result)


FORGED: dict[str, Any] = {
    "unknown key": {"gravity": 0},
    "a key of the class": {"__class__": "os.system"},
    "giant whole number": {"max_steps": 10**400},
    "giant number": {"timestep": 1e300},
    "negative steps": {"max_steps": -1},
    "text for a number": {"timestep": "0.002"},
    "a number for text": {"task": 7},
    "yes for a number": {"max_steps": True},
    "200,000 objects": {
        "objects": [{"id": 1, "asset": "block/red_block.urdf", "pose": [[0, 0, 0], [0, 0, 0, 1]]}] * 200_000
    },
    "an endless name": {"task": "x" * 300_000},
    "10,000 goals": {"goals": [{}] * 10_000},
    "deeply nested": {"objects": json.loads("[" * 500 + "]" * 500)},
    "another seed": {"seed": 2**70},
    "no object at all": [],
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_instance_is_refused(name: str, door: Door, watched: Canaries) -> None:
    forged = (
        "import json\nfrom grs_agents import sim\nclass T(sim.Task): pass\nclass Forged:\n"
        "    def model_dump(self, mode):\n"
        f"        change = json.loads({json.dumps(FORGED[name])!r})\n"
        "        base = {'task': 'T', 'seed': 0, 'max_steps': 3, 'timestep': 0.002, 'objects': [], 'goals': []}\n"
        "        return base | change if isinstance(change, dict) else change\n"
        "sim.instantiate = lambda task, seed, library: Forged()\n"
    )
    tool = load_tool("instantiate")
    result = tool.run(tool.Request(simulation=forged, seeds=(0,)), tools(door))
    assert not result.instances
    assert result.failures[0].message


ASSETS: dict[str, dict[str, Any]] = {
    "absolute": {"asset": "{secret}"},
    "above": {"asset": "../../../../../../../../../..{secret}"},
    "its folder": {"asset": "{folder}"},
    "filled with a file": {"asset": KIT, "fill": {"FNAME": ["{secret}"], "SCALE": [1, 1, 1], "COLOR": [1, 1, 1]}},
    "filled with markup": {"asset": KIT, "fill": {"FNAME": ['x"/><mesh filename="{secret}']}},
    "filled with words": {"asset": "container/container-template.urdf", "fill": {"DIM": ["&x;", 1, 1]}},
    "filled with giants": {"asset": "container/container-template.urdf", "fill": {"DIM": [1e300, 1, 1]}},
    "nowhere": {"asset": "block/red_block.urdf", "pose": [[1e300, 0, 0], [0, 0, 0, 1]]},
    "turned by nothing": {"asset": "block/red_block.urdf", "pose": [[0.5, 0, 0], [0, 0, 0, 0]]},
    "with a key too many": {"asset": "block/red_block.urdf", "mjcf": "<include file='{secret}'/>"},
}


@pytest.mark.parametrize("name", ASSETS)
def test_an_instance_names_no_file_out_of_the_library(name: str, door: Door, watched: Canaries) -> None:
    text = json.dumps({"id": 1, "pose": [[0.5, 0, 0.05], [0, 0, 0, 1]], **ASSETS[name]})
    for word, path in (("secret", watched.world["key_file"]), ("folder", watched.world["folder"])):
        text = text.replace(f"{{{word}}}", path)
    base = {"task": "T", "seed": 0, "max_steps": 1, "timestep": 0.002, "goals": []}
    tool = load_tool("rollout")
    result = tool.run(tool.Request(instance={**base, "objects": [json.loads(text)]}), tools(door))
    assert result.rollout is None or result.rollout["episode"]["outcome"] == "error"
    assert watched.secret not in repr(result)


@pytest.mark.parametrize("robot", ["{secret}", "{folder}", "../../arm.xml", "{folder}/arm.xml"])
def test_a_robot_is_an_arm_or_nothing(robot: str, door: Door, watched: Canaries) -> None:
    robot = robot.replace("{secret}", watched.world["key_file"]).replace("{folder}", watched.world["folder"])
    base = {"task": "T", "seed": 0, "max_steps": 1, "timestep": 0.002, "goals": [], "objects": []}
    tool = load_tool("rollout")
    result = tool.run(tool.Request(instance={**base, "robot": robot}), tools(door))
    assert result.rollout is None
    assert watched.secret not in result.error


def test_a_result_file_of_the_program_is_not_taken_for_one_of_ours(door: Door, watched: Canaries) -> None:
    """A link in scratch where trusted code writes next leads nowhere."""
    result = door.execute(
        "import os\nfrom grs_agents.base.files import write_text\n"
        f"os.symlink({watched.world['files'][0]!r}, 'result')\n"
        "from pathlib import Path\n"
        "try: write_text(Path('result'), 'overwritten')\nexcept OSError: pass\nvalue = {'got': 1}"
    )
    assert result.outcome == "ok", result.error
    assert Path(watched.world["files"][0]).read_text() == watched.secret
