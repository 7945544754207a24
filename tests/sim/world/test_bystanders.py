"""What the photo shows and a task does not use stands there too: placed on the host, and seen so in the sandbox."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
from pydantic import ValidationError
from sim_scenes import Scene, Scripted, at, pose_goal

from grs_agents import sim
from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.sim import Environment, InstanceObject, Task, TaskInstance, instantiate, p, place_bystanders, rollout

MILK, TUNA, CORN = "HOPE/Milk.urdf", "HOPE/Tuna.urdf", "HOPE/Corn.urdf"
BOX, BOWL = "container/container-template.urdf", "bowl/bowl.urdf"


def stands(number: int, asset: str, pose: Pose, held: bool = False) -> InstanceObject:
    category = "fixed" if held else "rigid"
    return InstanceObject(id=50_000 + number, asset=asset, pose=pose, role="bystander", category=category)


PHOTO = (
    stands(0, MILK, at(0.5, 0.3, 0.093)),
    stands(1, TUNA, at(0.5, 0.0, 0.017)),
    stands(2, TUNA, at(0.4, -0.3, 0.017)),
    stands(3, CORN, at(0.6, -0.2, 0.2), held=True),
)


def puts(number: int, asset: str, pose: Pose) -> InstanceObject:
    return InstanceObject(id=number, asset=asset, pose=pose)


def instance_of(*objects: InstanceObject) -> TaskInstance:
    return TaskInstance(task="T", seed=0, max_steps=2, timestep=0.004, objects=objects, goals=())


def poses(instance: TaskInstance) -> dict[int, Pose]:
    return {item.id: item.pose for item in instance.objects}


def turned(pose: Pose, degrees: float) -> Pose:
    return (pose[0], transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, math.radians(degrees))))


def test_what_a_task_does_not_use_is_added_to_its_instance() -> None:
    full = place_bystanders(instance_of(puts(1, TUNA, at(0.5, 0.0, 0.017))), PHOTO)
    assert [(item.id, item.role) for item in full.objects] == [
        (1, "task"),
        *((50_000 + number, "bystander") for number in (0, 2, 3)),
    ]
    assert full.task_objects == full.objects[:1]
    assert full.objects[3].category == "fixed"


def test_objects_claim_the_nearest_of_their_asset_in_the_order_of_their_ids() -> None:
    near, far = puts(2, TUNA, at(0.5, 0.05, 0.017)), puts(1, TUNA, at(0.5, 0.02, 0.017))
    full = place_bystanders(instance_of(near, far, puts(3, TUNA, at(0.7, 0.0, 0.017))), PHOTO)
    assert [item.id for item in full.objects] == [2, 1, 3, 50_000, 50_003]
    assert poses(full)[1] == PHOTO[1].pose
    assert poses(full)[2] == near.pose  # the nearest was taken, the other is not near


@pytest.mark.parametrize(
    ("offset", "degrees", "kept"), [(0.029, 0, True), (0.031, 0, False), (0.0, 14, True), (0.0, 16, False)]
)
def test_an_object_put_almost_where_it_rests_is_put_there(offset: float, degrees: float, kept: bool) -> None:
    given = turned(at(0.5 + offset, 0.3, 0.093), degrees)
    full = place_bystanders(instance_of(puts(1, MILK, given)), PHOTO)
    assert poses(full)[1] == (PHOTO[0].pose if kept else given)


def test_a_loose_object_is_not_put_into_the_air_where_its_bystander_is_held() -> None:
    given = at(0.6, -0.2, 0.19)
    assert poses(place_bystanders(instance_of(puts(1, CORN, given)), PHOTO))[1] == given


def test_bystanders_that_came_with_an_instance_are_dropped() -> None:
    forged = (stands(7, MILK, at(0.2, 0.2, 0.093)), PHOTO[2])
    full = place_bystanders(instance_of(puts(1, TUNA, at(0.5, 0.0, 0.017)), *forged), PHOTO)
    assert {number: pose for number, pose in poses(full).items() if number != 1} == {
        one.id: one.pose for one in PHOTO if one is not PHOTO[1]
    }
    assert place_bystanders(full, ()).objects == full.task_objects
    assert place_bystanders(full, PHOTO) == full


def test_a_task_cannot_take_the_id_of_a_bystander() -> None:
    full = place_bystanders(instance_of(puts(50_000, BOWL, at(0.6, 0.0, 0.03))), PHOTO)
    assert len(poses(full)) == 5
    assert poses(full)[50_000] == at(0.6, 0.0, 0.03)


def test_an_instance_with_too_many_objects_is_refused() -> None:
    crowd = [puts(number, BOWL, at(0.5, 0.0, 0.03)) for number in range(1, 199)]
    with pytest.raises(ValidationError, match="200"):
        place_bystanders(instance_of(*crowd), PHOTO)


@pytest.fixture
def among_photo_objects() -> Iterator[None]:
    """Programs set their scenes up among the objects of the photo."""
    sim.set_environment_defaults(bystanders=PHOTO)
    yield
    sim.set_environment_defaults()


def free_pose(task: Task, env: Environment, size: Vec3) -> Pose:
    position, rotation = task.get_random_pose(env, size)
    assert position is not None
    assert rotation is not None
    return transforms.to_vec3(position), rotation


def reset(scene: Scene, seed: int = 0) -> Environment:
    env = Environment(task=Scripted(scene), seed=seed)
    env.reset()
    return env


@pytest.mark.usefixtures("among_photo_objects")
def test_a_program_is_told_of_its_own_objects_alone() -> None:
    env = reset(lambda task, env: env.add_object(TUNA, at(0.5, 0.0, 0.017)))
    assert env.obj_ids == {"fixed": [], "rigid": [1], "deformable": []}
    assert set(env.info) == {1, "lang_goal"}
    assert env.find(TUNA) == [1]
    assert env.find(MILK) == []
    assert p.getNumBodies() == 1
    assert sorted(item.id for item in env.objects) == [1, 50_000, 50_002, 50_003]


@pytest.mark.usefixtures("among_photo_objects")
def test_bystanders_are_solid_and_seen() -> None:
    env = reset(lambda task, env: None)
    height, owner = env.physics.surface_height_below(0.5, 0.3)
    assert (height > 0.15, owner) == (True, 50_000)
    assert 50_000 in env.render_camera(env.agent_cams[0])[2]


@pytest.mark.usefixtures("among_photo_objects")
def test_random_poses_avoid_bystanders() -> None:
    found: list[Pose] = []

    def scene(task: Task, env: Environment) -> None:
        found.extend(free_pose(task, env, (0.12, 0.12, 0.05)) for _ in range(60))

    for seed in range(3):
        reset(scene, seed)
    places = np.array([pose[0][:2] for pose in found])
    for one in PHOTO:
        assert np.linalg.norm(places - one.pose[0][:2], axis=1).min() > 0.07


@pytest.mark.usefixtures("among_photo_objects")
def test_a_program_that_moves_what_it_added_leaves_the_bystander_where_it_was() -> None:
    def scene(task: Task, env: Environment) -> None:
        can = env.add_object(TUNA, at(0.5, 0.0, 0.017))
        env.step_simulation(50)
        env.set_object_pose(can, at(0.4, -0.3, 0.017))  # where the other can stands

    env = reset(scene)
    standing = {item.id for item in env.objects}
    assert standing == {1, 50_000, 50_001, 50_003}
    for number, place in ((1, (0.4, -0.3)), (50_001, (0.5, 0.0))):
        assert math.dist(env.get_object_pose(number)[0][:2], place) < 0.001


@pytest.mark.usefixtures("among_photo_objects")
def test_the_sandbox_shows_the_scene_that_the_host_builds() -> None:
    def scene(task: Task, env: Environment) -> None:
        env.add_object(TUNA, at(0.49, 0.01, 0.017))
        zone = task.fill_template("zone/zone-template.urdf", {"DIM": (0.1, 0.1, 0.001)})
        place = free_pose(task, env, (0.1, 0.1, 0.001))
        env.add_object(zone, place, "fixed")
        pose_goal(task, 1, place)

    drawn = instantiate(Scripted(scene), 0)
    assert place_bystanders(drawn, PHOTO) == drawn
    assert drawn.objects[0].pose == PHOTO[1].pose


@pytest.mark.usefixtures("among_photo_objects")
def test_every_reset_of_a_program_starts_among_all_bystanders() -> None:
    env = reset(lambda task, env: env.add_object(TUNA, at(0.5, 0.0, 0.017)))
    before = env.objects
    env.physics.teleport_object(50_000, at(0.3, 0.3, 0.093))
    env.reset()
    assert [item.id for item in env.objects] == [item.id for item in before]
    assert math.dist(env.get_object_pose(50_000)[0], PHOTO[0].pose[0]) < 0.002


def test_environments_after_each_other_do_not_share_their_worlds() -> None:
    def scene(task: Task, env: Environment) -> None:
        env.add_object(BOX, at(0.5, 0.0, 0.03), "fixed")
        env.add_object(TUNA, at(0.5, 0.3, 0.017))

    first, second = reset(scene), reset(scene)
    first.set_object_pose(1, at(0.4, -0.2, 0.03))
    first.physics.teleport_object(2, at(0.6, 0.3, 0.017))
    first.physics.model.opt.gravity[:] = 0
    assert second.get_object_pose(1)[0] == pytest.approx((0.5, 0.0, 0.03))
    assert second.get_object_pose(2)[0][0] == pytest.approx(0.5, abs=0.001)
    third = reset(scene)
    assert (third.physics.model.opt.gravity[2], second.physics.model.opt.gravity[2]) == (-9.81, -9.81)


def test_a_cup_whose_bowl_the_program_puts_elsewhere_does_not_hang_in_the_air() -> None:
    cup = stands(1, TUNA, at(0.5, 0.0, 0.06))
    bowl = stands(0, BOWL, at(0.5, 0.0, 0.03))
    full = place_bystanders(instance_of(puts(1, BOWL, at(0.6, 0.3, 0.03))), (bowl, cup))
    start = rollout(full).initial[cup.id][0]
    assert start[2] < 0.03
    assert math.dist(start, cup.pose[0]) > 0.01
