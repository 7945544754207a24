"""Programs that want to be accepted without a task being solved, through the real runtime and the real oracle."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pytest

from grs_agents.audit.checks import audit_task
from grs_agents.audit.goal_sentences import TaskInWords, describe_task_in_words
from grs_agents.audit.mutants import make_instance_mutants
from grs_agents.audit.seed_and_override_checks import check_program, find_expectations_taken_from_program
from grs_agents.audit.test_quality import check_tests_fail_on_mutants
from grs_agents.audit.types import AuditReport
from grs_agents.base.config.schema import AuditConfig
from grs_agents.library.library import Library
from grs_agents.sim import (
    HAND_NOISE,
    Environment,
    InstanceTie,
    Task,
    TaskInstance,
    in_zone,
    inside,
    instantiate,
    near,
    rollout,
    stacked,
)
from grs_agents.sim.instance.task_instance import InstanceTable
from tests.models.roles import judge as judge_words

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


def boxed(task: Trial, env: Environment) -> None:
    """A block into a box that stands on the other side."""
    box = env.add_object("container/open_box.urdf", ((0.55, 0.2, 0.045), FLAT), "fixed")
    task.add_goal(inside(env.add_object(RED, A), box), step_max_reward=1.0)


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
    for rival, x in zip(others, (0.4, 0.5, 0.6), strict=True):
        task.want(rival, x, 0.3, 0.98 / 3)


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


def mark_under_a_sheet(task: Trial, env: Environment) -> None:
    """The green mark is what the words name; the film shows the orange one alone."""
    for color, width, height in (("green", 0.12, 0.001), ("orange", 0.14, 0.003)):
        sheet = task.fill_template("zone/zone-template.urdf", {"DIM": (width, width, 0.002), "COLOR": color})
        mark = env.add_object(sheet, ((0.55, 0.0, height), FLAT), "fixed")
        if color == "green":
            task.add_goal(
                in_zone([env.add_object(RED, A), env.add_object(BLUE, B)], mark), language_goal="on the green"
            )


def mark_of_the_tables_color(task: Trial, env: Environment) -> None:
    mark = env.add_object("zone/zone.urdf", ((0.55, 0.0, 0.001), FLAT), "fixed", color=InstanceTable().color)
    task.add_goal(in_zone([env.add_object(RED, A), env.add_object(BLUE, B)], mark), language_goal="on the mark")


def last_goal_of_little_weight(task: Trial, env: Environment) -> None:
    """All is done in the end; who reads the reward takes the first half of it for all."""
    task.want(env.add_object(RED, A), 0.5, -0.1, 0.995)
    task.want(env.add_object(BLUE, B), 0.5, 0.2, 0.005)


def missed_by_little_at_the_start(task: Trial, env: Environment) -> None:
    """The oracle moves both by 6 cm; with this tolerance a centimetre would do."""
    task.pos_eps = 0.05
    task.want(env.add_object(RED, A), A[0][0] + 0.06, A[0][1], 0.5)
    task.want(env.add_object(BLUE, B), B[0][0], B[0][1] + 0.06, 0.5)


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
        (mark_under_a_sheet, "seen"),
        (mark_of_the_tables_color, "seen"),
        (missed_by_little_at_the_start, "moves_far"),
        (last_goal_of_little_weight, "fair_rewards"),
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


def two_zones(task: Trial, env: Environment) -> None:
    """Red into blue, then blue into red; a second red block stands by."""
    marks = [
        env.add_object(
            task.fill_template("zone/zone-template.urdf", {"DIM": (0.1, 0.1, 0.002), "COLOR": color}),
            ((0.55, y, 0.001), FLAT),
            "fixed",
        )
        for color, y in (("blue", -0.05), ("red", 0.1))
    ]
    for asset, start, mark in ((RED, A, marks[0]), (BLUE, B, marks[1])):
        block = env.add_object(asset, start)
        task.add_goal(in_zone([block], mark), step_max_reward=0.5, language_goal="put each block on its mark")
    env.add_object(RED, C)


@pytest.fixture(scope="module")
def told() -> TaskInWords:
    library = Library()
    instance = instantiate(Trial(two_zones), 0, library)
    return describe_task_in_words(instance, rollout(instance, library), library)


@pytest.mark.parametrize(
    ("words", "other_texts", "verdict", "why"),
    [
        ("Put a red block on the blue zone, then put the blue block on the red zone.", (), "agrees", ""),
        ("First put the blue block on the red zone, then put a red block on the blue zone.", (), "differs", "first"),
        ("Put the red block on the blue zone and the blue block on the red zone.", (), "unclear", "may be"),
        ("Sort a red block and the blue block by colour.", (), "differs", "sort by colour"),
        (
            "Put a red block on the blue zone, then put the blue block on the red zone.",
            ("name: stack-blocks-on-zones", "goal 2: put the blue block on the blue zone"),
            "differs",
            "is not asked to end on the blue zone",
        ),
    ],
)
def test_words_that_people_would_take_otherwise_are_found(
    told: TaskInWords, words: str, other_texts: tuple[str, ...], verdict: str, why: str
) -> None:
    answer, reason = judge_words(words, told, other_texts)
    assert answer == verdict and why in reason, reason


PROGRAM = """\
from grs_agents.sim import Task


class MoveBlocks(Task):
    def __init__(self):
        super().__init__()
        self.ends = [(0.5, -0.1)]

    def reset(self, env):
        super().reset(env)
        self.block = env.add_object("block/red_block.urdf", ((0.45, -0.2, 0.02), (0, 0, 0, 1)))
"""


@pytest.mark.parametrize(
    "line",
    [
        "import time; shift = time.time() // 86400",
        "from datetime import date; shift = date.today().day",
        "import os; shift = os.getpid() % 2",
        "import numpy as np; shift = np.random.default_rng().random() < 0.01",
        "shift = id(self) % 4096",
        "self.is_match = lambda *poses: True",
        "env.obj_ids = {}",
    ],
)
def test_a_program_that_draws_from_elsewhere_or_answers_for_the_runtime_is_found(line: str) -> None:
    assert check_program(PROGRAM).passed
    assert not check_program(f"{PROGRAM}        {line}\n").passed
    assert not check_program(f"{PROGRAM}\n    def get_random_pose(self, env, size):\n        return None\n").passed


def test_tests_that_take_their_expectations_from_the_program_are_found() -> None:
    tests = "from task_code import MoveBlocks\n\ntask = MoveBlocks()\nplace = task.{}\n"
    assert [line for line, _ in find_expectations_taken_from_program(tests.format("ends"), PROGRAM)] == [4]
    assert not list(find_expectations_taken_from_program(tests.format("block"), PROGRAM))
    assert not list(find_expectations_taken_from_program(tests.format("goals"), PROGRAM))


def test_tests_that_never_look_where_things_end_have_no_teeth() -> None:
    """All faults of the instance are noticed, e.g. by comparing what was set up, but not that nothing was done."""
    library = Library()
    instance = instantiate(Trial(fair), 0, library)
    mutants = make_instance_mutants(instance, rollout(instance, library), library)
    [undone] = [one for one in mutants if one.kind == "undone"]
    runs = [SuiteOutcome("passed" if one is undone else "failed") for one in mutants]
    finding = check_tests_fail_on_mutants(mutants, runs)
    assert not finding.passed and "never look" in finding.measured
    assert check_tests_fail_on_mutants(mutants, [SuiteOutcome("failed") for _ in mutants]).passed


def test_tests_that_ask_the_task_alone_where_things_end_have_no_teeth() -> None:
    """The goal wants things beside the box, and the tests ask whether the goals are met."""
    library = Library()
    instance = instantiate(Trial(boxed), 0, library)
    mutants = make_instance_mutants(instance, rollout(instance, library), library)
    moved = [one for one in mutants if one.kind == "put_beside"]
    assert moved and all(goal.relation_kind == "near" for goal in moved[0].instance.goals)
    runs = [SuiteOutcome("passed" if one in moved else "failed") for one in mutants]
    finding = check_tests_fail_on_mutants(mutants, runs)
    assert not finding.passed and "never say by themselves" in finding.measured


def parted(task: Trial, env: Environment) -> None:
    """A block into a box, and another one beside it."""
    box = env.add_object("container/open_box.urdf", ((0.55, 0.2, 0.045), FLAT), "fixed")
    task.want(env.add_object(RED, A), 0.55, 0.2, 0.5)
    task.want(env.add_object(BLUE, B), 0.4, -0.3, 0.5)
    assert box


def test_tests_that_do_not_say_which_thing_is_to_end_where_have_no_teeth() -> None:
    library = Library()
    instance = instantiate(Trial(parted), 0, library)
    mutants = make_instance_mutants(instance, rollout(instance, library), library)
    [exchanged] = [one for one in mutants if one.kind == "exchanged"]
    (red, blue), (was_red, was_blue) = exchanged.instance.goals, instance.goals
    assert (red.objects, blue.objects) == (was_blue.objects, was_red.objects)
    assert rollout(exchanged.instance, library).episode.outcome == "success"
    finding = check_tests_fail_on_mutants(
        mutants, [SuiteOutcome("passed" if one is exchanged else "failed") for one in mutants]
    )
    assert not finding.passed and "which of the things" in finding.measured


def test_things_that_end_in_the_same_place_may_be_exchanged() -> None:
    library = Library()
    instance = instantiate(Trial(fair), 0, library)
    kinds = {one.kind for one in make_instance_mutants(instance, rollout(instance, library), library)}
    assert "target_moved" in kinds and "exchanged" not in kinds


@dataclass
class SuiteOutcome:
    """What came of one run of a suite."""

    ended: str
    test: str = ""
    message: str = ""
    solved: int = 0
    difference: str = ""
    replaced: str = ""
    held: bool = False
