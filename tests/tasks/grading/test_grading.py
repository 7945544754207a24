"""Grades: what is measured of a task, and policies that learn from the expert's decisions."""

import numpy as np
import pytest

from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json
from grs_agents.library.library import Library
from grs_agents.sim import instantiate, near, stacked
from grs_agents.sim.variation.types import Variation
from grs_agents.sim.variation.vary import vary_instance
from grs_agents.tasks.grading.grade import grade_task, measure_tolerance, noise_at_half_success
from grs_agents.tasks.grading.primitive_policy import PrimitiveDemonstration, PrimitivePolicy
from grs_agents.tasks.grading.primitive_task import (
    CarryDecision,
    PrimitiveTask,
    decide,
    demonstrate,
    evaluate_policy,
    random_decision,
)
from grs_agents.tasks.grading.trials import GradeOrder
from grs_agents.tasks.task_folder import open_task_folder
from tests.sim.sim_scenes import Scripted, at, pose_goal, zone_goal

LIBRARY = Library()


def sorting(task, env) -> None:
    """A block to a place, a can into a box."""
    env.add_object("container/small_open_box.urdf", at(0.5, 0.25, 0.03), "fixed")
    can = env.add_object("HOPE/Corn.urdf", at(0.45, -0.2, 0.029))
    block = env.add_object("block/red_block.urdf", at(0.6, 0.0, 0.02))
    zone_goal(task, [can], at(0.5, 0.25, 0.03), (0.18, 0.14, 0.06), 0.5)
    pose_goal(task, block, at(0.6, -0.25, 0.02), 0.5)


INSTANCE = instantiate(Scripted(sorting, max_steps=5), 0, LIBRARY)


@pytest.fixture
def folder(tmp_path):
    write_json(tmp_path / "instances" / "seed_0.json", INSTANCE.model_dump(mode="json"))
    return open_task_folder(tmp_path)


def test_a_decision_carries_an_object_to_a_place_with_a_yaw() -> None:
    task = PrimitiveTask(INSTANCE, LIBRARY)
    task.carry(CarryDecision(3, (0.45, 0.1), 0.5))
    assert task.object_frame(3) == pytest.approx((0.45, 0.1, 0.5), abs=0.01)
    assert not task.is_solved
    task.carry(CarryDecision(3, (0.6, -0.25), 0.0))
    task.carry(CarryDecision(2, (0.5, 0.25), 0.0))
    assert task.is_over
    assert task.is_solved


@pytest.mark.parametrize(("robot", "hand"), [("ur5e", "suction"), ("panda", "franka_hand")])
def test_a_decision_of_the_expert_is_where_the_object_goes(robot: str, hand: str) -> None:
    turned = vary_instance(INSTANCE, Variation(yaw=0.5), np.random.default_rng(0), LIBRARY)
    instance = turned.model_copy(update={"robot": robot, "hand": hand})
    shown = demonstrate(PrimitiveTask(instance, LIBRARY), instance)
    assert shown is not None
    (x, y, yaw) = shown.places[shown.objects.tolist().index(1)]
    assert (x, y, np.sin(4 * yaw)) == pytest.approx((0, 0, 0), abs=0.005)


def test_a_policy_learns_from_a_demonstration_what_chance_does_not_find() -> None:
    task = PrimitiveTask(INSTANCE, LIBRARY)
    shown = demonstrate(task, INSTANCE)
    assert shown is not None
    assert shown.objects.tolist() == [0, 1]
    assert shown.places[1, :2] == pytest.approx((0.0, 0.0), abs=0.005), "seen from its target"
    policy = PrimitivePolicy([shown], iterations=100)
    assert evaluate_policy(task, INSTANCE, lambda one: decide(policy, one))
    rng = np.random.default_rng(0)
    assert not evaluate_policy(task, INSTANCE, lambda one: random_decision(one, rng))


def test_right_answers_of_two_kinds_are_told_apart_rather_than_averaged() -> None:
    rng = np.random.default_rng(1)
    features = rng.uniform(-1, 1, (200, 3))
    side = np.sign(features[:, 0])
    places = np.column_stack([0.2 * side, 0.1 * features[:, 1], np.where(side > 0, 0.0, np.pi)])
    alone = (np.ones((200, 1), dtype=bool), np.zeros(200, dtype=int))
    policy = PrimitivePolicy([PrimitiveDemonstration(features, *alone, places)], iterations=600)
    assert policy.slots >= 2
    for told in ((0.5, 0.4, 0.0), (-0.5, -0.3, 0.1)):
        number, (x, y, yaw) = policy(np.array(told), [True])
        assert (number, x) == (0, pytest.approx(0.2 * np.sign(told[0]), abs=0.02))
        assert y == pytest.approx(0.1 * told[1], abs=0.02)
        assert np.cos(yaw) == pytest.approx(np.sign(told[0]), abs=0.05)


def test_the_tolerance_of_a_typed_goal_follows_from_its_relation() -> None:
    def narrow_tower(task, env) -> None:
        base = env.add_object("block/red_block.urdf", at(0.5, 0.0, 0.02))
        can = env.add_object("HOPE/Corn.urdf", at(0.45, -0.2, 0.029))
        task.add_goal(stacked([base, can]))

    def neighbours(task, env) -> None:
        first = env.add_object("block/red_block.urdf", at(0.5, 0.0, 0.02))
        second = env.add_object("block/blue_block.urdf", at(0.5, 0.2, 0.02))
        task.add_goal(near([first], second, 0.07))

    tower = instantiate(Scripted(narrow_tower, max_steps=3), 0, LIBRARY)
    narrowest = min(min(LIBRARY.asset(item.asset).size[:2]) for item in tower.objects)
    widest = max(min(LIBRARY.asset(item.asset).size[:2]) for item in tower.objects)
    assert widest > narrowest + 0.01
    tolerance = measure_tolerance(tower, LIBRARY)
    assert (tolerance.metres, tolerance.degrees) == (pytest.approx(narrowest / 2, abs=1e-3), 180.0)
    beside = instantiate(Scripted(neighbours, max_steps=3), 0, LIBRARY)
    assert measure_tolerance(beside, LIBRARY).metres == pytest.approx(0.07)


def test_noise_at_which_success_halves_lies_between_the_levels_tried() -> None:
    assert noise_at_half_success([(0.0, 1.0), (0.005, 0.75), (0.01, 0.25)]) == pytest.approx(0.0075)
    assert noise_at_half_success([(0.0, 1.0), (0.01, 1.0)]) == 0.01


def test_a_task_is_graded_by_parts_that_add_up(folder) -> None:
    stages: list[str] = []
    order = GradeOrder(episodes=1, demonstrations=2, trials=1)
    grade = grade_task(folder, order, 1, lambda stage, done, total: stages.append(stage))
    total = sum(part.weight * part.difficulty for part in grade.parts)
    assert sum(part.weight for part in grade.parts) == pytest.approx(1.0)
    assert grade.difficulty == pytest.approx(total, abs=0.001)
    figures = grade.figures
    assert (figures.moves, figures.random_success, figures.demonstrations) == (2.0, 0.0, 2)
    assert figures.tolerance.metres == pytest.approx(0.01)
    assert figures.noise_success[0] == (0.0, 1.0)
    assert 0 < figures.half_noise <= 0.08
    assert "demonstrations" in stages


def test_a_task_that_the_expert_cannot_solve_is_not_graded(tmp_path) -> None:
    def apart(task, env) -> None:
        pose_goal(task, env.add_object("block/red_block.urdf", at(0.5, 0.0, 0.02)), at(0.5, 0.3, 0.15))

    instance = instantiate(Scripted(apart), 0, LIBRARY)
    write_json(tmp_path / "instances" / "seed_0.json", instance.model_dump(mode="json"))
    with pytest.raises(InputError, match="solves no variation"):
        grade_task(open_task_folder(tmp_path), GradeOrder(episodes=1, demonstrations=1, trials=1), 1)
