import numpy as np
import pytest
from sim_scenes import Scripted, at

from grs_agents.library.library import Library
from grs_agents.sim import Environment, Zone, utils
from grs_agents.sim.goals import task_accounting
from grs_agents.sim.world.collision_volumes import sample_collision_volume, volume_share_in_zones

LIBRARY = Library()
COLORS = ("red", "blue")


def turned(yaw: float, x: float = 0.5):
    return ((x, 0.0, 0.0), utils.eulerXYZ_to_quatXYZW((0, 0, yaw)))


@pytest.mark.parametrize(
    ("yaw", "symmetry", "same"),
    [(0.2, 0, True), (2.0, 0, True), (0.3, 2 * np.pi, False), (np.pi, np.pi, True), (np.pi, 2 * np.pi, False)],
)
def test_yaw_counts_up_to_symmetry(yaw, symmetry, same) -> None:
    assert task_accounting.is_pose_at_target(turned(yaw), turned(0), symmetry) is same


def test_position_counts_to_a_centimetre_and_height_does_not() -> None:
    assert task_accounting.is_pose_at_target(turned(0, 0.509), ((0.5, 0.0, 0.7), utils.IDENTITY), 0)
    assert not task_accounting.is_pose_at_target(turned(0, 0.511), turned(0), 0)


def test_a_box_half_over_the_edge_of_a_zone_counts_about_half() -> None:
    volume = sample_collision_volume(LIBRARY.load_object_model("block/red_block.urdf"), LIBRARY)
    zone = Zone(pose=((0.5, 0.0, 0.0), utils.IDENTITY), size=(0.2, 0.2, 0.0))
    share = volume_share_in_zones(volume, ((0.601, 0.0, 0.02), utils.IDENTITY), [zone], 0.28)
    assert 0.3 < share < 0.6


def test_two_zones_count_together() -> None:
    volume = sample_collision_volume(LIBRARY.load_object_model("block/red_block.urdf"), LIBRARY)
    zones = [Zone(pose=((x, 0.0, 0.0), utils.IDENTITY), size=(0.1, 0.2, 0.0)) for x in (0.45, 0.55)]
    assert volume_share_in_zones(volume, ((0.5, 0.0, 0.02), utils.IDENTITY), zones, 0.28) == pytest.approx(1.0)


def test_an_object_at_a_target_that_is_not_for_it_does_not_count() -> None:
    places = [at(0.6, 0.1, 0.02), at(0.6, 0.3, 0.02)]

    def scene(task, env) -> None:
        blocks = [
            env.add_object(f"block/{color}_block.urdf", place) for color, place in zip(COLORS, places, strict=True)
        ]
        task.add_goal(blocks, np.eye(2)[::-1], places, False, False, "pose", None, 1.0, [0, 0])

    env = Environment(task=Scripted(scene))
    env.reset()
    env.step(None)
    assert env.current_episode.reward == 0.0
