import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sim_scenes import Scripted, at, pose_goal, run, zone_goal

from grs_agents.sim import Environment, instantiate, rollout, utils
from grs_agents.sim.goals.strict_score import match_rows_to_targets

BLOCKS = ("block/red_block.urdf", "block/blue_block.urdf")
LYING = utils.eulerXYZ_to_quatXYZW((np.pi / 2, 0, 0))


def after(scene, **moves) -> Environment:
    """The environment after a scene's objects were set down elsewhere: ``_1=pose`` moves object 1."""
    env = Environment(task=Scripted(scene))
    env.reset()
    for name, pose in moves.items():
        env.set_object_pose(int(name[1:]), pose)
    env.step_simulation(100)
    env.step(None)
    return env


def stack(task, env) -> None:
    """Red on blue, which stays where it is."""
    red = env.add_object(BLOCKS[0], at(0.45, -0.2, 0.02))
    env.add_object(BLOCKS[1], at(0.5, 0.1, 0.02))
    pose_goal(task, red, at(0.5, 0.1, 0.06), symmetry=np.pi / 2)


def test_an_object_at_the_height_of_its_target_counts() -> None:
    episode = after(stack, _1=at(0.5, 0.1, 0.0605)).current_episode
    assert (episode.reward, episode.strict, episode.shortfalls) == (1.0, 1.0, ())


def test_an_object_below_its_target_counts_as_published_and_not_strictly() -> None:
    episode = after(stack, _2=at(0.6, 0.3, 0.02), _1=at(0.5, 0.1, 0.0205)).current_episode
    assert (episode.reward, episode.strict) == (1.0, 0.0)
    assert "block/red_block.urdf" in episode.shortfalls[0]


def test_a_bystander_that_is_knocked_over_lowers_the_score() -> None:
    def scene(task, env) -> None:
        stack(task, env)
        env.add_object("HOPE/Milk.urdf", at(0.4, 0.3, 0.095))

    env = after(scene, _1=at(0.5, 0.1, 0.0605), _3=((0.4, 0.3, 0.05), LYING))
    assert env.current_episode.reward == 1.0
    assert env.current_episode.strict == pytest.approx(0.5)
    assert env.current_episode.shortfalls == ("HOPE/Milk.urdf #3 was knocked over",)


def test_an_object_that_lies_at_its_target_but_stood_at_first_does_not_count() -> None:
    def scene(task, env) -> None:
        pose_goal(task, env.add_object("HOPE/Milk.urdf", at(0.5, 0.1, 0.095)), at(0.5, 0.3, 0.03))

    episode = after(scene, _1=((0.5, 0.3, 0.0300), LYING)).current_episode
    assert (episode.reward, episode.strict) == (1.0, 0.0)
    assert "upright" in episode.shortfalls[0]


def test_two_objects_cannot_claim_one_target() -> None:
    def scene(task, env) -> None:
        objs = [env.add_object(name, at(0.4, y, 0.02)) for name, y in zip(BLOCKS, (0.1, 0.3), strict=True)]
        places = [at(0.6, 0.1, 0.02), at(0.6, 0.3, 0.02)]
        task.add_goal(objs, np.ones((2, 2)), places, False, False, "pose", None, 1.0, [0, 0])

    episode = after(scene, _1=at(0.6, 0.1, 0.02), _2=at(0.6, 0.1, 0.0605)).current_episode
    assert (episode.reward, episode.strict) == (1.0, 0.5)


def test_what_was_credited_and_undone_later_keeps_the_published_reward_alone() -> None:
    def scene(task, env) -> None:
        for name, y in zip(BLOCKS, (0.1, 0.3), strict=True):
            pose_goal(task, env.add_object(name, at(0.4, y, 0.02)), at(0.6, y, 0.02), reward=0.5)

    env = after(scene, _1=at(0.6, 0.1, 0.02))
    assert env.current_episode.reward == env.current_episode.strict == 0.5
    env.set_object_pose(1, at(0.4, -0.2, 0.02))
    env.step(None)
    assert (env.current_episode.reward, env.current_episode.strict) == (0.5, 0.0)


def test_an_object_on_the_lid_of_what_stands_in_a_zone_is_not_in_the_zone() -> None:
    def scene(task, env) -> None:
        red = env.add_object(BLOCKS[0], at(0.4, 0.1, 0.02))
        env.add_object("HOPE/Cookies.urdf", at(0.55, 0.1, 0.084))
        zone_goal(task, [red], at(0.55, 0.1, 0.0), (0.2, 0.2, 0.0))

    top = Environment().library.asset("HOPE/Cookies.urdf").size[2]
    episode = after(scene, _1=at(0.55, 0.1, top + 0.021)).current_episode
    assert (episode.reward, episode.strict) == (1.0, 0.0)
    assert "above its zone" in episode.shortfalls[0]


def test_a_target_on_a_plate_is_met_on_the_plates_bottom() -> None:
    def scene(task, env) -> None:
        env.add_object("plate/plate.urdf", at(0.45, -0.2, 0.009), "fixed")
        pose_goal(task, env.add_object("HOPE/Peaches.urdf", at(0.5, 0.25, 0.029)), at(0.45, -0.2, 0.047))

    assert run(scene)[0].strict == 1.0


def test_an_object_that_two_goals_speak_of_in_turn_is_judged_at_the_last() -> None:
    def scene(task, env) -> None:
        red = env.add_object(BLOCKS[0], at(0.4, 0.1, 0.02))
        pose_goal(task, red, at(0.6, 0.1, 0.02), reward=0.5)
        pose_goal(task, red, at(0.4, 0.3, 0.02), reward=0.5)

    done = rollout(instantiate(Scripted(scene), 0))
    assert (done.reward, done.strict_score) == (1.0, 1.0)


@given(st.lists(st.lists(st.integers(0, 5), unique=True, max_size=4), max_size=6))
def test_targets_are_assigned_once_and_to_as_many_as_possible(options) -> None:
    given_out = match_rows_to_targets(options)
    assert len(set(given_out.values())) == len(given_out)
    assert all(target in options[row] for row, target in given_out.items())
    assert len(given_out) == most(options, frozenset())


def most(options: list[list[int]], taken: frozenset[int]) -> int:
    if not options:
        return 0
    first, *rest = options
    return max([most(rest, taken)] + [1 + most(rest, taken | {one}) for one in first if one not in taken])


def levels(task, env) -> None:
    """Three blocks of 4 cm, red, blue and green, one on the other, as if they were 5 cm high."""
    for level, block in enumerate((*BLOCKS, "block/green_block.urdf")):
        number = env.add_object(block, at(0.4 + 0.1 * level, -0.2, 0.02))
        pose_goal(task, number, at(0.5, 0.1, 0.03 + 0.05 * level), reward=1 / 3, symmetry=np.pi / 2)


def test_levels_a_little_higher_than_the_blocks_hold_one_on_the_other() -> None:
    built = after(levels, _1=at(0.5, 0.1, 0.0202), _2=at(0.5, 0.1, 0.0604), _3=at(0.5, 0.1, 0.1006)).current_episode
    assert (built.reward, built.strict) == (pytest.approx(1.0), pytest.approx(1.0))


def test_a_level_does_not_hold_on_what_is_not_at_its_own_target_nor_in_mid_air() -> None:
    astray = after(levels, _3=at(0.5, 0.1, 0.0202), _2=at(0.5, 0.1, 0.0604)).current_episode
    assert astray.strict == 0.0
    alone = after(levels, _3=at(0.5, 0.1, 0.0202)).current_episode
    assert alone.strict == 0.0
    assert any("where nothing would hold it" in clause for clause in alone.shortfalls)


@pytest.mark.parametrize(("mark", "height", "strict"), [(0.001, 0.036, 1.0), (0.03, 0.06, 0.0)])
def test_a_mark_on_the_table_carries_what_stands_on_it_and_one_in_the_air_does_not(mark, height, strict) -> None:
    def scene(task, env) -> None:
        env.add_object("zone/zone.urdf", at(0.5, 0.1, mark), "fixed")
        pose_goal(task, env.add_object(BLOCKS[0], at(0.45, -0.2, 0.02)), at(0.5, 0.1, height), symmetry=np.pi / 2)

    assert after(scene, _2=at(0.5, 0.1, 0.0205)).current_episode.strict == strict


def test_what_stands_in_a_fixture_is_where_a_target_in_the_fixture_says() -> None:
    def scene(task, env) -> None:
        env.add_object("insertion/fixture.urdf", at(0.5, 0.1, 0.05), "fixed")
        pose_goal(task, env.add_object("cylinder/cylinder-template.urdf", at(0.45, -0.2, 0.025)), at(0.5, 0.1, 0.05))

    episode, _ = run(scene)
    assert (episode.outcome, episode.strict) == ("success", 1.0)


def test_nothing_need_go_into_the_solid_deck_of_a_pallet() -> None:
    def scene(task, env) -> None:
        block = env.add_object(BLOCKS[0], at(0.45, -0.2, 0.02))
        env.add_object("pallet/pallet.urdf", at(0.5, 0.2, 0.01), "fixed")
        pose_goal(task, block, at(0.5, 0.2, 0.03))

    episode = after(scene, _1=at(0.5, 0.2, 0.0488)).current_episode
    assert (episode.reward, episode.strict, episode.shortfalls) == (1.0, 1.0, ())
