"""Bowls whose walls are hulls, as they are built from a photo: a thing comes down inside, or the stop tells why not."""

from pathlib import Path

import numpy as np
import pytest
from sim_scenes import Scripted, at

from grs_agents.base.geometry.spheres import icosphere
from grs_agents.library.library import Library
from grs_agents.perception.proxies.proxy import Proxy, write_proxy
from grs_agents.perception.shapes.colliders import ring_colliders
from grs_agents.perception.shapes.types import ObjectMesh
from grs_agents.sim import Environment, Episode, inside

WALLS = np.array([(0.06, 0.068, 0.01), (0.08, 0.088, 0.07)])
"""Inner and outer radius of the wall at two heights, metres."""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Library:
    folder: Path = tmp_path_factory.mktemp("bowl")
    vertices, faces = icosphere(1)
    mesh = ObjectMesh(0.08 * vertices, faces, np.zeros((len(vertices), 2)), np.full((2, 2, 3), 200, np.uint8))
    proxy = Proxy(mesh, ring_colliders(WALLS, np.zeros(2)), hollow=True, color=(0.8, 0.1, 0.1))
    write_proxy(folder, "bowl", proxy, "a bowl")
    return Library(*Library().roots, folder)


def put_into_bowl(library: Library, thing: str, height: float) -> Episode:
    def scene(task, env) -> None:
        bowl = env.add_object("proxy/bowl.urdf", at(0.5, 0.2, 0.035), "fixed")
        task.add_goal(inside(env.add_object(thing, at(0.5, -0.2, height / 2)), bowl))

    task = Scripted(scene)
    env = Environment(task=task, library=library, seed=0)
    env.reset()
    agent, done = task.oracle(env), False
    while not done and (action := agent.act()) is not None:
        done = env.step(action)[2]
    return env.current_episode


def test_a_cube_is_put_into_a_bowl_of_hulls(library: Library) -> None:
    episode = put_into_bowl(library, "block/red_block.urdf", 0.04)
    assert episode.outcome == "success", episode.detail
    assert episode.strict == 1.0


def test_a_carton_wider_than_the_bowl_is_too_large_for_it(library: Library) -> None:
    episode = put_into_bowl(library, "HOPE/Spaghetti.urdf", 0.049)
    assert episode.outcome == "target_too_small", episode.detail
    assert "proxy/bowl.urdf #1 (0.179 x 0.179 m outside) is too small for HOPE/Spaghetti.urdf #2" in episode.detail
