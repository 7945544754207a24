"""Which objects are in place, as the observations tell it."""

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
