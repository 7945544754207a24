"""Paths of the tip and of joints: waypoints, splines, speed profiles and limits."""

from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray

WAYPOINT_STEPS: Final = 4
"""Time steps between waypoints of a planned path: 16 ms, interpolated smoothly."""
_SPACING: Final = 0.04
"""Travel between two poses that are solved, metres."""
TURN_RADIUS: Final = 0.25
"""Travel that a radian of turning counts as, metres."""
_LEAST: Final = 1e-9
"""Travel from row to row of a path that stands still, metres: its rows stay apart."""
_ROUNDED: Final = 1.03
"""Multiple of a speed limit that a slowed path may reach between rows where it speeds up."""


def measure_travel(tips: FloatArray, rotations: FloatArray) -> FloatArray:
    """Distance travelled (N,), metres, along a path of poses (N, 3), (N, 3, 3); turning counts by ``TURN_RADIUS``."""
    steps = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    cosine = np.einsum("nij,nij->n", rotations[1:], rotations[:-1]) / 2 - 0.5
    return np.concatenate([[0.0], np.cumsum(steps + TURN_RADIUS * np.arccos(np.clip(cosine, -1.0, 1.0)) + _LEAST)])


def choose_waypoint_indices(travel: FloatArray) -> npt.NDArray[np.intp]:
    """Indices of the rows to solve of a path, by the distance travelled (N,), the first and last included."""
    return evenly_spaced_indices(travel, max(2, int(np.ceil(travel[-1] / _SPACING)) + 1))


def evenly_spaced_indices(travel: FloatArray, count: int) -> npt.NDArray[np.intp]:
    """At most ``count`` indices, evenly spaced in distance travelled (N,), the first and last included."""
    rows: npt.NDArray[np.intp] = travel.searchsorted(np.arange(count) * (float(travel[-1]) / max(count - 1, 1)))
    rows[-1] = len(travel) - 1
    return rows[np.concatenate([[True], rows[1:] != rows[:-1]])]


def hermite_spline_points(values: FloatArray, rows: npt.NDArray[np.intp], travel: FloatArray) -> FloatArray:
    """Cubic Hermite spline (N, D) over the distance travelled (N,), through ``values`` (K, D) at ``rows`` (K,).

    Over time it would lose the gentle start and end of a short path, of which only both ends are solved.
    """
    if len(rows) == 1:
        return np.repeat(values, len(travel), axis=0)
    slopes = np.gradient(values, travel[rows], axis=0)
    before = (np.searchsorted(rows, np.arange(len(travel)), side="right") - 1).clip(0, len(rows) - 2)
    width = np.diff(travel[rows])[before, None]
    t = (travel - travel[rows][before])[:, None] / width
    start, end = values[before], values[before + 1]
    rise, fall = slopes[before] * width, slopes[before + 1] * width
    curve = (
        start * (2 * t**3 - 3 * t**2 + 1)
        + rise * (t**3 - 2 * t**2 + t)
        + end * (3 * t**2 - 2 * t**3)
        + fall * (t**3 - t**2)
    )
    return curve


def trapezoidal_profile(samples: int, ramp: float) -> FloatArray:
    """Trapezoidal profile: shares (samples,) of a path, 0..1, with ramps of a share ``ramp`` of the time."""
    time = np.arange(samples) * (1.0 / max(samples - 1, 1))
    start, end = np.minimum(time, ramp), np.minimum(1 - time, ramp)
    gone: FloatArray = (start * start - end * end) / (2 * ramp) + (ramp / 2)
    gone += np.minimum(np.maximum(time - ramp, 0.0), 1 - 2 * ramp)
    return gone / gone[-1]


def joint_speeds(path: FloatArray, timestep: float) -> FloatArray:
    """Joint speeds (N, D) along positions (N, D), a row per ``timestep`` (s), by central differences."""
    speeds = np.zeros(path.shape)
    if len(path) > 1:
        steps = (path[1:] - path[:-1]) / timestep
        speeds[1:-1] = (steps[1:] + steps[:-1]) / 2
        speeds[0], speeds[-1] = steps[0], steps[-1]
    return speeds


def slow_to_speed_limits(path: FloatArray, timestep: float, limits: FloatArray) -> FloatArray:
    """The path (N, D), a row per ``timestep`` (s), stretched in time until no joint exceeds its limit (D,).

    Where it speeds up between two of its rows, ``_ROUNDED`` times the limit may be left.
    """
    if len(path) < 2:
        return path
    slowed, rates, stretch = path, joint_speeds(path, 1.0), 1.0
    while (excess := _excess_speed(slowed, timestep, limits)) > (1.0 if stretch == 1.0 else _ROUNDED):
        stretch *= excess
        at = np.linspace(0.0, len(path) - 1.0, int(np.ceil((len(path) - 1) * stretch)) + 1)
        before = np.minimum(at.astype(np.intp), len(path) - 2)
        share = (at - before)[:, None]
        slowed = between_waypoints(path[before], path[before + 1], rates[before], rates[before + 1], share)
    return slowed


def _excess_speed(path: FloatArray, timestep: float, limits: FloatArray) -> float:
    """Greatest speed of a joint along a path (N, D), as a multiple of its limit (D,)."""
    return float((np.abs(path[1:] - path[:-1]).max(axis=0) / (limits * timestep)).max())


def between_waypoints(
    start: FloatArray, end: FloatArray, leaving: FloatArray, arriving: FloatArray, share: FloatArray | float
) -> FloatArray:
    """Cubic Hermite interpolation at a ``share`` (0..1) between waypoints passed at given rates per waypoint."""
    way, rest = end - start, 1 - share
    return start + share * way + share * rest * (rest * (leaving - way) - share * (arriving - way))


def rotations_about_z(angles: FloatArray) -> FloatArray:
    """Rotations (N, 3, 3) about the vertical by ``angles`` (N,), radians."""
    rotations = np.zeros((len(angles), 3, 3))
    rotations[:, 0, 0] = rotations[:, 1, 1] = np.cos(angles)
    rotations[:, 1, 0] = np.sin(angles)
    rotations[:, 0, 1] = -rotations[:, 1, 0]
    rotations[:, 2, 2] = 1.0
    return rotations
