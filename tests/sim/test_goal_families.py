"""What published families of tasks ask of the goals: towers, insertion, kitting, walls, several goals at one place."""

import numpy as np
from sim_scenes import Scripted, at, pose_goal, run

from grs_agents.sim import instantiate, rollout, utils

BLOCK = "block/block.urdf"


def turned(x: float, y: float, z: float, yaw: float):
    return ((x, y, z), utils.eulerXYZ_to_quatXYZW((0.0, 0.0, yaw)))


def test_towers_of_hanoi_are_solved_in_the_order_of_the_goals() -> None:
    """Three disks from one rod to another, seven single-object goals, discs with a rod through them."""

    def scene(task, env) -> None:
        env.add_object("hanoi/stand.urdf", at(0.5, 0.0, 0.0), "fixed")
        disks = [env.add_object(f"hanoi/disk{i}.urdf", at(0.5, -0.12, 0.015 + 0.012 * (2 - i))) for i in range(3)]
        moves = ((0, 2), (1, 1), (0, 1), (2, 2), (0, 0), (1, 2), (0, 2))
        for disk, rod in moves:
            pose_goal(task, disks[disk], at(0.5, (-0.12, 0.0, 0.12)[rod], 0.03), reward=1 / 7)

    episode, env = run(scene, max_steps=14)
    assert episode.outcome == "success", episode.detail
    assert episode.strict == 1.0, episode.shortfalls
    heights = [env.get_object_pose(number)[0][2] for number in (2, 3, 4)]
    assert heights == sorted(heights, reverse=True)


def ells(task, env) -> None:
    fixture = turned(0.55, 0.2, 0.02, 0.7)
    env.add_object("insertion/fixture.urdf", fixture, "fixed")
    ell = env.add_object("insertion/ell.urdf", turned(0.45, -0.2, 0.02, 2.0))
    pose_goal(task, ell, fixture, symmetry=2 * np.pi)


def test_an_ell_is_lowered_into_its_fixture() -> None:
    done = rollout(instantiate(Scripted(ells), 0))
    assert (done.reward, done.strict_score) == (1.0, 1.0), done.episode.shortfalls
    assert done.final[2][0][2] < 0.025


def test_a_shape_lies_in_its_place_of_the_kit_with_the_yaw_asked_for() -> None:
    def scene(task, env) -> None:
        env.add_object("kitting/kit.urdf", at(0.5, 0.2, 0.0), "fixed")
        shape = task.fill_template(
            "kitting/object-template.urdf", {"FNAME": ("03.obj",), "SCALE": [0.003, 0.003, 0.001]}
        )
        pose_goal(task, env.add_object(shape, at(0.45, -0.2, 0.02)), turned(0.53, 0.17, 0.01, 0.4), symmetry=np.pi / 2)

    done = rollout(instantiate(Scripted(scene), 0))
    assert (done.reward, done.strict_score) == (1.0, 1.0), done.episode


def test_several_goals_at_one_place_make_a_stack() -> None:
    def scene(task, env) -> None:
        for index in range(3):
            block = env.add_object(BLOCK, at(0.4 + 0.08 * index, -0.2, 0.02))
            pose_goal(task, block, at(0.5, 0.2, 0.02), reward=1 / 3)

    episode, env = run(scene, max_steps=3)
    assert (episode.reward, episode.strict) == (1.0, 1.0), episode.shortfalls
    assert env.get_object_pose(3)[0][2] > 0.09


def test_blocks_at_targets_one_width_apart_are_given_room() -> None:
    def scene(task, env) -> None:
        blocks = [env.add_object(BLOCK, turned(0.4, -0.35 + 0.1 * i, 0.02, 0.7)) for i in range(2)]
        places = [turned(0.5 + 0.04 * i * np.cos(0.7), 0.2 + 0.04 * i * np.sin(0.7), 0.02, 0.7) for i in range(2)]
        task.add_goal(blocks, np.ones((2, 2)), places, False, True, "pose", None, 1.0, [np.pi / 2] * 2)

    episode, _ = run(scene, max_steps=2)
    first, second = (action.place for action in episode.actions)
    assert np.hypot(first[0] - second[0], first[1] - second[1]) > 0.0415


def test_a_target_in_mid_air_is_met_as_published_and_the_clause_says_the_height() -> None:
    def scene(task, env) -> None:
        pose_goal(task, env.add_object(BLOCK, at(0.45, -0.2, 0.02)), at(0.5, 0.2, 0.1))

    episode, _ = run(scene)
    assert (episode.reward, episode.strict) == (1.0, 0.0)
    assert "from 0.000 m up, the target is at 0.100 m" in episode.shortfalls[0]


def test_a_wide_tolerance_does_not_widen_the_height() -> None:
    def scene(task, env) -> None:
        task.pos_eps = 0.05
        pose_goal(task, env.add_object(BLOCK, at(0.45, -0.2, 0.02)), at(0.5, 0.2, 0.06))

    episode, _ = run(scene)
    assert (episode.reward, episode.strict) == (1.0, 0.0)
