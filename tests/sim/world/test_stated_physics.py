"""Mass and friction said as numbers are those that an object had without."""

import numpy as np
import pytest

from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.sim import InstanceObject, TaskInstance, rollout
from grs_agents.sim.instance.task_instance import HEAVIEST
from grs_agents.sim.world.compilation import compile_world
from grs_agents.sim.world.spec import fill_in_masses_and_frictions, instance_to_spec
from tests.test_examples import EXAMPLES, instance_of

SOLVED = ("put_in_bowls", "lay_rope_along_line")
LIBRARY = Library()


def model_bytes(instance: TaskInstance) -> bytes:
    """All of the compiled world."""
    model = compile_world(instance_to_spec(instance, LIBRARY)).model
    content = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return content.tobytes()


@pytest.mark.parametrize("example", EXAMPLES[::6], ids=lambda example: example.name)
def test_worlds_are_equal_to_the_last_bit(example) -> None:
    instance = instance_of(example, 1, LIBRARY)
    stated = fill_in_masses_and_frictions(instance, LIBRARY)
    assert all(item.mass is not None and item.friction is not None for item in stated.objects)
    assert model_bytes(stated) == model_bytes(instance)


@pytest.mark.parametrize("name", SOLVED)
def test_episodes_are_equal_to_the_last_bit(name: str) -> None:
    instance = instance_of(next(example for example in EXAMPLES if example.name == name), 1, LIBRARY)
    assert rollout(fill_in_masses_and_frictions(instance, LIBRARY), LIBRARY) == rollout(instance, LIBRARY)


def test_what_an_instance_may_not_say_stays_the_assets_own() -> None:
    pose = ((0.5, 0.0, -0.05), (0.0, 0.0, 0.0, 1.0))
    giant = InstanceObject(id=1, asset="plane/plane.urdf", pose=pose, mass=HEAVIEST)  # 10 m long, of no mass of its own
    instance = TaskInstance(task="t", seed=0, max_steps=1, timestep=0.004, objects=(giant,), goals=())
    [stated] = fill_in_masses_and_frictions(instance, LIBRARY).objects
    assert (stated.mass, stated.friction) == (None, 0.6)
