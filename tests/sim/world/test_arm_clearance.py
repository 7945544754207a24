"""A background around a task instance: things bump into it, cameras see it, and the arm has room."""

from pathlib import Path

import numpy as np
import pytest

from grs_agents.library.background_asset import write_background_asset
from grs_agents.library.library import Library
from grs_agents.sim import Environment, InstanceObject, InstanceTask, TaskInstance
from grs_agents.sim.hands.hand import DEFAULT_HAND
from grs_agents.sim.rendering.cameras import LookAtCamera, VisibleScene
from grs_agents.sim.rendering.pictures import render_views
from grs_agents.sim.world.compilation import compute_arm_spheres_at_home

SHELF = np.array([[[0.4, -0.3, 0.10], [0.6, -0.1, 0.12]]])
MESH = (np.array([[0.4, -0.3, 0.12], [0.6, -0.3, 0.12], [0.6, -0.1, 0.12], [0.4, -0.1, 0.12]]),)


@pytest.fixture
def library(tmp_path: Path) -> Library:
    """The shipped one and a shelf over the table."""
    write_background_asset(tmp_path, MESH[0], np.array([[0, 1, 2], [0, 2, 3]]), SHELF, (0.1, 0.2, 0.9))
    return Library().copy_with_overlay_root(tmp_path)


def instance(background: str | None) -> TaskInstance:
    """A block that is let go above the shelf."""
    block = InstanceObject(id=1, asset="block/block.urdf", pose=((0.5, -0.2, 0.16), (0.0, 0.0, 0.0, 1.0)))
    return TaskInstance(
        task="t", seed=0, max_steps=1, timestep=0.004, objects=(block,), goals=(), background=background
    )


def settled(background: str | None, library: Library) -> Environment:
    """The environment of the instance, at rest."""
    env = Environment(task=InstanceTask(instance(background)), library=library, seed=0)
    env.reset()
    return env


def test_a_block_comes_to_rest_on_it(library: Library) -> None:
    assert settled(None, library).get_object_pose(1)[0][2] == pytest.approx(0.02, abs=0.002)
    assert settled("background/room.urdf", library).get_object_pose(1)[0][2] == pytest.approx(0.14, abs=0.002)


def test_an_environment_takes_it_away_again(library: Library) -> None:
    env = settled("background/room.urdf", library)
    env.set_task(InstanceTask(instance(None)))
    env.reset()
    assert env.get_object_pose(1)[0][2] == pytest.approx(0.02, abs=0.002)


def test_cameras_see_it(library: Library) -> None:
    view = LookAtCamera((0.5, -0.2, 1.0), (0.5, -0.19, 0.0), height=60, width=80)
    sight = VisibleScene((), library, background="background/room.urdf")
    red, _, blue = render_views(sight, [view])[0].color[30, 40].tolist()
    assert blue > 3 * red


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
def test_the_arm_at_home_reaches_from_its_base_to_over_the_table(robot: str) -> None:
    spheres = compute_arm_spheres_at_home(robot, DEFAULT_HAND, Library())
    assert np.linalg.norm(spheres[:, :2], axis=1).min() < 0.05
    assert spheres[:, 0].max() > 0.3
    assert (spheres[:, 3] > 0).all() and (spheres[:, 3] < 0.5).all()
