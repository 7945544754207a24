from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from pydantic import ValidationError
from sim_scenes import Scripted, at, zone_goal

from grs_agents.sim import SimulationError, TaskInstance, find_task_class, instantiate, rollout


def packing(task, env) -> None:
    size, pose = (0.3, 0.2, 0.06), at(0.5, -0.2, 0.03)
    env.add_object(task.fill_template("container/container-template.urdf", {"DIM": size}), pose, "fixed")
    cans = [env.add_object("HOPE/Corn.urdf", at(0.45 + 0.12 * i, 0.2, 0.029)) for i in range(2)]
    zone_goal(task, cans, pose, size)


def test_a_recording_holds_the_motion_of_objects_and_links(tmp_path: Path) -> None:
    done = rollout(instantiate(Scripted(packing), 0), recording=tmp_path / "motion.npz")
    data = np.load(tmp_path / "motion.npz")
    names = data["names"].tolist()
    frames = len(data["times"])
    assert data["positions"].shape == (frames, len(names), 3)
    assert data["quaternions"].shape == (frames, len(names), 4)
    assert data["tool"].shape == (frames, 3)
    assert "object_2" in names
    np.testing.assert_allclose(data["positions"][-1, names.index("object_2")], done.final[2][0], atol=1e-3)
    assert np.diff(data["times"]).mean() == pytest.approx(1 / 30, abs=0.005)


def test_a_filled_template_travels_in_the_instance() -> None:
    instance = instantiate(Scripted(packing), 0)
    assert instance.objects[0].fill["DIM"] == pytest.approx((0.2, 0.2, 0.05), abs=0.2)
    assert instance.objects[1].fill == {}
    assert TaskInstance.model_validate_json(instance.model_dump_json(), strict=True) == instance


def test_rewards_that_do_not_add_up_are_scaled_with_a_warning() -> None:
    def scene(task, env) -> None:
        for index in range(2):
            can = env.add_object("HOPE/Corn.urdf", at(0.45 + 0.12 * index, 0.2, 0.029))
            zone_goal(task, [can], at(0.5, -0.2, 0.0), (0.3, 0.3, 0.0), reward=1)

    instance = instantiate(Scripted(scene), 0)
    assert [goal.max_reward for goal in instance.goals] == [0.5, 0.5]
    assert "2.00" in instance.warnings[0]


def test_an_instance_out_of_range_is_refused() -> None:
    instance = instantiate(Scripted(packing), 0).model_dump()
    instance["objects"][1]["pose"] = ((9.0, 0, 0), (0, 0, 0, 1))
    with pytest.raises(ValidationError):
        TaskInstance.model_validate(instance)


def test_a_program_without_a_task_is_named() -> None:
    with pytest.raises(SimulationError, match="Task"):
        find_task_class(ModuleType("empty"))


def test_fixed_things_that_reach_into_each_other_are_told_and_parts_of_one_are_not() -> None:
    def shelves(task, env) -> None:
        packing(task, env)
        for y in (0.0, 0.03):
            env.add_object("bowl/bowl.urdf", at(0.35, y, 0.0), "fixed")

    instance = instantiate(Scripted(shelves), 0)
    bowls = {item.id for item in instance.objects if item.asset == "bowl/bowl.urdf"}
    (overlap,) = rollout(instance).overlaps
    assert {overlap.first, overlap.second} == bowls and overlap.depth > 0.01
