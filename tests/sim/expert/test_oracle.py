import numpy as np
import pytest
from sim_scenes import Scripted, at, pose_goal, run, zone_goal

from grs_agents.sim import Environment, inside, utils


def test_it_frees_an_object_that_another_lies_on() -> None:
    def scene(task, env) -> None:
        low = env.add_object("HOPE/Tuna.urdf", at(0.5, 0.0, 0.0165))
        env.add_object("HOPE/Corn.urdf", at(0.5, 0.0, 0.062))
        zone_goal(task, [low], at(0.5, 0.3, 0.001), (0.2, 0.2, 0.0))

    episode, _ = run(scene)
    assert episode.outcome == "success", episode.detail
    assert [action.asset for action in episode.actions] == ["HOPE/Corn.urdf", "HOPE/Tuna.urdf"]


def test_it_moves_what_stands_on_a_target() -> None:
    def scene(task, env) -> None:
        env.add_object("HOPE/Milk.urdf", at(0.5, 0.3, 0.095))
        pose_goal(task, env.add_object("HOPE/Corn.urdf", at(0.5, -0.1, 0.029)), at(0.5, 0.3, 0.029))

    episode, _ = run(scene)
    assert episode.outcome == "success", episode.detail
    assert episode.steps == 2


def test_it_places_within_two_millimetres_however_far_it_carries() -> None:
    def scene(task, env) -> None:
        pose_goal(task, env.add_object("HOPE/Mustard.urdf", at(0.4, 0.4, 0.08)), at(0.66, -0.2, 0.08))

    _, env = run(scene)
    np.testing.assert_allclose(env.get_object_pose(1)[0], (0.66, -0.2, 0.08), atol=0.002)


def test_it_frees_a_taken_target_rather_than_stack_on_what_is_wanted_elsewhere() -> None:
    def scene(task, env) -> None:
        places = [at(0.45, -0.18, 0.042), at(0.55, 0.2, 0.027)]
        soup = env.add_object("HOPE/AlphabetSoup.urdf", places[0])
        yogurt = env.add_object("HOPE/Yogurt.urdf", places[1])
        pose_goal(task, soup, at(0.55, 0.2, 0.042), reward=0.5)
        pose_goal(task, yogurt, at(0.45, -0.18, 0.027), reward=0.5)

    assert run(scene)[0].strict == 1.0


def test_it_turns_an_object_to_the_yaw_asked_for() -> None:
    turned = ((0.5, 0.2, 0.027), (0.0, 0.0, float(np.sin(0.6)), float(np.cos(0.6))))

    def scene(task, env) -> None:
        pose_goal(task, env.add_object("HOPE/Butter.urdf", at(0.5, -0.2, 0.027)), turned, symmetry=2 * np.pi)

    assert run(scene)[0].outcome == "success"


def test_it_stacks_from_the_bottom_up_whatever_the_order_of_objects() -> None:
    def scene(task, env) -> None:
        blocks = [env.add_object("block/red_block.urdf", at(0.4 + 0.08 * i, -0.2, 0.02)) for i in range(4)]
        targets = [at(0.5, 0.2, 0.02 + 0.04 * level) for level in range(4)]
        task.add_goal(blocks, np.eye(4)[::-1], targets, False, True, "pose", None, 1.0, [np.pi / 2] * 4)

    episode, env = run(scene)
    assert episode.outcome == "success", episode.detail
    assert env.get_object_pose(1)[0][2] == pytest.approx(0.14, abs=0.005)


@pytest.mark.parametrize("name", ["bowl/bowl.urdf", "mug/mug.urdf", "plate/plate.urdf", "HOPE/OrangeJuice.urdf"])
def test_hollow_and_pointed_things_can_be_picked(name: str) -> None:
    def scene(task, env) -> None:
        obj = env.add_object(name, at(0.45, -0.2, env.library.asset(name).size[2] / 2))
        pose_goal(task, obj, at(0.5, 0.25, 0.05))

    episode, _ = run(scene)
    assert episode.outcome == "success", episode.detail


def out_of_reach(task, env) -> None:
    zone_goal(task, [env.add_object("HOPE/Milk.urdf", at(1.02, 0.1, 0.095))], at(0.5, 0.3, 0.0), (0.2, 0.2, 0.0))


def target_out_of_reach(task, env) -> None:
    pose_goal(task, env.add_object("HOPE/Milk.urdf", at(0.5, 0.1, 0.095)), at(0.9, 0.3, 0.095))


def target_too_small(task, env) -> None:
    zone_goal(task, [env.add_object("HOPE/Cookies.urdf", at(0.5, 0.1, 0.084))], at(0.5, 0.3, 0.0), (0.1, 0.1, 0.0))


def too_few_steps(task, env) -> None:
    cans = [env.add_object("HOPE/Corn.urdf", at(0.4 + 0.12 * i, -0.2, 0.029)) for i in range(3)]
    zone_goal(task, cans, at(0.5, 0.2, 0.0), (0.4, 0.2, 0.0))


def no_goal(task, env) -> None:
    env.add_object("HOPE/Corn.urdf", at(0.4, 0, 0.029))


def met_before(task, env) -> None:
    pose_goal(task, env.add_object("HOPE/Corn.urdf", at(0.5, 0.1, 0.029)), at(0.5, 0.1, 0.029))


def occupied(task, env) -> None:
    env.add_object(
        task.fill_template("box/box-template.urdf", {"DIM": (0.18, 0.18, 0.33)}), at(0.5, 0.3, 0.165), "fixed"
    )
    env.add_object("HOPE/Tuna.urdf", at(0.5, 0.3, 0.347))
    zone_goal(task, [env.add_object("HOPE/Milk.urdf", at(0.5, -0.1, 0.095))], at(0.5, 0.3, 0.0), (0.2, 0.2, 0.0))


def fixed(task, env) -> None:
    pose_goal(task, env.add_object("HOPE/Corn.urdf", at(0.5, 0.1, 0.029), "fixed"), at(0.5, 0.3, 0.029))


@pytest.mark.parametrize(
    ("scene", "outcome", "words"),
    [
        (out_of_reach, "unreachable", ["HOPE/Milk.urdf #1", "1.02", "0.85 m"]),
        (target_out_of_reach, "unreachable", ["target of HOPE/Milk.urdf", "0.95 m", "0.85 m"]),
        (target_too_small, "target_too_small", ["0.100 x 0.100 m", "HOPE/Cookies.urdf #1"]),
        (too_few_steps, "step_limit", ["2 of 3 objects", "max_steps=2"]),
        (no_goal, "nothing_to_do", ["add_goal"]),
        (met_before, "nothing_to_do", ["already"]),
        (fixed, "error", ["HOPE/Corn.urdf", "rigid"]),
    ],
)
def test_why_it_stops_is_typed_and_said_with_names_and_numbers(scene, outcome, words) -> None:
    episode, _ = run(scene, max_steps=2)
    assert episode.outcome == outcome, episode.detail
    assert all(word in episode.detail for word in words), episode.detail


def test_it_first_moves_what_stands_so_near_to_a_target_that_it_would_be_shoved() -> None:
    def scene(task, env) -> None:
        red = env.add_object("block/red_block.urdf", at(0.4, -0.3, 0.02))
        blue = env.add_object("block/blue_block.urdf", at(0.5, 0.141, 0.02))
        pose_goal(task, red, at(0.5, 0.1, 0.02), reward=0.5, symmetry=np.pi / 2)
        pose_goal(task, blue, at(0.6, -0.2, 0.02), reward=0.5, symmetry=np.pi / 2)

    episode, _ = run(scene)
    assert (episode.outcome, episode.strict) == ("success", 1.0)
    assert [action.asset for action in episode.actions] == ["block/blue_block.urdf", "block/red_block.urdf"]


def test_of_what_has_tipped_it_says_so_and_not_that_no_spot_is_free() -> None:
    def scene(task, env) -> None:
        box = env.add_object("container/open_box.urdf", at(0.5, 0.25, 0.045), "fixed")
        task.add_goal(inside(env.add_object("HOPE/Milk.urdf", at(0.5, -0.2, 0.095)), box))

    task = Scripted(scene)
    env = Environment(task=task)
    env.reset()
    env.set_object_pose(2, ((0.5, -0.2, 0.04), utils.eulerXYZ_to_quatXYZW((np.pi / 2, 0, 0))))
    env.step_simulation(200)
    assert task.oracle(env).act() is None
    episode = env.current_episode
    assert episode.outcome == "toppled"
    assert "HOPE/Milk.urdf #2 has tipped over or lies: it is tilted by 90 degrees, at the start by 0" in episode.detail


def test_a_container_that_is_too_small_is_named_with_its_size_and_that_of_the_object() -> None:
    def scene(task, env) -> None:
        name = task.fill_template("container/container-template.urdf", {"DIM": (0.08, 0.08, 0.04)})
        box = env.add_object(name, at(0.5, 0.25, 0.045), "fixed")
        task.add_goal(inside(env.add_object("HOPE/Tuna.urdf", at(0.5, -0.2, 0.017)), box))

    episode, _ = run(scene)
    assert episode.outcome == "target_too_small"
    assert "container-template.urdf #1 (0.080 x 0.080 m outside) is too small for HOPE/Tuna.urdf #2" in episode.detail


def test_a_ball_goes_on_top_of_what_stands_at_its_target_and_stays_there() -> None:
    def scene(task, env) -> None:
        ball = env.add_object("ball/ball.urdf", at(0.4, -0.3, 0.03))
        can = env.add_object("cylinder/cylinder-template.urdf", at(0.5, 0.1, 0.025))
        pose_goal(task, ball, env.get_object_pose(can))

    episode, env = run(scene)
    assert (episode.outcome, episode.strict) == ("success", 1.0)
    assert env.get_object_pose(1)[0][2] > 0.07


def test_ells_at_one_target_are_turned_so_that_they_carry_each_other() -> None:
    def scene(task, env) -> None:
        for x, yaw in ((0.4, 0.3), (0.55, 2.2), (0.7, -1.6)):
            rotation = utils.eulerXYZ_to_quatXYZW((0, 0, yaw))
            pose_goal(
                task, env.add_object("insertion/ell.urdf", ((x, -0.2, 0.02), rotation)), at(0.5, 0.2, 0.02), 1 / 3
            )

    episode, _ = run(scene)
    assert (episode.outcome, episode.strict) == ("success", pytest.approx(1.0))


def test_the_cup_keeps_clear_of_a_thin_peg_beside_what_it_picks() -> None:
    def scene(task, env) -> None:
        env.add_object("hanoi/stand.urdf", at(0.5, 0, 0.01), "fixed")
        disk = env.add_object("hanoi/disk0.urdf", at(0.5, 0, 0.06))
        pose_goal(task, disk, at(0.5, 0.3, 0.01))

    episode, _ = run(scene)
    assert (episode.outcome, len(episode.actions), episode.strict) == ("success", 1, 1.0)


@pytest.mark.parametrize("lean", [(0.5, 0.0), (0.3, -0.3)])
def test_it_places_tilted_where_a_task_of_six_degrees_of_freedom_has_a_tilted_target(lean) -> None:
    place = ((0.5, 0.2, 0.12), utils.eulerXYZ_to_quatXYZW((*lean, 1.0)))

    def scene(task, env) -> None:
        task.sixdof, task.pos_eps = True, 0.02
        ell = env.add_object("insertion/ell.urdf", at(0.45, -0.2, 0.02))
        env.add_object("insertion/fixture.urdf", place, "fixed")
        pose_goal(task, ell, place, symmetry=2 * np.pi)

    episode, env = run(scene)
    assert (episode.outcome, episode.steps) == ("success", 1), episode.detail
    assert episode.strict == 1.0, episode.shortfalls
    position, rotation = env.get_object_pose(1)
    np.testing.assert_allclose(position, place[0], atol=0.015)
    assert abs(np.dot(rotation, place[1])) > np.cos(np.deg2rad(15) / 2)


def test_it_lets_things_down_upright_where_the_task_does_not_ask_for_tilt() -> None:
    def scene(task, env) -> None:
        block = env.add_object("block/red_block.urdf", at(0.45, -0.2, 0.02))
        pose_goal(task, block, ((0.5, 0.2, 0.02), utils.eulerXYZ_to_quatXYZW((0.5, 0.0, 0.0))))

    episode, env = run(scene)
    assert episode.strict == 1.0, episode.shortfalls
    assert utils.rotation_matrix(env.get_object_pose(1)[1])[2, 2] > 0.999


def test_it_takes_out_of_a_fixture_what_covers_its_only_flat_place() -> None:
    def scene(task, env) -> None:
        fixture = env.add_object("insertion/fixture.urdf", at(0.5, -0.2, 0.02))
        env.add_object("block/red_block.urdf", at(0.5, -0.2, 0.021))
        zone_goal(task, [fixture], at(0.5, 0.25, 0.001), (0.25, 0.25, 0.0))

    episode, _ = run(scene)
    assert episode.outcome == "success", episode.detail
    assert [action.asset for action in episode.actions] == ["block/red_block.urdf", "insertion/fixture.urdf"]


def test_a_neighbour_that_leaves_the_cup_no_room_does_not_cover_the_top() -> None:
    def scene(task, env) -> None:
        butter = env.add_object("HOPE/Butter.urdf", at(0.5, 0.0, 0.027))
        for x, y in ((-1, -1), (-1, 1), (1, -1), (1, 1)):  # tall and fixed, 1 mm beside its 24 mm, along all of it
            env.add_object("HOPE/Milk.urdf", at(0.5 + x * (0.013 + 0.0365), y * 0.036, 0.095), "fixed")
        zone_goal(task, [butter], at(0.5, 0.3, 0.001), (0.2, 0.2, 0.0))

    episode, _ = run(scene)
    assert episode.outcome == "unreachable"
    assert "leaves no room for the cup beside HOPE/Milk.urdf" in episode.detail
    assert "covered" not in episode.detail


def test_an_object_that_would_rest_on_the_rim_finds_its_bowl_too_small() -> None:
    def scene(task, env) -> None:
        bowl = env.add_object("bowl/bowl.urdf", at(0.5, 0.2, 0.03), "fixed")
        size = {"DIM": (0.105, 0.105, 0.03), "HALF": (0.0525, 0.0525, 0.015)}
        plate = env.add_object(task.fill_template("box/box-template.urdf", size), at(0.5, -0.2, 0.015))
        task.add_goal(inside([plate], bowl), language_goal="put it in")

    episode, _ = run(scene)
    assert episode.outcome == "target_too_small"
    assert "bowl/bowl.urdf #1" in episode.detail and "is too small for" in episode.detail
    assert "at the best one" not in episode.detail
