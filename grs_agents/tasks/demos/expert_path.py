"""What the expert does, as actions at the control rate that do it again."""

from collections.abc import Iterator
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.cliport.task import Task
from grs_agents.sim.rollouts import run_oracle

Flags = npt.NDArray[np.bool_]
_EARLY: Final = 8
"""Control periods that suction is on before the cup touches: it takes hold as soon as it does."""
_AFTER_RELEASE: Final = 3
"""Control periods after letting go in which it stays off."""
_PRESS_STEPS: Final = 30
_PRESS: Final = 10
"""Physics steps that the arm waits where it took hold, pressing on as far as it came in so many of the last ones: a
replay that is a millimetre too high touches all the same."""
_REST_STEPS: Final = 20
"""Physics steps that it waits where it lets go."""


def record_expert(env: Environment, task: Task) -> tuple[FloatArray, Flags]:
    """Let the expert solve a task that was just reset; returns joint positions (N, dof) and whether something is held
    (N,), at each physics step; between two looks the joints turn evenly. ``env.current_episode`` says how it went."""
    physics = env.physics
    times, positions, held = [float(physics.data.time)], [physics.joint_positions], [False]

    def sample_arm_state() -> None:
        times.append(float(physics.data.time))
        positions.append(physics.joint_positions)
        held.append(physics.held_object_id is not None)

    physics.observer = sample_arm_state
    try:
        run_oracle(env, task)
    finally:
        physics.observer = None
    steps: FloatArray = np.round((np.array(times) - times[0]) / physics.timestep)
    at = np.linspace(0.0, float(steps[-1]), int(steps[-1]) + 1)
    looks: FloatArray = np.array(positions)
    path = np.column_stack([np.interp(at, steps, looks[:, joint]) for joint in range(looks.shape[1])])
    return path, np.array(held)[np.searchsorted(steps, at)]


def path_to_actions(positions: FloatArray, held: Flags, period: int, pace: float = 1.0) -> npt.NDArray[np.float32]:
    """Actions (T, dof + 1), one a control period of ``period`` physics steps, that follow a path of the expert.

    Each is the joint position that is reached at the end of its period, with suction, 1 on and -1 off. The arm waits a
    little where it takes hold and lets go; ``pace`` below 1 goes slower than the expert.
    """
    path, holding = _insert_pauses_at_grasp_changes(positions, held)
    at = np.minimum(np.arange(1, int(np.ceil((len(path) - 1) / (pace * period))) + 1) * period * pace, len(path) - 1)
    before, share = np.floor(at).astype(int), (at % 1)[:, None]
    after = np.minimum(before + 1, len(path) - 1)
    targets = path[before] * (1 - share) + path[after] * share
    suction = np.where(_compute_suction_commands(holding[before]), 1.0, -1.0)
    return np.concatenate([targets, suction[:, None]], axis=1).astype(np.float32)


def _insert_pauses_at_grasp_changes(positions: FloatArray, held: Flags) -> tuple[FloatArray, Flags]:
    """The same path with a pause at each change of ``held``."""
    pieces = list(_split_at_grasps_and_releases(positions, held))
    return np.concatenate([path for path, _ in pieces]), np.concatenate([flags for _, flags in pieces])


def _split_at_grasps_and_releases(positions: FloatArray, held: Flags) -> Iterator[tuple[FloatArray, Flags]]:
    begin = 0
    for change in (np.flatnonzero(held[1:] != held[:-1]) + 1).tolist():
        yield positions[begin : change + 1], held[begin : change + 1]
        begin = change + 1
        if held[change]:
            deeper = (positions[change - 1] - positions[max(0, change - 1 - _PRESS)]) * _press_depth_profile()
            yield positions[change] + deeper, np.ones(len(deeper), dtype=bool)
        else:
            yield np.repeat(positions[change][None], _REST_STEPS, axis=0), np.zeros(_REST_STEPS, dtype=bool)
    yield positions[begin:], held[begin:]


def _press_depth_profile() -> FloatArray:
    """(N, 1) down, there, and up again."""
    third = _PRESS_STEPS // 3
    down = np.linspace(0.0, 1.0, third + 1)[1:]
    return np.concatenate([down, np.ones(2 * third), down[::-1]])[:, None]


def _compute_suction_commands(held: Flags) -> Flags:
    """Suction (T,) for what is held (T,): on early, off in good time."""
    suction = held.copy()
    for _ in range(_EARLY):
        suction[:-1] |= suction[1:]
    for last in np.flatnonzero(held[:-1] & ~held[1:]).tolist():
        suction[last + 1 : last + 1 + _AFTER_RELEASE] = False
    return suction
