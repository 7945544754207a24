"""Encoding of depth: byte order, sensor formats and unit, as far as the values show them; and depth that is no distance
along the optical axis, recognised by its planes."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.perception.types import Intrinsics

Units = npt.NDArray[np.number[Any]]
Depth = npt.NDArray[np.float32]

NEAREST, FARTHEST = 0.1, 10.0  # the median depth of a table-top photo lies between these, in metres
TABLE_NEAREST, TABLE_FARTHEST = 0.3, 2.0
"""An unnamed unit is inferred only if it puts the median depth between these, in metres: photos of tables are taken
from 0.4 to 1.5 m."""
MILLIMETRE = 0.001
_NEARLY_ALL = 0.97  # share of the measured pixels that must show a sensor format
_LEAST_LEVELS = 16  # different values by which a common factor of all is no chance
_ROTATED = 0.9  # share of the pixels without low bits if bits are rotated; values beyond 8,191 mm wrap into them
_MISSING_DISPARITY = 2047  # Kinect's 11-bit disparity where nothing was measured
_KINECT_OFFSET, _KINECT_FACTOR = 1092.5, 351.3
"""Depth of raw Kinect disparity d: factor / (offset - d) metres, as NYU Depth's toolbox and Open3D compute it."""
_SAMPLED, _TRIALS, _TOLERANCE = 2_500, 150, 0.004
"""Pixels and trials of the plane search; an inlier's relative deviation of inverse depth, a sensor's noise at 1 m."""
_CLEARLY, _LEAST_PLANE = 1.5, 0.1
"""Factor by which the plane of another meaning must be larger, and the least share of the pixels on it. On 24 photos of
three sensors the true meaning had 1.8 to 8 times the inliers of the next."""


@dataclass(frozen=True)
class DepthUnit:
    """Default of ``depth_scale`` if no file states it."""

    scale: float | None  # metres per unit, ``None`` if it cannot be inferred
    reason: str = ""  # for a note or an error; empty for the obvious unit


def _measured(units: Units) -> Units:
    """(N,) values of the measured pixels."""
    if units.dtype.kind == "f":
        return units[np.isfinite(units) & (units > 0)]
    return units[(units > 0) & (units < np.iinfo(units.dtype.name).max)]


def decode_sensor_format(units: Units) -> tuple[Units, float | None, str]:
    """Undo a sensor format that the values show beyond doubt.

    Formats: 16-bit values in the other byte order, SUN RGB-D's rotation by three bits, and Kinect's raw disparity.

    Returns:
        The values, their unit in metres if the format defines it, and a note; unchanged with an empty note for others.
    """
    if units.dtype.kind not in "iu" or not units.size or int(units.max()) > 65535 or int(units.min()) < 0:
        return units, None, ""
    words, note = units.astype(np.uint16), ""
    swapped = words.byteswap()
    if _roughness(words) > 4 * _roughness(swapped):
        words, note = swapped, "its bytes were swapped"
    measured = words[(words > 0) & (words < 65535)]
    if not measured.size:
        return units, None, ""
    missing = float((words == _MISSING_DISPARITY).mean())
    if int(words.max()) == _MISSING_DISPARITY and missing > 0.005 and int(measured.min()) > 300:
        valid = words < 1084  # 41 m
        metres = np.where(valid, _KINECT_FACTOR / np.where(valid, _KINECT_OFFSET - words, 1), 0)
        return (
            metres.astype(np.float32),
            1.0,
            ", ".join(filter(None, (note, "raw disparity of a Kinect, taken as metres"))),
        )
    rotated = (words >> 3) | (words << 13)
    median = float(np.median(rotated[(words > 0) & (words < 65535)])) * MILLIMETRE
    if _share_of_multiples(measured, 8) > _ROTATED and NEAREST <= median <= FARTHEST:
        return rotated, MILLIMETRE, ", ".join(filter(None, (note, "its bits are rotated by three, as in SUN RGB-D")))
    return (words, None, note) if note else (units, None, "")


def _share_of_multiples(measured: Units, factor: int) -> float:
    """Share of the values (N,) that are multiples of ``factor``; 0 if too few differ to show anything."""
    return (
        float((np.asarray(measured, np.int64) % factor == 0).mean())
        if len(np.unique(measured)) >= _LEAST_LEVELS
        else 0.0
    )


def _roughness(words: npt.NDArray[np.uint16]) -> float:
    """Median step between neighbouring pixels of a row, both measured and different, in units."""
    left, right = words[:, :-1].astype(np.int64), words[:, 1:].astype(np.int64)
    both = (left > 0) & (right > 0) & (left != right)
    steps = np.abs(left - right)[both]
    return float(np.median(steps)) if steps.size else 0.0


def guess_depth_unit(units: Units) -> DepthUnit:
    """Default unit of depth (H, W) if no file states it.

    Floats are metres, or millimetres if only these put the median where a table is. 16-bit integers are millimetres if
    the median depth is then that of a table. Integers that are all multiples of 5 or 10 are millimetres scaled to 5,000
    or 10,000 units a metre, as TUM's and YCB-Video's writers do."""
    measured = _measured(units)
    median = float(np.median(measured)) if measured.size else 0.0
    if units.dtype.kind == "f":
        if NEAREST <= median <= FARTHEST or not TABLE_NEAREST <= median * MILLIMETRE <= TABLE_FARTHEST:
            return DepthUnit(1.0)
        return DepthUnit(
            MILLIMETRE, f"taken are millimetres, with which the median depth is {median * MILLIMETRE:.2f} m"
        )
    if units.dtype.itemsize > 2 and not (measured.size and int(measured.max()) < 65535):
        return DepthUnit(None, f"integers of type {units.dtype} have no usual unit")
    if TABLE_NEAREST <= median * MILLIMETRE <= TABLE_FARTHEST:
        return DepthUnit(
            MILLIMETRE, f"taken are millimetres (0.001), with which the median depth is {median / 1000:.2f} m"
        )
    for scale in (10, 5):
        if _share_of_multiples(measured, scale) >= _NEARLY_ALL and NEAREST <= median / scale / 1000 <= FARTHEST:
            reason = f"every value is a multiple of {scale}; taken are {scale * 1000:,} units a metre, median depth"
            return DepthUnit(MILLIMETRE / scale, f"{reason} {median / scale / 1000:.2f} m")
    bounds = f"outside the {TABLE_NEAREST}..{TABLE_FARTHEST} m of a photo of a table"
    return DepthUnit(None, f"with millimetres the median depth would be {median * MILLIMETRE:.2f} m, {bounds}")


def resolve_stated_scale(units: Units, stated: float) -> DepthUnit:
    """The unit that another program's number means: metres a unit, millimetres a unit (BOP), or units a metre.

    The first that puts the median depth where a table is, else between 0.1 and 10 m."""
    measured = _measured(units)
    median = float(np.median(measured)) if measured.size else 0.0
    for near, far in ((TABLE_NEAREST, TABLE_FARTHEST), (NEAREST, FARTHEST)):
        for scale in (stated, stated * MILLIMETRE, 1 / stated):
            if near <= median * scale <= far:
                return DepthUnit(scale)
    return DepthUnit(stated)


def convert_ray_distance(depth: Depth, intrinsics: Intrinsics, where: str) -> tuple[Depth, str]:
    """Depth along the optical axis of depth (H, W), m, with a note if it held distances along the rays.

    On a plane the inverse of depth along the axis is affine in pixel coordinates; of a distance along the ray the
    ray's length over it; a disparity or z-buffer value itself. The meaning under which the largest plane has the most
    pixels is taken.

    Raises:
        InputError: the values are affine on planes: a disparity, a z-buffer or an inverse depth.
    """
    points, nearness = list_measured_rays(depth, intrinsics)
    if len(points) < _SAMPLED // 4:
        return depth, ""
    length = np.sqrt(1 + (points**2).sum(axis=1))
    axis, ray, affine = (measure_plane_share(points, q) for q in (nearness, length * nearness, 1 / nearness))
    if max(ray, affine) < max(_CLEARLY * axis, _LEAST_PLANE):
        return depth, ""
    if affine > ray:
        raise InputError(
            f"{where} is no depth: its planes are plane as a disparity, a z-buffer or an inverse depth "
            f"({affine:.0%} of the pixels on one, {axis:.0%} as depth)",
            "convert it to metres along the optical axis: focal length * baseline / disparity, or "
            "near * far / (far - value * (far - near))",
        )
    height, width = depth.shape
    across = (np.arange(width, dtype=np.float64) - intrinsics.cx) / intrinsics.fx
    down = (np.arange(height, dtype=np.float64) - intrinsics.cy) / intrinsics.fy
    along = (depth / np.sqrt(1 + across**2 + down[:, None] ** 2)).astype(np.float32)
    shares = f"{ray:.0%} of the pixels lie on one plane, {axis:.0%} otherwise"
    return along, f"depth was taken as distance along the ray and converted: {shares}"


def list_measured_rays(
    depth: Depth, intrinsics: Intrinsics
) -> "tuple[npt.NDArray[np.floating[Any]], npt.NDArray[np.float64]]":
    """x / z and y / z (N, 2) of the measured pixels of depth (H, W), and their inverse depth (N,), 1/m."""
    rows, columns = np.nonzero(depth > 0)
    points = np.stack([(columns - intrinsics.cx) / intrinsics.fx, (rows - intrinsics.cy) / intrinsics.fy], axis=1)
    return points, 1 / depth[rows, columns].astype(np.float64)


def measure_plane_share(points: "npt.NDArray[np.floating[Any]]", inverse: npt.NDArray[np.float64]) -> float:
    """Share of the pixels on the largest plane, by random sampling with a fixed seed.

    Args:
        points: (N, 2) x / z and y / z of the pixels' rays.
        inverse: (N,) inverse depth along the optical axis, which is affine in ``points`` on a plane.
    """
    generator = np.random.default_rng(0)
    chosen = generator.choice(len(points), min(_SAMPLED, len(points)), replace=False)
    rays, inverse = np.column_stack([points[chosen], np.ones(len(chosen))]), inverse[chosen]
    triples = generator.integers(0, len(rays), (_TRIALS, 3))
    corners = rays[triples]
    regular = np.abs(np.linalg.det(corners)) > 1e-9
    planes = np.linalg.solve(corners[regular], inverse[triples[regular]][..., None])[..., 0]
    deviation = np.abs(planes @ rays.T - inverse)
    return float((deviation < _TOLERANCE * np.abs(inverse)).mean(axis=1).max(initial=0.0))
