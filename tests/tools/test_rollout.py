"""The trusted oracle in a process of its own."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grs_agents.sim import Rollout
from grs_agents.toolkit import ToolContext, load_tool


@pytest.fixture
def instance(context: ToolContext, simulation: str) -> dict[str, Any]:
    tool = load_tool("instantiate")
    return tool.run(tool.Request(simulation=simulation, seeds=(0,)), context).instances[0]


def test_an_instance_is_solved_and_recorded(context: ToolContext, instance: dict[str, Any], tmp_path: Path) -> None:
    tool = load_tool("rollout")
    file = tmp_path / "motion.npz"
    result = tool.run(tool.Request(instance=instance, recording=str(file)), context)
    rollout = Rollout.model_validate(result.rollout)
    assert (rollout.episode.outcome, rollout.idle_reward) == ("success", 0.0)
    assert rollout.moved == ("block/red_block.urdf",)
    with np.load(file) as motion:
        frames, bodies = motion["positions"].shape[:2]
        assert motion["quaternions"].shape == (frames, bodies, 4)
        assert len(motion["names"]) == bodies


def test_the_robot_of_the_instance_solves_it(context: ToolContext, instance: dict[str, Any], tmp_path: Path) -> None:
    tool = load_tool("rollout")
    file = tmp_path / "motion.npz"
    result = tool.run(tool.Request(instance={**instance, "robot": "panda"}, recording=str(file)), context)
    assert Rollout.model_validate(result.rollout).episode.outcome == "success"
    with np.load(file) as motion:
        assert {"link_7", "cup"} <= set(motion["names"].tolist())


def test_a_robot_that_is_not_there_is_a_value(context: ToolContext, instance: dict[str, Any]) -> None:
    tool = load_tool("rollout")
    result = tool.run(tool.Request(instance={**instance, "robot": "pandas"}), context)
    assert (result.rollout, result.outcome) == (None, "error")
    assert "panda" in result.error


def test_the_same_instance_gives_the_same_episode(context: ToolContext, instance: dict[str, Any]) -> None:
    tool = load_tool("rollout")
    first, second = (tool.run(tool.Request(instance=instance), context).rollout for _ in range(2))
    assert first == second


def test_an_instance_off_schema_is_a_value(context: ToolContext, instance: dict[str, Any]) -> None:
    tool = load_tool("rollout")
    result = tool.run(tool.Request(instance={**instance, "max_steps": -1}), context)
    assert result.rollout is None
    assert result.outcome == "error" and result.error


def test_several_instances_are_solved_as_each_by_itself(
    context: ToolContext, instance: dict[str, Any], tmp_path: Path
) -> None:
    tool = load_tool("rollout")
    file, other = tmp_path / "motion.npz", {**instance, "seed": 7}
    jobs = [{"instance": {**instance, "max_steps": -1}}, {"instance": other, "recording": str(file), "trials": 1}]
    result = tool.run(tool.Request(instance=instance, more=jobs), context)
    assert result.rollout == tool.run(tool.Request(instance=instance), context).rollout
    assert [one.outcome for one in result.more] == ["error", "ok"]
    alone = tool.run(tool.Request(**jobs[1]), context)
    assert result.more[1].rollout == alone.rollout
    assert file.is_file()


def test_several_instances_that_take_too_long_are_each_told_so(context: ToolContext, instance: dict[str, Any]) -> None:
    tool = load_tool("rollout")
    small = ToolContext(context.sandbox, context.library, context.limits.model_copy(update={"wall_seconds": 0.001}))
    result = tool.run(tool.Request(instance=instance, more=[{"instance": instance}]), small)
    assert (result.outcome, [one.outcome for one in result.more]) == ("timeout", ["timeout"])
