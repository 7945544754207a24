"""The end effectors and their primitives."""

from typing import get_args

import pytest

from grs_agents.library.library import Library
from grs_agents.sim import TaskInstance
from grs_agents.sim.end_effectors import END_EFFECTORS
from grs_agents.sim.instance.task_instance import Primitive
from grs_agents.sim.tabletop_episode import open_instance_episode
from grs_agents.sim.world.spec import TIMESTEP


@pytest.mark.parametrize("primitive", get_args(Primitive))
def test_an_episode_acts_with_the_end_effector_of_its_primitive(primitive: Primitive) -> None:
    instance = TaskInstance(task="", seed=0, max_steps=1, timestep=TIMESTEP, primitive=primitive, objects=(), goals=())
    episode = open_instance_episode(instance, Library())
    episode.reset()
    hand = episode.sim.end_effector
    assert (type(hand), hand.primitive) == (END_EFFECTORS[primitive], primitive)
    assert episode.sim.visible_scene.tool == hand.tool
