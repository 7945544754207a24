"""Motion of a rollout, sampled at about 30 Hz."""

import io
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.files import write_bytes
from grs_agents.sim.world.physics import Physics

RATE: Final = 30.0


class MotionRecording:
    """Records the motion of a world from now on; ``ids`` maps each id in the file to the object's id on the table."""

    def __init__(self, physics: Physics, ids: dict[int, int]) -> None:
        self._physics = physics
        bodies = {f"object_{name}": self._physics.world.bodies[number] for name, number in ids.items()}
        model = self._physics.model
        bodies |= {name: int(model.body(name).id) for name in physics.world.arm.link_names}
        self.names = tuple(bodies)
        self._rows = np.array(list(bodies.values()))
        self._start = float(self._physics.data.time)
        self._frames: list[tuple[float, npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]] = []
        self._physics.observer = self._sample_frame
        self._physics.observer_period = max(1, round(1 / RATE / self._physics.timestep))
        self._sample_frame()

    def _sample_frame(self) -> None:
        data = self._physics.data
        tool = np.array(self._physics.tip_position)
        self._frames.append((data.time - self._start, data.xpos[self._rows], data.xquat[self._rows], tool))

    def save(self, path: Path) -> Path:
        """Write ``times``, ``positions``, ``quaternions`` (xyzw), ``names`` and ``tool`` to an .npz file."""
        self._physics.observer, self._physics.observer_period = None, 1
        times, positions, quaternions, tool = (np.array(column) for column in zip(*self._frames, strict=True))
        buffer = io.BytesIO()
        turns, names = quaternions[..., [1, 2, 3, 0]].astype(np.float32), np.array(self.names)
        positions, tool = positions.astype(np.float32), tool.astype(np.float32)
        np.savez_compressed(buffer, times=times, positions=positions, quaternions=turns, names=names, tool=tool)
        return write_bytes(path, buffer.getvalue())
