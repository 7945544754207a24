import numpy as np
import pytest
from sim_scenes import Scene, Scripted, at, pose_goal

from grs_agents.base import Quat, Vec3
from grs_agents.sim import Environment, Task, TaskInstance, instantiate, p, rollout, utils


def played(scene: Scene) -> Environment:
    env = Environment(task=Scripted(scene))
    env.reset()
    return env


def task_of(env: Environment) -> Task:
    """The task that was set."""
    assert isinstance(env.task, Task)
    return env.task


def test_the_true_image_shows_each_object_where_it_stands_at_its_height() -> None:
    env = played(lambda task, env: env.add_object("HOPE/Milk.urdf", at(0.5, 0.1, 0.095)))
    color, height, owner = task_of(env).get_true_image(env)
    row, column = utils.xyz_to_pix((0.5, 0.1, 0), env.bounds, env.pix_size)
    assert color.shape == (320, 160, 3)
    assert owner[row, column] == 1
    assert height[row, column] == pytest.approx(env.get_object_size(1)[2], abs=0.002)
    rows, columns = np.nonzero(owner == 1)
    low = utils.pix_to_xyz((rows.min(), columns.min()), height.astype(np.float64), env.bounds, env.pix_size)
    assert low[:2] == pytest.approx(p.getAABB(1)[0][:2], abs=0.005)
    assert owner[10, 10] == 0
    assert height[10, 10] == pytest.approx(0, abs=1e-4)


def test_a_corner_anchor_marks_the_table_and_travels_in_the_instance() -> None:
    def scene(task, env) -> None:
        task.add_corner_anchor_for_pose(env, ((0.5, 0.2, 0.001), utils.IDENTITY))
        pose_goal(task, env.add_object("block/red_block.urdf", at(0.5, -0.1, 0.02)), at(0.5, 0.2, 0.02))

    instance = instantiate(Scripted(scene), 0)
    done = rollout(TaskInstance.model_validate_json(instance.model_dump_json()))
    assert done.strict_score == 1.0
    assert done.moved == ("block/red_block.urdf",)


def test_a_pile_is_fifty_cubes_that_lie_apart_on_the_table() -> None:
    env = played(lambda task, env: task.make_piles(env, block_color="red"))
    assert len(env.objects) == 50
    assert all(abs(item.pose[0][2] - 0.005) < 0.001 for item in env.objects)
    assert p.getVisualShapeData(1)[0][7] == (*utils.COLORS["red"], 1.0)


def test_sizes_colours_points_and_names() -> None:
    def scene(task, env) -> None:
        block = env.add_object("block/red_block.urdf", at(0.5, 0, 0.02))
        task.color_random_brown(block)
        assert np.ptp(task.get_box_object_points(block), axis=1) == pytest.approx([0.04] * 3, rel=0.2)
        size = task.get_random_size(0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
        assert (size >= (0.1, 0.3, 0.5)).all()
        assert (size <= (0.2, 0.4, 0.6)).all()
        assert task.check_require_obj("HOPE/Milk.urdf")
        assert not task.check_require_obj("HOPE/Unicorn.urdf")
        assert len(task.get_kitting_shapes(5)) == 5

    color = played(scene).objects[0].color
    assert color is not None
    red, green, blue, _ = color
    assert red > green > blue


def test_points_are_spread_over_a_mesh_that_is_scaled_and_placed() -> None:
    env = played(lambda task, env: None)
    pose = at(0.5, 0.1, 0.0)
    found = task_of(env).get_target_sample_surface_points("kitting/12.obj", (0.003, 0.003, 0.001), pose, num_points=60)
    points = np.array([position for position, _ in found])
    assert points.shape == (60, 3)
    size = np.ptp(points, axis=0)
    low, high = env.library.load_filled_template("kitting/object-template.urdf", {"FNAME": "12.obj"}).bounds
    assert (points >= np.add(low, pose[0]) - 1e-6).all()
    assert (points <= np.add(high, pose[0]) + 1e-6).all()
    assert (size[:2] > 0.5 * np.subtract(high, low)[:2]).all()


def test_the_seed_draws_the_points_over_a_mesh() -> None:
    def points(seed: int) -> list[tuple[Vec3, Quat]]:
        env = Environment(task=Scripted(lambda task, env: None), seed=seed)
        env.reset()
        return task_of(env).get_target_sample_surface_points("assets/kitting/00.obj", (1, 1, 1), at(0.5, 0.1, 0.0), 10)

    assert points(3) == points(3) != points(4)


def test_target_points_spread_over_a_shape_as_seen_from_above_and_its_seed_draws_them() -> None:
    pose = ((0.5, 0.1, 0.002), utils.eulerXYZ_to_quatXYZW((0, 0, 0.7)))
    env = played(lambda task, env: None)
    drawn = task_of(env).get_target_sample_surface_points("assets/kitting/00.obj", (0.006, 0.006, 0.00001), pose, 50)
    points = np.array([point for point, _ in drawn])
    assert points.shape == (50, 3)
    assert np.abs(points - pose[0]).max(axis=0) == pytest.approx([0.08, 0.08, 0.002], abs=0.08)
    assert np.ptp(points[:, :2], axis=0).min() > 0.03
    again = played(lambda task, env: None)
    same = task_of(again).get_target_sample_surface_points("kitting/00.obj", (0.006, 0.006, 0.00001), pose, 50)
    np.testing.assert_array_equal(points, np.array([point for point, _ in same]))


def test_a_pile_takes_a_list_of_colours_in_turn() -> None:
    def scene(task, env) -> None:
        task.num_blocks = 4
        task.make_piles(env, block_color=["red", (0.0, 0.0, 1.0)])

    shown = [item.color for item in played(scene).objects]
    assert shown[0] == shown[2] != shown[1] == shown[3] == (0.0, 0.0, 1.0, 1.0)


def test_a_second_pile_lies_between_the_cubes_of_the_first() -> None:
    def scene(task, env) -> None:
        task.num_blocks = 60
        task.make_piles(env)
        task.make_piles(env)

    env = played(scene)
    points = np.array([item.pose[0][:2] for item in env.objects])
    apart = np.linalg.norm(points[:, None] - points, axis=2)[~np.eye(120, dtype=bool)]
    assert apart.min() > 0.0145


def test_ids_get_their_symmetries_unless_they_have_them() -> None:
    task = Task()
    assert task.zip_obj_ids([3, 4], [0.5, 1.0]) == [(3, (0.5, None)), (4, (1.0, None))]
    assert task.zip_obj_ids([3], None) == [(3, (0.0, None))]
    assert task.zip_obj_ids([(3, (0.5, None))], [1.0]) == [(3, (0.5, None))]


def test_several_piles_lie_apart_each_in_a_list_and_a_colour_of_its_own() -> None:
    piles = []
    env = played(lambda task, env: piles.extend(task.make_piles(env, ["red", "blue"], count=2, num_blocks=30)))
    assert [len(pile) for pile in piles] == [30, 30]
    places = [np.array([env.get_object_pose(number)[0][:2] for number in pile]) for pile in piles]
    assert np.linalg.norm(places[0][:, None] - places[1], axis=2).min() > 0.01
    assert {env.object_by_id(number).color for number in piles[0]} != {
        env.object_by_id(number).color for number in piles[1]
    }
