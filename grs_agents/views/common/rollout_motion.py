"""Recorded motion of a rollout, and the intervals in which the tool held an object."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.arrays import read_npz
from grs_agents.base.foreign.files import read_bytes
from grs_agents.sim.arms.arm_files import resolve_robot_path
from grs_agents.sim.instance.task_instance import MAX_BYTES, InstanceError, TaskInstance, parse_instance_json

Array = npt.NDArray[np.float32]
_REMEDY = "restore the file or run again"
_ARRAYS = {"times": "seconds", "names": "of the bodies", "positions": "metres", "quaternions": "xyzw", "tool": "metres"}
_MOST_BYTES = 96 << 20
"""Largest recording in memory: the sample scene takes 0.3 MiB, the longest episode with 60 bodies about 90."""
_LONGEST = 36_000.0
"""Longest recording, simulated seconds; 200 actions, the maximum of a task, take about 1,200."""
_LEAST_SPEED = 0.02
"""Speed of the tool below which it rests, m/s."""
_GRASP_RADIUS = 0.25
"""Distance from the tool within which an object that moves with it counts as held, m."""
_SHORTEST_GRASP = 0.2
"""Duration up to which an object that moves with the tool counts as pushed, s."""


@dataclass(frozen=True)
class Motion:
    """Motion of B bodies over N frames, in the robot frame."""

    times: npt.NDArray[np.float64]  # (N,) simulated seconds from the start, rising
    names: tuple[str, ...]  # of the bodies: `object_<id>`, or a link of the arm
    positions: Array  # (N, B, 3) metres
    quaternions: Array  # (N, B, 4) xyzw
    tool: Array  # (N, 3) metres, the tip of the tool

    @property
    def duration_seconds(self) -> float:
        """Duration of the motion, simulated seconds."""
        return float(self.times[-1]) if self.times.size else 0.0

    def downsample(self, rate: float) -> "Motion":
        """The motion at a frame rate of at most ``rate``, last frame included."""
        if self.times.size < 2:
            return self
        seconds = np.arange(0, self.times[-1], 1 / rate)
        kept = np.unique(np.append(np.searchsorted(self.times, seconds), self.times.size - 1))
        return Motion(self.times[kept], self.names, self.positions[kept], self.quaternions[kept], self.tool[kept])

    def frame_index_at(self, seconds: float) -> int:
        """Index of the frame shown at ``seconds``."""
        return int(np.clip(np.searchsorted(self.times, seconds), 0, self.times.size - 1))


@dataclass(frozen=True)
class GraspInterval:
    """The tool holds a body from frame ``start`` until frame ``end``."""

    body: str
    start: int
    end: int


def read_task_instance(file: Path) -> TaskInstance:
    """Read the task instance of a rollout, from the folder ``instances`` of its run."""
    try:
        instance = parse_instance_json(read_bytes(file, _REMEDY, MAX_BYTES))
    except InstanceError as error:
        raise InputError(f"{file}: {error.message}", _REMEDY) from error
    return resolve_robot_path(instance, file.parent.parent)


def read_motion(file: Path) -> Motion:
    """Read the recording of a rollout."""
    arrays = read_npz(file, _ARRAYS, {}, _MOST_BYTES, ("names",))
    times, names = _seconds_since_start(arrays["times"], file), arrays["names"]
    frames, bodies = len(times), len(np.atleast_1d(names))
    shapes = [("names", (bodies,)), ("positions", (frames, bodies, 3)), ("quaternions", (frames, bodies, 4))]
    for name, shape in (*shapes, ("tool", (frames, 3))):
        if arrays[name].shape != shape:
            size = f"{frames} frames of {bodies} bodies"
            raise InputError(f"{name} in {file} has the shape {arrays[name].shape}, not that of {size}", _REMEDY)
        if name != "names" and not np.isfinite(arrays[name]).all():
            raise InputError(f"{name} in {file} are not all finite", _REMEDY)
    keys = ("positions", "quaternions", "tool")
    positions, quaternions, tool = (arrays[key].astype(np.float32, copy=False) for key in keys)
    named = tuple(str(name) for name in names)
    return Motion(times=times, names=named, positions=positions, quaternions=quaternions, tool=tool)


def read_motion_duration(file: Path) -> float:
    """Duration of a rollout's recording, s, without reading the rest."""
    return _seconds_since_start(read_npz(file, {"times": "seconds"}, {}, _MOST_BYTES)["times"], file)[-1]


def _seconds_since_start(times: npt.NDArray[Any], file: Path) -> npt.NDArray[np.float64]:
    """``times`` (N,), shifted to begin at 0."""
    if times.ndim != 1 or not np.isfinite(times).all():
        raise InputError(f"times in {file} are no list of numbers", _REMEDY)
    seconds = times.astype(np.float64) - float(times[0])
    if (np.diff(seconds) < 0).any() or seconds[-1] > _LONGEST:
        raise InputError(f"times in {file} do not rise, or by more than {_LONGEST:g} s", _REMEDY)
    return seconds


def find_grasps(motion: Motion) -> list[GraspInterval]:
    """Grasps in order of time: a body near the tool moves with it.
    A tool at rest does not end a grasp, and intervals of up to 0.2 s are pushes."""
    grasps: list[GraspInterval] = []
    if motion.times.size < 2:
        return grasps
    seconds = np.diff(motion.times)
    tool_step = np.diff(motion.tool, axis=0)
    for index, name in enumerate(motion.names):
        if not name.startswith("object_"):
            continue
        step = np.diff(motion.positions[:, index], axis=0)
        near = np.linalg.norm(motion.positions[1:, index] - motion.tool[1:], axis=1) < _GRASP_RADIUS
        moves = np.linalg.norm(tool_step, axis=1) > _LEAST_SPEED * seconds
        along = np.linalg.norm(step - tool_step, axis=1) < 0.5 * np.linalg.norm(tool_step, axis=1)
        held, rests = near & moves & along, near & ~moves
        start = last = -1
        for step_index in [*range(len(held)), None]:
            if step_index is not None and held[step_index]:
                start, last = (step_index if start < 0 else start), step_index
            elif start >= 0 and (step_index is None or not rests[step_index]):
                if motion.times[last + 1] - motion.times[start] > _SHORTEST_GRASP:
                    grasps.append(GraspInterval(name, start, last + 1))
                start = -1
    return sorted(grasps, key=lambda grasp: grasp.start)
