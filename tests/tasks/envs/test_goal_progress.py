"""Which objects are in place, as the observations tell it."""

import math
from pathlib import Path

import gymnasium
import pytest

from grs_agents.sim.instance.goal import Zone
from tests.tasks.envs.conftest import START, block_instance


@pytest.mark.parametrize(("turn", "is_open"), [((0.0, 0.0, 0.38268343, 0.92387953), 0), ((0.0, 0.0, 0.0, 1.0), 1)])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_zone_is_as_long_as_its_turn_says(
    tmp_path: Path, turn: tuple[float, float, float, float], is_open: int, mirrored: bool
) -> None:
    """The block lies 11 cm from the middle of a strip of 30 x 8 cm, at 45 degrees: along it only if it is turned so."""
    instance = block_instance(0)
    x, y, z = START[0]
    x, y = x - 0.08, y + 0.08 if mirrored else y - 0.08
    zone = Zone(pose=((x, y, z), (*turn[:2], -turn[2] if mirrored else turn[2], turn[3])), size=(0.3, 0.08, 0.1))
    changes = {"metric": "zone", "targets": (), "matches": ((),), "zones": (zone,)}
    goal = instance.goals[0].model_copy(update=changes)
    (tmp_path / "instances").mkdir()
    told = instance.model_copy(update={"goals": (goal,)}).model_dump_json()
    (tmp_path / "instances" / "seed_0.json").write_text(told, encoding="utf-8")
    seen, _ = gymnasium.make("grs_agents.envs:GRS-v0", run=tmp_path).reset(seed=0)
    assert seen["open"].tolist() == [is_open]


@pytest.mark.parametrize(("symmetry", "told"), [(math.pi / 2, 90.0), (math.pi, 0.0), (2 * math.pi, 0.0), (0.0, 80.0)])
def test_a_target_has_the_turn_nearest_to_the_object_of_those_that_look_the_same(
    tmp_path: Path, symmetry: float, told: float
) -> None:
    """The block is turned by 80 degrees, its target by none."""
    instance = block_instance(0)
    half = math.radians(40)
    block = instance.objects[0].model_copy(update={"pose": (START[0], (0.0, 0.0, math.sin(half), math.cos(half)))})
    goal = instance.goals[0].model_copy(update={"symmetries": (symmetry,)})
    (tmp_path / "instances").mkdir()
    changed = instance.model_copy(update={"objects": (block,), "goals": (goal,)})
    (tmp_path / "instances" / "seed_0.json").write_text(changed.model_dump_json(), encoding="utf-8")
    seen, _ = gymnasium.make("grs_agents.envs:GRS-v0", run=tmp_path).reset(seed=0)
    z, w = seen["targets"][0, 5:]
    assert math.degrees(2 * math.atan2(z, w)) == pytest.approx(told, abs=0.5)
