"""Rotations under the names of ``transforms3d``, which CLIPort requires and its programs import.

Quaternions are (w, x, y, z) here, other than everywhere else in GRS; angles are radians. Axes are named as there:
``s`` or ``r`` for axes that stand still or turn along, then the letters of the three axes, first rotation first.
"""

import math
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any, Final

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray, rotation_about_axis

Numbers = Sequence[float] | FloatArray
Axes = str | tuple[int, int, int, int]
_TINY: Final = float(np.finfo(np.float64).eps)
_LETTERS: Final = "xyz"
_NEXT: Final = (1, 2, 0, 1)
"""The next axis, cyclically."""


def _read_axes(axes: Axes) -> tuple[int, int, int, int]:
    """First axis, parity, repetition and frame of a convention (Shoemake, Graphics Gems IV).

    Raises ``KeyError`` for an unknown convention.
    """
    if not isinstance(axes, str):
        return axes
    if len(axes) != 4 or axes[0] not in "sr" or any(letter not in _LETTERS for letter in axes[1:]):
        raise KeyError(axes)
    order = [_LETTERS.index(letter) for letter in (axes[1:] if axes[0] == "s" else axes[:0:-1])]
    first, second, third = order
    if second in (first, third):
        raise KeyError(axes)
    return first, int(second != _NEXT[first]), int(first == third), int(axes[0] == "r")


def euler2quat(ai: float, aj: float, ak: float, axes: Axes = "sxyz") -> FloatArray:
    """Quaternion (w, x, y, z) of three angles (rad)."""
    first, parity, repetition, frame = _read_axes(axes)
    second, third = _NEXT[first + parity], _NEXT[first - parity + 1]
    order = (first, second, first if repetition else third)  # of rotations about fixed axes
    angles = (ak, aj, ai) if frame else (ai, aj, ak)
    turns = [axangle2quat(np.eye(3)[axis], angle, True) for axis, angle in zip(order, angles, strict=True)]
    return reduce(lambda before, turn: qmult(turn, before), turns)


def euler2mat(ai: float, aj: float, ak: float, axes: Axes = "sxyz") -> FloatArray:
    """Rotation matrix (3, 3) of three angles (rad)."""
    return quat2mat(euler2quat(ai, aj, ak, axes))


def mat2euler(mat: Any, axes: Axes = "sxyz") -> tuple[float, float, float]:
    """Three angles (rad) of a rotation matrix (3, 3), or of that in an affine (4, 4)."""
    i, parity, repetition, frame = _read_axes(axes)
    j, k = _NEXT[i + parity], _NEXT[i - parity + 1]
    m = np.asarray(mat, dtype=np.float64)[:3, :3]
    if repetition:
        across = math.hypot(m[i, j], m[i, k])
        middle = math.atan2(across, m[i, i])
        outer = (math.atan2(m[i, j], m[i, k]), math.atan2(m[j, i], -m[k, i]))
    else:
        across = math.hypot(m[i, i], m[j, i])
        middle = math.atan2(-m[k, i], across)
        outer = (math.atan2(m[k, j], m[k, k]), math.atan2(m[j, i], m[i, i]))
    if across <= 4 * _TINY:  # the first and the last axis are one
        outer = (math.atan2(-m[j, k], m[j, j]), 0.0)
    first, last = outer[::-1] if frame else outer
    sign = -1.0 if parity else 1.0
    return sign * first, sign * middle, sign * last


def quat2euler(quaternion: Numbers, axes: Axes = "sxyz") -> tuple[float, float, float]:
    """Three angles (rad) of a quaternion (w, x, y, z)."""
    return mat2euler(quat2mat(quaternion), axes)


def euler2axangle(ai: float, aj: float, ak: float, axes: Axes = "sxyz") -> tuple[FloatArray, float]:
    """Axis (3,) and angle (rad) of three angles (rad)."""
    return quat2axangle(euler2quat(ai, aj, ak, axes))


def axangle2euler(axis: Numbers, angle: float, axes: Axes = "sxyz") -> tuple[float, float, float]:
    """Three angles (rad) of an axis (3,) and an angle (rad)."""
    return mat2euler(axangle2mat(axis, angle), axes)


def axangle2mat(axis: Numbers, angle: float, is_normalized: bool = False) -> FloatArray:
    """Rotation matrix (3, 3) about an axis (3,) by an angle (rad)."""
    del is_normalized
    return rotation_about_axis(np.asarray(axis, dtype=np.float64), float(angle))


def axangle2aff(axis: Numbers, angle: float, point: Numbers | None = None) -> FloatArray:
    """Affine (4, 4) of a rotation about an axis (3,) through a point (3,)."""
    aff = np.eye(4)
    aff[:3, :3] = axangle2mat(axis, angle)
    if point is not None:
        aff[:3, 3] = np.asarray(point, dtype=np.float64) - aff[:3, :3] @ np.asarray(point, dtype=np.float64)
    return aff


def mat2axangle(mat: Any, unit_thresh: float = 1e-5) -> tuple[FloatArray, float]:
    """Axis (3,) and angle (rad, 0..pi) of a rotation matrix (3, 3); raises ``ValueError`` for any other matrix."""
    m = np.asarray(mat, dtype=np.float64)
    if not np.allclose(m @ m.T, np.eye(3), atol=max(unit_thresh, 1e-5)) or np.linalg.det(m) < 0:
        raise ValueError("no unit eigenvector corresponding to eigenvalue 1")
    return quat2axangle(mat2quat(m))


def aff2axangle(aff: Any) -> tuple[FloatArray, float, FloatArray]:
    """Axis (3,), angle (rad) and a point (3,) on the axis, of the rotation that an affine (4, 4) is."""
    a = np.asarray(aff, dtype=np.float64)
    axis, angle = mat2axangle(a[:3, :3])
    point = np.linalg.lstsq(np.eye(3) - a[:3, :3], a[:3, 3], rcond=None)[0]
    return axis, angle, np.asarray(point, dtype=np.float64)


def axangle2quat(vector: Numbers, theta: float, is_normalized: bool = False) -> FloatArray:
    """Quaternion (w, x, y, z) of an axis (3,) and an angle (rad)."""
    axis = np.asarray(vector, dtype=np.float64)
    if not is_normalized:
        axis = axis / np.linalg.norm(axis)
    return np.concatenate([[math.cos(theta / 2)], axis * math.sin(theta / 2)])


def quat2axangle(quat: Numbers, identity_thresh: float | None = None) -> tuple[FloatArray, float]:
    """Axis (3,) and angle (rad) of a quaternion (w, x, y, z); about x by 0 for the identity."""
    q = np.asarray(quat, dtype=np.float64)
    length = float(np.linalg.norm(q))
    if not math.isfinite(length):
        return np.array([1.0, 0.0, 0.0]), math.nan
    across = float(np.linalg.norm(q[1:]))
    least = 3 * _TINY if identity_thresh is None else identity_thresh
    if length < least or across < least:
        return np.array([1.0, 0.0, 0.0]), 0.0
    return q[1:] / across, 2 * math.acos(min(max(q[0] / length, -1.0), 1.0))


def quat2mat(q: Numbers) -> FloatArray:
    """Rotation matrix (3, 3) of a quaternion (w, x, y, z) of any length; length 0 gives the identity."""
    w, x, y, z = (float(value) for value in q)
    square = w * w + x * x + y * y + z * z
    if square < _TINY:
        return np.eye(3)
    s = 2.0 / square
    return np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
        ]
    )


def mat2quat(mat: Any) -> FloatArray:
    """Quaternion (w, x, y, z), w not negative, of the rotation nearest to a matrix (3, 3) (Bar-Itzhack 2000)."""
    (xx, yx, zx), (xy, yy, zy), (xz, yz, zz) = np.asarray(mat, dtype=np.float64).T[:3, :3].T
    k = np.array(
        [
            [xx - yy - zz, 0, 0, 0],
            [yx + xy, yy - xx - zz, 0, 0],
            [zx + xz, zy + yz, zz - xx - yy, 0],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    _, vectors = np.linalg.eigh(k / 3)  # reads the lower triangle
    x, y, z, w = vectors[:, -1]
    turn = np.array([-w, x, y, z])
    return -turn if turn[0] < 0 else turn


def fillpositive(xyz: Numbers, w2_thresh: float | None = None) -> FloatArray:
    """Quaternion (w, x, y, z) of length 1 with these last three numbers; raises ``ValueError`` if they are too long."""
    square = 1.0 - float(np.dot(xyz, xyz))
    if square < (-3 * _TINY if w2_thresh is None else w2_thresh):
        raise ValueError(f"w2 should be positive, but is {square:e}")
    return np.concatenate([[math.sqrt(max(square, 0.0))], np.asarray(xyz, dtype=np.float64)])


def qmult(q1: Numbers, q2: Numbers) -> FloatArray:
    """The product of two quaternions (w, x, y, z): turns by ``q2`` first."""
    w1, x1, y1, z1 = (float(value) for value in q1)
    w2, x2, y2, z2 = (float(value) for value in q2)
    return np.array(
        [
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        ]
    )


def qconjugate(q: Numbers) -> FloatArray:
    """(w, -x, -y, -z)."""
    return np.asarray(q, dtype=np.float64) * (1.0, -1.0, -1.0, -1.0)


def qnorm(q: Numbers) -> float:
    """The length of a quaternion."""
    return float(np.linalg.norm(np.asarray(q, dtype=np.float64)))


def qisunit(q: Numbers) -> bool:
    """Whether a quaternion has length 1."""
    return bool(np.allclose(qnorm(q), 1))


def qinverse(q: Numbers) -> FloatArray:
    """The quaternion whose product with ``q`` is 1."""
    return qconjugate(q) / qnorm(q) ** 2


def qeye() -> FloatArray:
    """The quaternion that turns nothing."""
    return np.array([1.0, 0.0, 0.0, 0.0])


def qexp(q: Numbers) -> FloatArray:
    """The exponential of a quaternion."""
    w, *vector = (float(value) for value in q)
    length = math.hypot(*vector)
    share = math.sin(length) / length if length > 0 else 1.0
    return math.exp(w) * np.array([math.cos(length), *(share * value for value in vector)])


def qlog(q: Numbers) -> FloatArray:
    """The natural logarithm of a quaternion."""
    w, *vector = (float(value) for value in q)
    length, across = qnorm(q), math.hypot(*vector)
    share = math.acos(min(max(w / length, -1.0), 1.0)) / across if across > 0 else 0.0
    return np.array([math.log(length), *(share * value for value in vector)])


def qpow(q: Numbers, n: float) -> FloatArray:
    """A unit quaternion that turns ``n`` times as far."""
    axis, angle = quat2axangle(q)
    return axangle2quat(axis, n * angle, True)


def rotate_vector(v: Numbers, q: Numbers, is_normalized: bool = True) -> FloatArray:
    """A vector (3,) turned by a quaternion (w, x, y, z)."""
    del is_normalized
    return quat2mat(q) @ np.asarray(v, dtype=np.float64)


def nearly_equivalent(q1: Numbers, q2: Numbers, rtol: float = 1e-5, atol: float = 1e-8) -> bool:
    """Whether two quaternions are the same rotation: equal or negatives of each other."""
    first, second = np.asarray(q1, dtype=np.float64), np.asarray(q2, dtype=np.float64)
    return any(np.allclose(first, sign * second, rtol, atol) for sign in (1, -1))


def compose(T: Any, R: Any, Z: Any, S: Any = None) -> FloatArray:
    """Affine (4, 4) of a translation (3,), a rotation (3, 3), zooms (3,) and shears (3,): xy, xz, yz."""
    shears = np.eye(3)
    if S is not None:
        shears[np.triu_indices(3, 1)] = S
    aff = np.eye(4)
    aff[:3, :3] = np.asarray(R, dtype=np.float64) @ np.diag(Z) @ shears
    aff[:3, 3] = T
    return aff


def decompose(A44: Any) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Translation (3,), rotation (3, 3), zooms (3,) and shears (3,) of an affine (4, 4)."""
    a = np.asarray(A44, dtype=np.float64)
    rotation, upper = np.linalg.qr(a[:3, :3])
    signs = np.sign(np.diag(upper))
    if np.prod(signs) * np.linalg.det(rotation) < 0:
        signs[0] = -signs[0]
    rotation, upper = rotation * signs, signs[:, None] * upper
    zooms = np.diag(upper).copy()
    return a[:3, 3], rotation, zooms, (upper / zooms[:, None])[np.triu_indices(3, 1)]


def tait_bryan(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of this module about z, then y, then x, all standing still, as ``transforms3d.taitbryan`` has it."""

    def about_z_y_x(*values: Any, z: float = 0.0, y: float = 0.0, x: float = 0.0) -> Any:
        named = () if function in (mat2euler, quat2euler, axangle2euler) else (z, y, x)[len(values) :]
        return function(*values, *named, axes="szyx")

    return about_z_y_x


def normalized_vector(vec: Numbers) -> FloatArray:
    """A vector (3,) of length 1 that points the same way."""
    return np.asarray(vec, dtype=np.float64) / np.linalg.norm(np.asarray(vec, dtype=np.float64))


def vector_norm(vec: Numbers) -> float:
    """The length of a vector."""
    return float(np.linalg.norm(np.asarray(vec, dtype=np.float64)))
