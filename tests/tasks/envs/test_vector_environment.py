"""Several environments in several processes."""

import os
import signal
from typing import Any

import numpy as np
import pytest

from grs_agents.base.errors import GrsError, InputError, UnknownNameError

gymnasium = pytest.importorskip("gymnasium")

GRS = "grs_agents.envs:GRS-v0"
ARGUMENTS: dict[str, Any] = {"horizon": 2, "cameras": ("front",), "image_size": (16, 24), "renderer": "rays"}


def test_processes_with_several_environments_do_as_gymnasium_does_in_this_one(blocks) -> None:
    rows: list[list[Any]] = []
    for settings in ({"vectorization_mode": "sync"}, {"workers": 2}):
        vector = gymnasium.make_vec(GRS, num_envs=3, run=blocks, **ARGUMENTS, **settings)
        vector.action_space.seed(0)
        rows.append([vector.reset(seed=5)])
        for _ in range(4):  # of which the second ends the episodes, and the third begins new ones
            rows[-1].append(vector.step(vector.action_space.sample()))
        seeds = [1, None, 2]
        mask = np.array([True, False, True])
        rows[-1].append(vector.reset(seed=seeds, options={"reset_mask": mask}))
        rows[-1].append((vector.call("task_description"), vector.observation_space, vector.action_space))
        vector.close()
    np.testing.assert_equal(rows[1], rows[0])
    assert rows[0][2][3].all()


def test_an_error_in_a_process_is_raised_here_and_the_others_go_on(blocks) -> None:
    vector = gymnasium.make_vec(GRS, num_envs=2, run=blocks, workers=2)
    with pytest.raises(UnknownNameError, match="unknown instance '9'"):
        vector.reset(options={"instance": 9})
    with pytest.raises(AttributeError, match="'GrsEnv' object has no attribute 'colour'"):
        vector.call("colour")
    observation, info = vector.reset(options={"instance": 1})
    assert info["instance"].tolist() == [1, 1]
    assert observation["objects"].shape[0] == 2
    (victim, _) = vector.unwrapped.processes
    os.kill(victim.pid, signal.SIGKILL)
    with pytest.raises(GrsError, match="a process of the environments was killed"):
        vector.step(vector.action_space.sample())
    vector.close()


def test_numbers_that_cannot_be_are_refused(blocks) -> None:
    with pytest.raises(InputError, match="2 environments in 0 processes"):
        gymnasium.make_vec(GRS, num_envs=2, run=blocks, workers=0)
    vector = gymnasium.make_vec(GRS, num_envs=2, run=blocks, workers=1)
    with pytest.raises(InputError, match="3 seeds and a mask of 2 for 2 environments"):
        vector.reset(seed=[1, 2, 3])
    vector.close()
