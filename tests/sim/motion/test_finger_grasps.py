"""Grasps for two fingers: where they close, and why they cannot."""

import numpy as np
import pytest
from sim_scenes import Scripted, at, pose_goal

from grs_agents.base.geometry import transforms
from grs_agents.sim import Environment, InstanceObject
from grs_agents.sim.end_effectors import Grasps
from grs_agents.sim.motion.finger_grasps import hand_axes

HANDS = ["franka_hand", "robotiq_2f85"]


def table(*things: tuple[str, tuple[float, float, float]], hand: str = "franka_hand", robot: str = "panda"):
    """An environment with assets at positions, ids from 1 on."""

    def scene(task, env) -> None:
        for asset, place in things:
            env.add_object(asset, at(*place))

    env = Environment(task=Scripted(scene), robot=robot, hand=hand)
    env.reset()
    return env


def heavier(env: Environment, number: int, mass: float) -> Environment:
    """The same with another mass of an object, kg."""
    item = env.object_by_id(number)
    env.replace_object(InstanceObject.model_validate({**item.model_dump(), "mass": mass}))
    env.settle_scene()
    return env


def grasps(env: Environment, number: int) -> Grasps:
    others = [env.object_prism(item.id) for item in env.objects if item.id != number]
    return env.end_effector.find_grasps(env.physics, number, env.object_prism(number), others, wanted=4)


@pytest.mark.parametrize("hand", HANDS)
@pytest.mark.parametrize(
    ("asset", "height"),
    [
        ("HOPE/Ketchup.urdf", 0.08),
        ("HOPE/Tuna.urdf", 0.03),
        ("HOPE/Cookies.urdf", 0.09),
        ("bowl/bowl.urdf", 0.04),
        ("mug/mug.urdf", 0.05),
        ("container/open_box.urdf", 0.05),
    ],
)
def test_things_of_a_household_are_picked_and_placed_standing(hand: str, asset: str, height: float) -> None:
    env = table((asset, (0.5, 0.12, height)), hand=hand)
    pick = grasps(env, 1).poses[0]
    (x, y, z), turn = pick
    before = env.get_object_pose(1)
    assert env.pick_place(pick, ((x, y - 0.3, z), turn)).note == "placed"
    after = env.get_object_pose(1)
    assert after[0] == pytest.approx((before[0][0], before[0][1] - 0.3, before[0][2]), abs=0.003)
    ups = [transforms.quaternion_to_matrix(pose[1])[:, 2] for pose in (before, after)]
    assert float(ups[0] @ ups[1]) > 0.9999
    assert transforms.yaw_of_quaternion(after[1]) == pytest.approx(transforms.yaw_of_quaternion(before[1]), abs=0.2)


def test_hollow_things_are_taken_by_the_rim() -> None:
    env = table(("bowl/bowl.urdf", (0.5, 0.0, 0.04)))
    x, y, _ = grasps(env, 1).poses[0][0]
    assert np.hypot(x - 0.5, y) > 0.05


def test_grasps_close_across_the_narrow_side() -> None:
    env = table(("HOPE/Cookies.urdf", (0.5, 0.0, 0.09)))  # 4 cm wide, 12 cm long: wider than the hand opens
    axes = hand_axes(grasps(env, 1).poses[0])
    assert abs(axes[0, 1]) > 0.95
    assert axes[2, 2] < -0.99


def test_a_search_ends_with_as_many_as_are_wanted_and_looks_anew_when_things_move() -> None:
    env = table(("block/block.urdf", (0.5, 0.0, 0.02)))
    several = grasps(env, 1).poses
    (best,) = env.end_effector.find_grasps(env.physics, 1, env.object_prism(1), ()).poses
    assert best == several[0]
    assert grasps(env, 1).poses == several
    (x, y, z), turn = best
    env.pick_place(best, ((x, y - 0.2, z), turn))
    assert grasps(env, 1).poses[0][0] == pytest.approx((x, y - 0.2, z), abs=0.002)


def test_what_is_too_wide_is_told_with_its_width() -> None:
    env = Environment(
        task=Scripted(
            lambda task, env: env.add_object(
                task.fill_template("box/box-template.urdf", {"DIM": (0.12, 0.12, 0.05)}), at(0.5, 0, 0.025)
            )
        ),
        robot="panda",
        hand="franka_hand",
    )
    env.reset()
    found = grasps(env, 1)
    assert (found.poses, found.trouble) == ((), "no_grip")
    assert found.why == "{name} is 0.120 m across, the Franka Hand opens 0.080 m"


def test_what_is_too_heavy_is_told_with_its_mass() -> None:
    env = heavier(table(("HOPE/Ketchup.urdf", (0.5, 0.0, 0.08))), 1, 4.0)
    found = grasps(env, 1)
    assert found.trouble == "no_grip"
    assert found.why == "{name} weighs 4 kg, the Franka Hand holds 3 kg"


def test_a_card_on_the_table_is_too_flat() -> None:
    env = Environment(
        task=Scripted(
            lambda task, env: env.add_object(
                task.fill_template("box/box-template.urdf", {"DIM": (0.05, 0.08, 0.004)}), at(0.5, 0, 0.002)
            )
        ),
        robot="panda",
        hand="franka_hand",
    )
    env.reset()
    assert "less than 6 mm down {name} before they meet the table" in grasps(env, 1).why


def test_neighbours_that_leave_the_fingers_no_room_are_named() -> None:
    ring = [(0.5 + 0.043 * i, 0.043 * j, 0.02) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
    env = table(("block/block.urdf", (0.5, 0.0, 0.02)), *(("block/block.urdf", place) for place in ring))
    found = grasps(env, 1)
    assert found.poses == ()
    assert found.hindered_by
    assert set(found.hindered_by) <= set(range(2, 10))
    assert "no room for the Franka Hand" in found.why


def test_a_wall_beside_turns_the_hand() -> None:
    free = table(("block/block.urdf", (0.5, 0.0, 0.02)))
    walled = table(
        ("block/block.urdf", (0.5, 0.0, 0.02)),
        ("HOPE/Cookies.urdf", (0.462, 0.0, 0.084)),
        ("HOPE/Cookies.urdf", (0.538, 0.0, 0.084)),
    )
    assert len(grasps(free, 1).poses) == 4
    for pose in grasps(walled, 1).poses:
        assert abs(hand_axes(pose)[1, 1]) > 0.85  # the pads close along the walls


def test_a_hand_that_comes_in_below_an_overhang_could_not_lift() -> None:
    def scene(task, env) -> None:
        env.add_object("block/block.urdf", at(0.5, 0.0, 0.02))
        slab = task.fill_template("box/box-template.urdf", {"DIM": (0.06, 0.06, 0.02)})
        env.add_object(slab, at(0.5, 0.0, 0.12), "fixed")

    env = Environment(task=Scripted(scene), robot="ur5e", hand="robotiq_2f85")
    env.reset()
    found = grasps(env, 1)
    assert found.poses == ()
    assert "no room for the Robotiq 2F-85" in found.why


def test_a_hand_with_no_room_at_the_place_takes_another_grasp() -> None:
    env = table(
        ("HOPE/Ketchup.urdf", (0.45, 0.25, 0.08)),
        ("HOPE/Milk.urdf", (0.40, -0.2, 0.096)),
        ("HOPE/Milk.urdf", (0.58, -0.2, 0.096)),
    )
    first = grasps(env, 1)
    motion = ((0.04, -0.45, 0.0), transforms.IDENTITY)
    serving = env.end_effector.find_grasps_for_place(
        env.physics, 1, first, lambda hold: transforms.compose_poses(motion, hold)
    )
    assert serving.poses
    pick = serving.poses[0]
    assert env.pick_place(pick, transforms.compose_poses(motion, pick)).note == "placed"
    for number in (2, 3):
        assert env.get_object_pose(number)[1] == pytest.approx(env.places[number][1], abs=1e-3)


def test_a_pose_on_top_of_a_thing_means_the_thing_below() -> None:
    env = table(("HOPE/Ketchup.urdf", (0.5, 0.1, 0.08)))
    top = env.object_prism(1).high
    turned = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, 0.5))
    assert env.pick_place(at(0.5, 0.1, top), ((0.5, -0.2, top), turned)).note == "placed"
    position, rotation = env.get_object_pose(1)
    assert position[:2] == pytest.approx((0.5, -0.2), abs=0.002)
    assert transforms.yaw_of_quaternion(rotation) == pytest.approx(0.5, abs=0.02)


def test_empty_air_is_a_note() -> None:
    env = table(("HOPE/Ketchup.urdf", (0.5, 0.1, 0.08)))
    result = env.pick_place(at(0.4, -0.3, 0.05), at(0.5, -0.2, 0.05))
    assert result.grasped is None
    assert "nothing to grasp" in result.note


@pytest.mark.parametrize("mass", [0.005, 0.05, 0.4, 1.5])
@pytest.mark.parametrize("hand", HANDS)
def test_pads_never_sink_into_what_they_hold(hand: str, mass: float) -> None:
    env = heavier(table(("block/block.urdf", (0.5, 0.1, 0.02)), hand=hand), 1, mass)
    physics, deepest = env.physics, [0.0]

    def look() -> None:
        if physics.data.ncon:
            deepest.append(-float(physics.data.contact.dist.min()))

    physics.observer = look
    (x, y, z), turn = grasps(env, 1).poses[0]
    assert env.pick_place(((x, y, z), turn), ((x, y - 0.3, z), turn)).note == "placed"
    assert max(deepest) < 0.0015


def test_a_miss_of_half_a_centimetre_is_borne() -> None:
    env, rng, placed = table(("HOPE/TomatoSauce.urdf", (0.5, 0.1, 0.05))), np.random.default_rng(0), 0
    (x, y, z), turn = grasps(env, 1).poses[0]
    saved = env.physics.save_state()
    for _ in range(10):
        env.physics.restore_state(saved)
        dx, dy = rng.uniform(-0.0035, 0.0035, 2)
        lean = transforms.eulerXYZ_to_quatXYZW(tuple(rng.uniform(-0.05, 0.05, 3)))
        pick = ((x + dx, y + dy, z + 0.004), transforms.multiply_quaternions(lean, turn))
        placed += env.pick_place(pick, ((x + dx, y + dy - 0.3, z + 0.004), pick[1])).note == "placed"
    assert placed == 10


@pytest.mark.parametrize(("asset", "height"), [("HOPE/Tuna.urdf", 0.02), ("HOPE/Spaghetti.urdf", 0.03)])
def test_a_grasp_below_the_table_is_raised_off_it(asset: str, height: float) -> None:
    env = table((asset, (0.5, 0.1, height)))
    (x, y, z), turn = grasps(env, 1).poses[0]
    low = z - 0.008
    assert low < 0.0
    assert env.pick_place(((x, y, low), turn), ((x, y - 0.3, low), turn)).note == "placed"


def test_the_finger_that_touches_first_pushes_gently() -> None:
    env = heavier(table(("HOPE/Ketchup.urdf", (0.5, 0.1, 0.08))), 1, 0.3)
    physics, fingers = env.physics, env.physics.fingers
    (x, y, z), turn = pose = grasps(env, 1).poses[0]
    aside = 0.005 * hand_axes(pose)[:, 1]
    pushing: list[float] = []

    def look() -> None:
        if fingers.closing and fingers.held is None and fingers.pads_touching(1) == 1:
            pushing.append(fingers.force)

    physics.observer = look
    pick = ((x + float(aside[0]), y + float(aside[1]), z), turn)
    assert env.pick_place_motion.pick_and_lift(pick, 0.05).placed
    assert pushing
    assert max(pushing) == fingers.hand.gripping_force(0.0)
    assert fingers.force > 3 * max(pushing)


def test_the_oracle_solves_a_task_with_fingers() -> None:
    def scene(task, env) -> None:
        block = env.add_object("block/block.urdf", at(0.5, 0.1, 0.02))
        env.add_object("HOPE/Ketchup.urdf", at(0.56, 0.1, 0.08))
        pose_goal(task, block, at(0.5, -0.2, 0.02), symmetry=np.pi / 2)

    task = Scripted(scene)
    env = Environment(task=task, robot="panda", hand="franka_hand")
    env.reset()
    agent = task.oracle(env)
    while (action := agent.act()) is not None and not env.step(action)[2]:
        pass
    assert env.current_episode.outcome == "success"
    assert env.current_episode.strict == 1.0
