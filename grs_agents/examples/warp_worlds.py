"""Many worlds of a task by MuJoCo Warp, on a GPU or a processor: actions at 25 Hz, rewards by the places of the goals.

grs export runs/boxes --warp
python -m grs_agents.examples.warp_worlds runs/boxes-mjcf-warp --worlds 1024 --steps 250 --device cuda
"""

import argparse
import time
from functools import partial
from typing import Any

import mujoco_warp as mjw
import numpy as np
import warp as wp

from grs_agents.base.errors import InputError
from grs_agents.base.mujoco_import import mujoco


class Worlds:
    """Worlds (W) of an exported task, which has C actuators; ``data`` is their state, Warp arrays (W, ...)."""

    def __init__(self, scene: str, count: int) -> None:
        model: Any = mujoco.MjModel.from_xml_path(scene)
        start: Any = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, start, model.key("start").id)
        mujoco.mj_forward(model, start)
        room = {"nconmax": 2 * start.ncon + 64, "njmax": 2 * start.nefc + 256}  # for contacts and their rows in a world
        self.model, self.data = mjw.put_model(model), mjw.put_data(model, start, nworld=count, **room)
        self.low, self.high = model.actuator_ctrlrange.T
        rows = [row.objid for row in map(model.tuple, range(model.ntuple)) if row.name.startswith("goal_")]
        if not rows:
            raise InputError(f"no goal of {scene} has a place, so nothing can be rewarded")
        counts = np.array([len(row) - 1 for row in rows])  # of a row: the body of an object, the sites of its places
        self._bodies, self._firsts = np.repeat([row[0] for row in rows], counts), np.cumsum(counts) - counts
        self._sites = np.concatenate([row[1:] for row in rows])
        self._sizes, self._steps = model.site_size[self._sites, :2], range(round(0.04 / model.opt.timestep))  # 25 Hz
        if wp.get_device().is_cuda:
            self._advance()  # compiles, which a capture cannot
            with wp.ScopedCapture() as capture:
                self._advance()
            self._advance = partial(wp.capture_launch, capture.graph)
            self.reset(np.ones(count, bool))

    def reset(self, chosen: Any) -> None:
        """Begin the episode anew in the worlds ``chosen`` (W,)."""
        mjw.reset_data_keyframe(self.model, self.data, wp.array(np.where(chosen, 0, -1), dtype=int))

    def step(self, commands: Any) -> Any:
        """Act by ``commands`` (W, C); rewards (W,): the mean way of objects to their places, metres, negative."""
        self.data.ctrl.assign(np.clip(commands, self.low, self.high))
        self._advance()
        ways = self.data.xpos.numpy()[:, self._bodies] - self.data.site_xpos.numpy()[:, self._sites]
        along = np.einsum("wpi,wpij->wpj", ways, self.data.site_xmat.numpy()[:, self._sites])[..., :2]
        beyond = np.linalg.norm(np.maximum(np.abs(along) - self._sizes, 0), axis=-1)  # horizontally, of a site's box
        return -np.minimum.reduceat(beyond, self._firsts, axis=1).mean(1)

    def _advance(self) -> None:
        for _ in self._steps:
            mjw.step(self.model, self.data)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Random actions in many worlds.")
    parser.add_argument("folder", help="written by grs export --warp")
    for name, kind, default in (("device", str, None), ("worlds", int, 1024), ("steps", int, 250)):
        parser.add_argument(f"--{name}", type=kind, default=default)
    options, rng, rewards = parser.parse_args(), np.random.default_rng(0), np.zeros(0)
    wp.set_device(options.device or wp.get_preferred_device())
    worlds = Worlds(f"{options.folder}/scene.xml", options.worlds)
    reach, begun = np.minimum(0.06, (worlds.high - worlds.low) / 4), time.perf_counter()  # rad an action
    for _ in range(options.steps):
        rewards = worlds.step(worlds.data.ctrl.numpy() + rng.uniform(-reach, reach, (options.worlds, len(reach))))
        worlds.reset(rewards > -0.01)
    print(f"mean reward {rewards.mean():.3f} m after {time.perf_counter() - begun:.0f} s")
