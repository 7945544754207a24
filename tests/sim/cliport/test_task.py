import numpy as np
import pytest
from sim_scenes import Scripted, at, pose_goal, zone_goal

from grs_agents.base.errors import UnknownNameError
from grs_agents.library.library import Library
from grs_agents.sim import Environment, Task, inside, instantiate, rollout, run_oracle, upright
from grs_agents.sim.cliport.end_effectors import push
from grs_agents.sim.cliport.task import PublishedTask
from grs_agents.sim.instance.episode import InvalidValueError

BLOCK = "block/red_block.urdf"
BOX = "box/box-template.urdf"


def drawn(scene):
    return instantiate(Scripted(scene), 0)


def goal(task, env, reward: float = 1.0) -> None:
    pose_goal(task, env.add_object(BLOCK, at(0.5, -0.2, 0.02)), at(0.5, 0.2, 0.02), reward)


def test_a_placeholder_left_out_takes_its_default_with_a_warning() -> None:
    def scene(task, env) -> None:
        goal(task, env)
        env.add_object(task.fill_template(BOX, {"COLOR": (1, 0, 0)}), at(0.4, 0.3, 0.05))

    instance = drawn(scene)
    assert instance.objects[1].fill["DIM"] == Library().template_defaults(BOX)["DIM"]
    assert [warning for warning in instance.warnings if "DIM left out" in warning and BOX in warning]


def test_a_template_added_as_it_is_takes_all_defaults_with_a_warning() -> None:
    def scene(task, env) -> None:
        goal(task, env)
        env.add_object(BOX, at(0.4, 0.3, 0.05))

    assert "was not filled in" in drawn(scene).warnings[0]


def test_a_placeholder_that_the_template_does_not_have_is_named() -> None:
    def scene(task, env) -> None:
        goal(task, env)
        env.add_object(
            task.fill_template(BOX, {"DIM": (0.1,) * 3, "COLOR": (1, 0, 0), "WIDTH": (2,)}), at(0.4, 0.3, 0.05)
        )

    assert list(drawn(scene).warnings) == [f"fill_template({BOX!r}): WIDTH is no placeholder of it, ignored"]


def test_box_corners_in_the_wrong_order_are_lengths_without_sign() -> None:
    def scene(task, env) -> None:
        size = np.array([0.1, -0.2, -0.05])
        pose = task.get_random_pose(env, size)
        env.add_object(task.fill_template(BOX, {"DIM": size, "COLOR": (1, 0, 0)}), pose)
        zone_goal(task, [1], at(0.5, 0.3, 0.0), (-0.3, 0.25, 0.0))

    instance = drawn(scene)
    assert instance.objects[0].fill["DIM"] == pytest.approx((0.1, 0.2, 0.05))
    assert instance.goals[0].zones[0].size == pytest.approx((0.3, 0.25, 0.0))
    assert len([warning for warning in instance.warnings if "without their sign" in warning]) == 3


def test_a_task_without_goals_is_warned_of_and_the_oracle_says_so() -> None:
    instance = drawn(lambda task, env: env.add_object(BLOCK, at(0.5, -0.2, 0.02)))
    assert instance.warnings == ("the task states no goal: its reset() never calls add_goal",)
    done = rollout(instance)
    assert (done.episode.outcome, done.reward, done.strict_score) == ("nothing_to_do", 0.0, 0.0)


@pytest.mark.parametrize("reward", [0.0, 0.25, 1.0001, 3.0])
def test_one_goal_of_any_reward_is_worth_one(reward: float) -> None:
    instance = drawn(lambda task, env: goal(task, env, reward))
    assert instance.goals[0].max_reward == pytest.approx(1.0, abs=1e-3)
    assert bool(instance.warnings) == (abs(reward - 1) > 0.01)
    assert rollout(instance).reward == pytest.approx(1.0)


def test_several_zones_do_not_cap_the_reward() -> None:
    def scene(task, env) -> None:
        blocks = [env.add_object(BLOCK, at(0.4 + 0.1 * index, -0.3, 0.02)) for index in range(3)]
        zones = [(at(x, 0.25, 0.0), (0.1, 0.1, 0.0)) for x in (0.4, 0.55)]
        task.add_goal(blocks, np.ones((3, 2)), [zone[0] for zone in zones], True, False, "zone", zones, 1.0)

    done = rollout(drawn(scene))
    assert (done.reward, done.strict_score) == (1.0, 1.0), done.episode


def test_a_programs_own_names_do_not_collide_with_the_runtimes() -> None:
    class Own(Task):
        """Calls its own things what the runtime could have called its own."""

        def reset(self, env: Environment) -> None:
            super().reset(env)
            self.count, self.scores, self.environment, self.ids = 3, [1], env, []
            self.total_reward, self.stated_goals, self.rng = 5.0, [], np.random.default_rng(3)
            block = env.add_object("block/red_block.urdf", ((0.45, -0.2, 0.02), (0, 0, 0, 1)))
            target = ((0.5, 0.1, 0.02), (0, 0, 0, 1))
            self.add_goal([block], np.ones((1, 1)), [target], False, False, "pose", None, 1.0, [0], "there")

    task = Own()
    env = Environment(task=task)
    env.reset()
    assert 0 <= task.get_random_size(0, 1, 0, 1, 0, 1)[0] <= 1
    run_oracle(env, task)
    assert env.current_episode.outcome == "success"


def test_two_fillings_that_differ_by_a_hair_are_two() -> None:
    sizes = [(0.12341, 0.1, 0.05), (0.12344, 0.1, 0.05)]

    def scene(task, env) -> None:
        names = [task.fill_template(BOX, {"DIM": size, "COLOR": "red"}) for size in sizes]
        for index, name in enumerate(names):
            env.add_object(name, at(0.5, 0.2 - 0.3 * index, 0.03))
        goal(task, env)

    assert [thing.fill["DIM"] for thing in drawn(scene).objects[:2]] == sizes


def test_arguments_that_have_no_effect_are_warned_of_and_reach_the_episode() -> None:
    def scene(task, env) -> None:
        block = env.add_object(BLOCK, at(0.5, -0.2, 0.02), scale=2)
        box = env.add_object("container/open_box.urdf", at(0.5, 0.2, 0.045), "fixed")
        task.add_goal(inside(block, box), step_max_reward=0.4, symmetry=[0], matches=np.ones((1, 1)))

    env = Environment(task=Scripted(scene))
    env.reset()
    said = "\n".join(env.current_episode.warnings)
    assert "env.add_object has no argument scale" in said
    assert (
        "task.add_goal has no argument symmetry, what was given for it had no effect; symmetries may be meant" in said
    )
    assert "matches had no effect, a typed goal says all by itself" in said
    assert "add up to 0.40, scaled to 1" in said
    env.reset()
    assert len(env.current_episode.warnings) == 4


def test_objects_put_into_each_other_are_named_with_how_far_settling_moved_them() -> None:
    def scene(task, env) -> None:
        goal(task, env)
        env.add_object("block/blue_block.urdf", at(0.51, -0.2, 0.02))

    env = Environment(task=Scripted(scene))
    env.reset()
    assert [warning.partition(":")[0] for warning in env.warnings] == [
        "block/red_block.urdf #1 was put into block/blue_block.urdf #2",
        "block/blue_block.urdf #2 was put into block/red_block.urdf #1",
    ]


def test_words_of_the_template_choose_only_for_programs_that_import_from_cliport() -> None:
    for kind, tolerance, pushes in ((Task, 0.01, False), (PublishedTask, 0.05, True)):
        task = kind()
        task.lang_template = "push the piles into the bowl"
        task.additional_reset()
        assert (task.pos_eps, task.primitive is push) == (tolerance, pushes)


def test_objects_are_found_by_what_they_are_made_of() -> None:
    def scene(task, env) -> None:
        goal(task, env)
        for width in (0.04, 0.06):
            filled = task.fill_template(BOX, {"DIM": (width, 0.05, 0.05), "COLOR": (1, 0, 0)})
            env.add_object(filled, at(0.4, 0.6 - 10 * width, 0.025))

    task = Scripted(scene)
    env = Environment(task=task)
    env.reset()
    assert (env.find(BLOCK), env.find(BOX), env.find("HOPE/Milk.urdf")) == ([1], [2, 3], [])
    assert env.find(task.fill_template(BOX, {"DIM": (0.06, 0.05, 0.05), "COLOR": (1, 0, 0)})) == [3]
    with pytest.raises(UnknownNameError, match=r"block/red_block\.urdf"):
        env.find("block/red_blok.urdf")


def test_what_is_appended_to_the_lists_of_a_goal_until_reset_ends_counts() -> None:
    def scene(task, env) -> None:
        blocks: list[int] = []
        targets: list[object] = []
        matches = np.zeros((2, 2))
        task.add_goal(objs=blocks, matches=matches, targ_poses=targets, step_max_reward=1.0)
        for number, y in enumerate((-0.2, 0.2)):
            blocks.append(env.add_object(BLOCK, at(0.4, y, 0.02)))
            targets.append(at(0.6, y, 0.02))
            matches[number, number] = 1

    (stated,) = drawn(scene).goals
    assert stated.objects == (1, 2)
    assert [target[0] for target in stated.targets] == [(0.6, -0.2, 0.02), (0.6, 0.2, 0.02)]
    assert stated.matches == ((1, 0), (0, 1))


def test_one_row_of_matches_serves_for_all_objects_and_is_said() -> None:
    def scene(task, env) -> None:
        blocks = [env.add_object(BLOCK, at(0.4, y, 0.02)) for y in (-0.3, -0.1, 0.1, 0.3)]
        task.add_goal(objs=blocks, matches=np.ones((1, 1)), targ_poses=[at(0.6, 0.0, 0.02)], replace=True)

    instance = drawn(scene)
    assert instance.goals[0].matches == ((1,),) * 4
    assert "matches of shape (1, 1) was taken for 4 objects" in instance.warnings[0]


@pytest.mark.parametrize(
    ("size", "height"), [((0.04, 0.05, 0.06), 0.06), ((0.04,) * 6, 0.04), ((0.04, 0.05), 0.1), (0.05, 0.05)]
)
def test_a_random_pose_is_for_a_size_of_any_length(size, height: float) -> None:
    found: list[float] = []

    def scene(task, env) -> None:
        found.append(task.get_random_pose(env, size, on="table")[0][2])
        goal(task, env)

    assert "task.get_random_pose has no argument on" in drawn(scene).warnings[0]
    assert found[0] == pytest.approx(height / 2)


def test_random_numbers_before_the_first_reset_are_those_of_the_seed() -> None:
    assert Task().rng.uniform() == Task().rng.uniform()


def test_a_reward_of_the_programs_own_is_named_and_what_it_parked_is_brought_back() -> None:
    class Parking(Scripted):
        def reward(self):
            return 1.0, {}

    def scene(task, env) -> None:
        goal(task, env)
        env.set_object_pose(1, at(0.5, -10.0, 0.02))
        task.spawn_box()

    instance = instantiate(Parking(scene), 0)
    assert [warning for warning in instance.warnings if "the program's own reward() is no part of the task" in warning]
    assert abs(instance.objects[0].pose[0][1]) <= 0.5
    assert rollout(instance).episode.strict == pytest.approx(1.0)


def test_a_random_colour_fills_a_template_and_a_template_may_name_its_placeholders() -> None:
    def scene(task, env) -> None:
        goal(task, env)
        name = task.fill_template("box/box-template_DIM_COLOR.urdf", {"DIM": (0.05,) * 3, "COLOR": [[0.5, 0.25, 1.0]]})
        env.add_object(name, at(0.4, 0.3, 0.05))

    assert drawn(scene).objects[1].fill["COLOR"][:3] == pytest.approx((0.5, 0.25, 1.0))


def test_a_random_pose_keeps_to_the_bound_that_it_is_given() -> None:
    found: list[float] = []

    def scene(task, env) -> None:
        bound = np.array([[0.3, 0.4], [0.2, 0.4], [0.0, 0.3]])
        found.extend(task.get_random_pose(env, (0.02, 0.02, 0.02), bound=bound)[0])
        goal(task, env)

    drawn(scene)
    assert 0.3 <= found[0] <= 0.4
    assert 0.2 <= found[1] <= 0.4


def test_a_bound_of_any_size_is_searched_within_the_table() -> None:
    found: list[float] = []

    def scene(task, env) -> None:
        bound = np.array([[-1e4, 1e4], [-1e4, 1e4], [0.0, 0.3]])
        found.extend(task.get_random_pose(env, (0.1, 0.1, 0.1), bound=bound)[0])
        goal(task, env)

    drawn(scene)
    assert np.hypot(found[0], found[1]) < 1


@pytest.mark.parametrize("bound", [[[0.3, np.nan], [0.2, 0.4], [0.0, 0.3]], [[0.3, 0.4]], "anywhere"])
def test_a_bound_that_is_no_finite_array_is_refused(bound: object) -> None:
    with pytest.raises(InvalidValueError, match=r"is no finite array \(3, 2\)"):
        drawn(lambda task, env: task.get_random_pose(env, (0.1, 0.1, 0.1), bound=bound))


def test_where_nothing_else_is_free_published_programs_and_ropes_get_places_on_marks() -> None:
    def cover_table(task, env) -> None:
        wide = task.fill_template("zone/zone-template.urdf", {"DIM": (0.5, 1.0, 0.002)})
        env.add_object(wide, at(0.5, 0.0, 0.001), "fixed")

    class Covered(PublishedTask):
        def reset(self, env) -> None:
            super().reset(env)
            cover_table(self, env)
            self.pose = self.get_random_pose(env, (0.04, 0.04, 0.04))
            self.beads, *_ = self.make_ropes(env, ((0.4, 0.0, 0.0), (0.4, 0.1, 0.0)), n_parts=8)
            self.add_goal(upright([env.add_object("block/red_block.urdf", self.pose)]))

    task = Covered()
    env = Environment(task=task)
    env.reset(settle=False)
    assert task.pose[0] is not None
    assert len(task.beads) == 8
    assert any("covers marks on the table" in warning for warning in env.warnings)

    def own(task, env) -> None:
        cover_table(task, env)
        assert task.get_random_pose(env, (0.04, 0.04, 0.04)) == (None, None)

    Environment(task=Scripted(own)).reset()


class Crowded(PublishedTask):
    """So many boxes, each drawn a place for, within a bound of 30 x 20 cm or anywhere."""

    def __init__(self, count: int, side: float, bound: list[list[float]] | None = None) -> None:
        super().__init__()
        self.count, self.side, self.bound = count, side, bound

    def reset(self, env) -> None:
        super().reset(env)
        box = self.fill_template(BOX, {"DIM": (self.side,) * 3, "COLOR": "red"})
        within = {} if self.bound is None else {"bound": np.array(self.bound)}
        numbers = [
            env.add_object(box, self.get_random_pose(env, (self.side,) * 3, **within)) for _ in range(self.count)
        ]
        self.add_goal(upright(numbers[:1]))


def test_published_programs_find_places_beyond_a_bound_that_is_full() -> None:
    low = (0.3, -0.5)
    env = Environment(task=Crowded(30, 0.04, [[low[0], 0.6], [low[1], -0.3], [0, 0.3]]))
    env.reset(settle=False)
    beyond = [item.pose[0] for item in env.objects if item.pose[0][0] > 0.6 or item.pose[0][1] > -0.3]
    assert 0 < len(beyond) < 20
    assert any("outside" in warning for warning in env.warnings)


def test_where_the_table_is_full_published_programs_get_a_place_all_the_same() -> None:
    env = Environment(task=Crowded(16, 0.2))
    env.reset(settle=False)
    assert len(env.objects) == 16
    assert any("stands in other objects" in warning for warning in env.warnings)
