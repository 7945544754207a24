import numpy as np
import pytest
from sim_scenes import Scripted, at, pose_goal

from grs_agents.sim import Environment, utils


def blocks(*places: tuple[float, float], robot: str = "ur5e") -> Environment:
    def scene(task, env) -> None:
        for x, y in places:
            env.add_object("block/block.urdf", at(x, y, 0.02))

    env = Environment(task=Scripted(scene), robot=robot)
    env.reset()
    return env


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
def test_what_is_carried_is_tilted_as_the_place_is_against_the_pick(robot) -> None:
    env, seen = blocks((0.5, -0.2), robot=robot), []
    rotation = utils.eulerXYZ_to_quatXYZW((0.3, -0.2, 0.6))
    physics = env.physics

    def look() -> None:
        if physics.held_object_id == 1 and physics.tip_position[1] > 0.15:
            seen.append(physics.object_pose(1))

    physics.observer = look
    result = env.pick_place(at(0.5, -0.2, 0.04), ((0.45, 0.2, 0.15), rotation))
    assert result.note == "placed"
    assert abs(np.dot(seen[-1][1], rotation)) > 0.999


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
def test_turns_one_after_the_other_never_wind_the_wrist_beyond_its_limits(robot) -> None:
    env = blocks((0.5, 0.1), robot=robot)
    quarter = utils.eulerXYZ_to_quatXYZW((0, 0, 2.6))
    for _ in range(6):
        x, y, _ = env.get_object_pose(1)[0]
        assert env.pick_place(at(x, y, 0.04), ((0.5, -y, 0.04), quarter)).note == "placed"
        assert env.arm.is_path_within_limits(env.physics.joint_positions[None])
    assert abs(np.sin(utils.yaw_of(env.get_object_pose(1)[1]) - 6 * 2.6)) < 0.03


def test_a_tilt_that_the_arm_cannot_make_is_a_note_and_the_block_is_put_back() -> None:
    env = blocks((0.5, 0.0))
    result = env.pick_place(at(0.5, 0, 0.04), ((0.8, 0.0, 0.02), utils.eulerXYZ_to_quatXYZW((0, 1.5, 0))))
    assert not result.placed
    assert "so tilted" in result.note
    assert env.get_object_pose(1)[0] == pytest.approx((0.5, 0, 0.02), abs=0.01)


def test_places_out_of_reach_are_notes() -> None:
    env = blocks((0.5, 0.0))
    assert "cannot reach (1.20, 0.00, 0.04)" in env.pick_place(at(1.2, 0, 0.04), at(0.5, 0.2, 0.04)).note
    assert env.pick_place(at(1.2, 0, 0.04), at(0.5, 0.2, 0.04)).trouble == "unreachable"
    note = "cannot carry block/block.urdf #1 over its neighbours to (1.20, 0.20, 0.04): it does not reach (1.20, 0.20,"
    assert note in env.pick_place(at(0.5, 0, 0.04), at(1.2, 0.2, 0.04)).note
    assert "nothing to grasp" in env.pick_place(at(0.4, 0.3, 0.02), at(0.5, 0.2, 0.04)).note


def test_the_oracle_picks_up_again_what_was_dropped_on_the_way() -> None:
    task = Scripted(
        lambda task, env: pose_goal(task, env.add_object("block/block.urdf", at(0.5, -0.2, 0.02)), at(0.5, 0.2, 0.02))
    )
    env = Environment(task=task)
    env.reset()
    physics, dropped = env.physics, []

    def drop_once() -> None:
        if not dropped and physics.held_object_id == 1 and physics.tip_position[1] > 0.0:
            dropped.append(physics.tip_position)
            physics.cup.release()

    physics.observer = drop_once
    agent = task.oracle(env)
    while (action := agent.act()) is not None:
        if env.step(action)[2]:
            break
    notes = [record.note for record in env.current_episode.actions]
    assert dropped
    assert notes[0] == "block/block.urdf #1 was dropped on the way"
    assert notes[-1] == "placed"
    assert env.current_episode.outcome == "success"


def test_what_blocks_the_arm_is_named_rather_than_nothing_being_there() -> None:
    def scene(task, env) -> None:
        box = task.fill_template("box/box-template.urdf", {"DIM": (0.06, 0.06, 0.3)})
        env.add_object("HOPE/Tuna.urdf", at(0.55, 0.0, 0.0165))
        env.add_object(box, at(0.48, 0.0, 0.15))

    env = Environment(task=Scripted(scene))
    env.reset()
    result = env.pick_place(at(0.55, 0.0, 0.033), at(0.5, 0.35, 0.033))
    assert result.grasped is None
    assert result.trouble == "hindered"
    assert result.note == (
        "box/box-template.urdf #2 is in the arm's way on its way down, to HOPE/Tuna.urdf #1 at (0.55, 0.00, 0.03)"
    )


def test_what_the_cup_meets_in_the_place_of_its_aim_is_named() -> None:
    def scene(task, env) -> None:
        env.add_object("block/red_block.urdf", at(0.55, 0.0, 0.02))
        env.add_object("HOPE/Milk.urdf", at(0.61, 0.0, 0.095))

    env = Environment(task=Scripted(scene))
    env.reset()
    result = env.pick_place(at(0.55, 0.0, 0.04), at(0.5, 0.35, 0.04))
    assert result.note == "HOPE/Milk.urdf #2 is in the cup's way, to block/red_block.urdf #1 at (0.55, 0.00, 0.04)"


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
def test_joints_keep_their_speeds_and_the_arm_lifts_straight_up(robot) -> None:
    env = blocks((0.45, -0.3), robot=robot)
    physics, shares, aside = env.physics, list[float](), list[float]()

    def look() -> None:
        shares.append(float(np.max(np.abs(physics.data.qvel[: physics.dof]) / env.arm.joint_speed_limits)))
        x, y, z = physics.tip_position
        if physics.held_object_id == 1 and z < 0.065 and y < 0:
            aside.append(float(np.hypot(x - 0.45, y + 0.3)))

    physics.observer = look
    turn = utils.eulerXYZ_to_quatXYZW((0, 0, 2.6))
    assert env.pick_place(at(0.45, -0.3, 0.04), ((0.45, 0.3, 0.04), turn)).note == "placed"
    assert max(shares) < 1.0
    assert len(aside) > 3 and max(aside) < 0.004


def test_what_stands_between_others_is_drawn_out_slowly_and_they_stay() -> None:
    def scene(task, env) -> None:
        box = task.fill_template("box/box-template.urdf", {"DIM": (0.05, 0.05, 0.1)})
        for y in (-0.051, 0.0, 0.051):
            env.add_object(box, at(0.5, y, 0.05))

    env = Environment(task=Scripted(scene))
    env.reset()
    physics, speeds = env.physics, list[float]()

    def look() -> None:
        if physics.held_object_id == 2 and physics.object_pose(2)[0][2] < 0.14 and physics.tip_position[0] > 0.495:
            speeds.append(float(physics.data.qvel[physics.model.body_dofadr[physics.world.bodies[2]] + 2]))

    before = {number: env.get_object_pose(number)[0] for number in (1, 3)}
    physics.observer = look
    assert env.pick_place(at(0.5, 0.0, 0.1), at(0.4, 0.3, 0.1)).note == "placed"
    assert 0.05 < max(speeds) < 0.25
    for number, start in before.items():
        assert env.get_object_pose(number)[0] == pytest.approx(start, abs=0.002)


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
def test_every_link_touches_objects(robot) -> None:
    env = blocks((0.6, 0.3), robot=robot)
    physics = env.physics
    for name in env.arm.link_names[:-1]:
        body = physics.model.body(name).id
        geom = int(np.flatnonzero(physics.model.geom_bodyid == body)[0])
        physics.teleport_object(1, (tuple(physics.data.geom_xpos[geom]), (0.0, 0.0, 0.0, 1.0)))
        assert physics.unheld_objects_touching_robot() == {1}, name
