"""Where MJCF puts things: positions and the many ways to write a rotation."""

import math
from collections.abc import Mapping

import numpy as np

from grs_agents.base import Quat, Vec3
from grs_agents.library.formats.model_file import Source
from grs_agents.library.shapes import HERE, Placement, composed

_UNREAD = ("xyaxes",)
_ORIGIN: Vec3 = (0.0, 0.0, 0.0)


class Frames:
    """Reads placements in a file's own conventions.

    Args:
        source: the file, for its errors.
        compiler: the attributes of its ``<compiler>``: ``angle`` and ``eulerseq`` count.

    Raises:
        InputError: it uses coordinates that we do not read.
    """

    def __init__(self, source: Source, compiler: Mapping[str, str]) -> None:
        self.source = source
        self.unit = 1.0 if compiler.get("angle", "degree") == "radian" else math.pi / 180
        self.sequence = compiler.get("eulerseq", "xyz")
        if compiler.get("coordinate", "local") != "local":
            raise source.fault("global coordinates", "give every position in its parent's frame")
        if len(self.sequence) != 3 or any(letter not in "xyzXYZ" for letter in self.sequence):
            raise source.fault(f"eulerseq {self.sequence!r}", "give three of the letters x y z X Y Z")

    def placement(self, said: Mapping[str, str]) -> Placement:
        """Position and rotation of a body or geom with these attributes."""
        x, y, z = self.source.numbers(said.get("pos", "0 0 0"), "pos", 3)
        return (x, y, z), self._rotation(said)

    def between(self, text: str) -> tuple[float, Placement]:
        """Length of a ``fromto`` and the placement whose z axis runs along it from its middle."""
        ends = np.array(self.source.numbers(text, "fromto", 6)).reshape(2, 3)
        length = float(np.linalg.norm(ends[1] - ends[0]))
        if length < 1e-6:
            raise self.source.fault(f"fromto {text[:80]!r} has no length", "give two different points")
        x, y, z = (float(value) for value in ends.mean(axis=0))
        return length, ((x, y, z), _along((ends[1] - ends[0]) / length))

    def _rotation(self, said: Mapping[str, str]) -> Quat:
        for name in _UNREAD:
            if name in said:
                raise self.source.fault(f"{name} is not read", "write the rotation as quat or euler")
        if "quat" in said:
            w, x, y, z = self._unit(self.source.numbers(said["quat"], "quat", 4), "quat")
            return (x, y, z, w)
        if "axisangle" in said:
            *axis, angle = self._angles(said["axisangle"], 4, "axisangle")
            return _turn(np.array(self._unit(tuple(axis), "axisangle")), angle * self.unit)
        if "zaxis" in said:
            return _along(np.array(self._unit(self.source.numbers(said["zaxis"], "zaxis", 3), "zaxis")))
        if "euler" in said:
            return self._euler(self._angles(said["euler"], 3, "euler"))
        return HERE[1]

    def _euler(self, angles: tuple[float, ...]) -> Quat:
        """Lower-case letters turn about the moving axes, capitals about the fixed ones."""
        total = HERE
        for letter, angle in zip(self.sequence, angles, strict=True):
            axis = np.eye(3)["xyz".index(letter.lower())]
            turn: Placement = (_ORIGIN, _turn(axis, angle * self.unit))
            total = composed(total, turn) if letter.islower() else composed(turn, total)
        return total[1]

    def _angles(self, text: str, count: int, name: str) -> tuple[float, ...]:
        """Numbers that may be angles in degrees, beyond the bound that lengths have."""
        shrunk = " ".join(f"{number / 10:.17g}" for number in self._plain(text, name))
        return tuple(number * 10 for number in self.source.numbers(shrunk, name, count))

    def _plain(self, text: str, name: str) -> tuple[float, ...]:
        try:
            return tuple(float(word) for word in text.split())
        except ValueError:
            raise self.source.fault(f"{name} is {text[:80]!r}", "give numbers") from None

    def _unit(self, numbers: tuple[float, ...], name: str) -> tuple[float, ...]:
        length = math.sqrt(sum(number * number for number in numbers))
        if length < 1e-9:
            raise self.source.fault(f"{name} {numbers} has no direction", "give a vector that is not zero")
        return tuple(number / length for number in numbers)


def _turn(axis: np.ndarray[tuple[int], np.dtype[np.float64]], angle: float) -> Quat:
    x, y, z = (float(value) * math.sin(angle / 2) for value in axis)
    return (x, y, z, math.cos(angle / 2))


def _along(direction: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Quat:
    """The smallest rotation that takes z to ``direction`` (unit)."""
    x, y, z = (float(value) for value in direction)
    if z < -1 + 1e-12:
        return (1.0, 0.0, 0.0, 0.0)
    length = math.sqrt((1 + z) ** 2 + x * x + y * y)
    return (-y / length, x / length, 0.0, (1 + z) / length)
