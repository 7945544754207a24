"""Programs that want to be accepted without a task being solved, through the real runtime and the real oracle."""

import math
from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest

from grs_agents.audit import AuditReport, audit_task
from grs_agents.config import AuditConfig
from grs_agents.library import Library
from grs_agents.sim import HAND_NOISE, Environment, InstanceTie, Task, TaskInstance, instantiate, near, rollout, stacked

Start = tuple[tuple[float, float, float], tuple[float, float, float, float]]
RED, BLUE, GREEN = (f"block/{color}_block.urdf" for color in ("red", "blue", "green"))
FLAT = (0.0, 0.0, 0.0, 1.0)
A, B, C = ((0.45, -0.2, 0.02), FLAT), ((0.4, 0.1, 0.02), FLAT), ((0.55, 0.3, 0.02), FLAT)
Setup = Callable[["Trial", Environment], None]


class Trial(Task):
    """A task whose reset is given."""

    def __init__(self, setup: Setup) -> None:
        super().__init__()
        self.setup = setup
        self.max_steps, self.lang_template = 6, "do it"

    def reset(self, env: Environment) -> None:
        super().reset(env)
        self.setup(self, env)

    def want(self, thing: int, x: float, y: float, reward: float) -> None:
        target = ((x, y, 0.02), FLAT)
        self.add_goal([thing], np.ones((1, 1)), [target], False, False, "pose", None, reward, [0], "there")


def fair(task: Trial, env: Environment) -> None:
    task.want(env.add_object(RED, A), 0.5, -0.1, 0.5)
    task.want(env.add_object(BLUE, B), 0.6, 0.0, 0.5)


def unmet_goal_of_little_weight(task: Trial, env: Environment) -> None:
    fixed = env.add_object(GREEN, C, "fixed")
    task.want(env.add_object(RED, A), 0.5, -0.1, 0.5)
    task.want(env.add_object(BLUE, B), 0.6, 0.0, 0.495)
    task.want(fixed, 0.3, -0.3, 0.005)


def met_before_it_begins(task: Trial, env: Environment) -> None:
    task.want(env.add_object(GREEN, C, "fixed"), 0.55, 0.3, 0.98)
    task.want(env.add_object(RED, A), 0.5, -0.1, 0.01)
    task.want(env.add_object(BLUE, B), 0.6, 0.0, 0.01)


def picked_and_put_back(task: Trial, env: Environment) -> None:
    task.want(env.add_object(RED, A), 0.461, -0.2, 0.5)
    task.want(env.add_object(BLUE, B), 0.411, 0.1, 0.5)


def later_goals_met_before_it_begins(task: Trial, env: Environment) -> None:
    others = [env.add_object(GREEN, ((x, 0.3, 0.02), FLAT)) for x in (0.4, 0.5, 0.6)]
    task.want(env.add_object(RED, A), 0.5, -0.1, 0.01)
    task.want(env.add_object(BLUE, B), 0.6, 0.0, 0.01)
    for other, x in zip(others, (0.4, 0.5, 0.6), strict=True):
        task.want(other, x, 0.3, 0.98 / 3)


def unmet_goal_without_weight(task: Trial, env: Environment) -> None:
    fixed = env.add_object(GREEN, C, "fixed")
    fair(task, env)
    task.want(fixed, 0.3, -0.3, 0.0)


def goal_in_the_air_of_little_weight(task: Trial, env: Environment) -> None:
    task.want(env.add_object(RED, A), 0.5, -0.1, 0.5)
    task.want(env.add_object(BLUE, B), 0.6, 0.0, 0.491)
    target = ((C[0][0], C[0][1], 0.4), FLAT)
    fixed = env.add_object(GREEN, C, "fixed")
    task.add_goal([fixed], np.ones((1, 1)), [target], False, False, "pose", None, 0.009, [0], "up there")


def swings_into_place(task: Trial, env: Environment) -> None:
    hook = env.add_object(GREEN, ((0.5, 0.4, 1.5), FLAT), "fixed")
    weight = env.add_object(GREEN, ((1.5, 0.4, 1.0), FLAT))
    frames = (((0.0, 0.0, 0.0), FLAT), ((-1.0, 0.0, 0.5), FLAT))
    env.tie_objects(InstanceTie(kind="point", parent=hook, child=weight, parent_frame=frames[0], child_frame=frames[1]))
    fair(task, env)


def creeps_into_place(task: Trial, env: Environment) -> None:
    """A block on a slope just steep enough to creep: it comes near another one after 3 s."""
    angle = math.radians(31)
    x, z, tilt = math.sin(angle), math.cos(angle), (0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2))
    slope = task.fill_template("box/box-template.urdf", {"DIM": (0.35, 0.12, 0.02)})
    env.add_object(slope, ((0.5, 0.3, 0.12), tilt), "fixed")

    def block(along: float, kind: Literal["rigid", "fixed"]) -> int:
        return env.add_object(GREEN, ((0.5 + 0.03 * x + along * z, 0.3, 0.12 + 0.03 * z - along * x), tilt), kind)

    task.want(env.add_object(RED, A), 0.5, -0.1, 0.01)
    task.want(env.add_object(BLUE, B), 0.6, 0.0, 0.01)
    nearby = near(block(-0.08, "rigid"), block(0.06, "fixed"), 0.02)
    task.add_goal(nearby, step_max_reward=0.98, language_goal="near the other one")


def falls_off_the_table(task: Trial, env: Environment) -> None:
    env.add_object(BLUE, ((0.4, 1.9, 0.5), FLAT))
    task.want(env.add_object(GREEN, C), C[0][0], C[0][1], 0.1)
    task.want(env.add_object(RED, A), 0.5, 0.1, 0.9)


def nudged(task: Trial, env: Environment) -> None:
    task.want(env.add_object(RED, A), A[0][0] + 0.03, A[0][1], 0.5)
    task.want(env.add_object(BLUE, B), B[0][0], B[0][1] + 0.03, 0.5)


def near_at_any_distance(task: Trial, env: Environment) -> None:
    fair(task, env)
    task.add_goal(near(env.add_object(GREEN, C), task.goals[0].objects[0], 0.3), step_max_reward=0.1)


def brought_back(task: Trial, env: Environment) -> None:
    red = env.add_object(RED, A)
    for x, y in ((0.6, 0.0), A[0][:2]):
        task.want(red, x, y, 0.5)


def over_the_rim(task: Trial, env: Environment) -> None:
    """A carton that is wider than the bowl lies across its rim; the target is inside the bowl."""
    env.add_object("bowl/bowl.urdf", ((0.55, 0.25, 0.03), FLAT), "fixed")
    carton = env.add_object("HOPE/Spaghetti.urdf", ((0.45, -0.2, 0.025), FLAT))
    task.add_goal(
        [carton], np.ones((1, 1)), [((0.55, 0.25, 0.03), FLAT)], False, False, "pose", None, 1.0, [0], "in it"
    )


def wedged(task: Trial, env: Environment) -> None:
    """A ball between the walls of an L-shaped hole that is narrower than the ball."""
    env.add_object("insertion/fixture.urdf", ((0.55, 0.25, 0.02), FLAT), "fixed")
    ball = env.add_object("ball/ball.urdf", ((0.45, -0.2, 0.03), FLAT))
    task.add_goal([ball], np.ones((1, 1)), [((0.55, 0.25, 0.05), FLAT)], False, False, "pose", None, 1.0, [0], "there")


def put_into_each_other(task: Trial, env: Environment) -> None:
    fair(task, env)
    env.add_object(GREEN, ((A[0][0] + 0.03, A[0][1], 0.02), FLAT))


def hung_in_the_air(task: Trial, env: Environment) -> None:
    fair(task, env)
    env.add_object(GREEN, ((C[0][0], C[0][1], 0.1), FLAT))


def judge(setup: Setup, change: Callable[[TaskInstance], TaskInstance] = lambda one: one) -> AuditReport:
    library = Library()
    instances = [change(instantiate(Trial(setup), seed, library)) for seed in range(2)]
    rollouts = [rollout(instance, library, trials=3) for instance in instances]
    return audit_task(instances, [], rollouts, AuditConfig(seeds=2), library)


def failed(report: AuditReport) -> set[str]:
    return {finding.check for finding in report.findings if not finding.passed}


def test_a_fair_program_is_accepted() -> None:
    report = judge(fair)
    assert report.accepted, str(report)


def one_of_several(task: Trial, env: Environment) -> None:
    """Only the red block is wanted; the others are there to be told from it."""
    task.want(env.add_object(RED, A), 0.5, -0.1, 1.0)
    env.add_object(BLUE, B)
    env.add_object(GREEN, C)


def a_stack_of_two(task: Trial, env: Environment) -> None:
    lower, upper = env.add_object(BLUE, B), env.add_object(RED, A)
    task.add_goal(stacked([lower, upper]), language_goal="put the red block on the blue block")


@pytest.mark.parametrize("setup", [one_of_several, a_stack_of_two])
def test_a_task_of_one_object_among_others_is_accepted(setup: Setup) -> None:
    report = judge(setup)
    assert report.accepted, str(report)
    assert {len(one.moved) for one in report.rollouts} == {1}


@pytest.mark.parametrize(
    ("setup", "check"),
    [
        (unmet_goal_of_little_weight, "solved"),
        (unmet_goal_without_weight, "solved"),
        (goal_in_the_air_of_little_weight, "solved"),
        (met_before_it_begins, "not_idle"),
        (later_goals_met_before_it_begins, "not_idle"),
        (swings_into_place, "not_idle"),
        (creeps_into_place, "not_idle"),
        (picked_and_put_back, "moved"),
        (falls_off_the_table, "moved"),
        (falls_off_the_table, "on_table"),
        (nudged, "moves_far"),
        (brought_back, "moves_far"),
        (brought_back, "not_idle"),
        (near_at_any_distance, "goals_narrow"),
        (over_the_rim, "solved"),
        (wedged, "rests_at_end"),
        (put_into_each_other, "clear_start"),
        (hung_in_the_air, "clear_start"),
    ],
)
def test_a_cheat_is_found(setup: Setup, check: str) -> None:
    assert check in failed(judge(setup))


@pytest.mark.parametrize(
    "change",
    [{"asset": "HOPE/Milk.urdf", "fill": {"DIM": (0.04, 0.04, 0.04)}}, {"asset": "zone/unheard-of.urdf"}],
    ids=["filled", "unknown"],
)
def test_an_asset_that_is_not_the_librarys_is_found(change: dict[str, object]) -> None:
    library = Library()
    plain = instantiate(Trial(fair), 0, library)
    first = plain.objects[0].model_copy(update=change)
    forged = plain.model_copy(update={"objects": (first, *plain.objects[1:])})
    report = audit_task([forged], [], [rollout(plain, library)], AuditConfig(seeds=1), library)
    assert "as_in_library" in failed(report)


def test_filled_templates_keep_their_shapes() -> None:
    def with_container(task: Trial, env: Environment) -> None:
        size = (0.21, 0.173, 0.0512)
        urdf = task.fill_template("container/container-template.urdf", {"DIM": size, "COLOR": (0.3, 0.6, 0.31)})
        env.add_object(urdf, ((0.6, 0.3, 0.0256), FLAT), "fixed")
        fair(task, env)

    report = judge(with_container)
    assert report.accepted, str(report)


def test_another_time_step_is_found() -> None:
    assert "as_in_library" in failed(judge(fair, lambda one: one.model_copy(update={"timestep": 0.002})))


def test_a_task_on_a_knifes_edge_is_found() -> None:
    """Two blocks side by side with 1 mm between them: a hand that misses by up to 5 mm puts one onto the other."""

    def tight(task: Trial, env: Environment) -> None:
        task.pos_eps = 0.002
        task.want(env.add_object(RED, A), 0.5, 0.0, 0.5)
        task.want(env.add_object(BLUE, B), 0.541, 0.0, 0.5)

    report = judge(tight)
    assert failed(report) == {"sure_hand"}


def test_the_trials_with_noise_are_the_same_each_time() -> None:
    library = Library()
    instance = instantiate(Trial(fair), 0, library)
    first, second = (rollout(instance, library, trials=2) for _ in range(2))
    assert first.trials == second.trials
    assert [trial.noise for trial in first.trials[:2]] == [HAND_NOISE[0]] * 2
    assert all(trial.score > 0.99 for trial in first.trials[:2])
