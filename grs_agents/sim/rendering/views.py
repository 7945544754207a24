"""What is to be seen, from where, and the picture that comes of it."""

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.instance.task_instance import InstanceObject
from grs_agents.sim.world.spec import Tool


@dataclass(frozen=True)
class View:
    """A camera: where it is and what it looks at (m), its vertical field of view (deg), rows and columns."""

    position: Vec3
    target: Vec3
    field_of_view: float = 45.0
    height: int = 480
    width: int = 640


FRONT = View((1.35, 0.0, 0.75), (0.45, 0.0, 0.05))
LEFT = View((0.15, 0.85, 0.65), (0.5, 0.0, 0.05))
RIGHT = View((0.15, -0.85, 0.65), (0.5, 0.0, 0.05))


@dataclass(frozen=True)
class Picture:
    """color (H, W, 3) uint8; depth (H, W) float32 metres along the optical axis, 0 = nothing; owner (H, W) id or -1."""

    color: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]
    owner: npt.NDArray[np.int32]


@dataclass(frozen=True)
class VisibleScene:
    """What there is to see."""

    objects: Sequence[InstanceObject]
    library: Library
    joints: FloatArray | None = None  # positions (dof,); None leaves the arm out
    arm: Arm | None = None  # None for the default
    tool: Tool = "suction"
    poses: Sequence[Pose] | None = None  # of the objects, where they do not stand as they say
    background: str | None = None  # library name of what stands fixed around the robot


def encode_png(color: npt.NDArray[np.uint8]) -> bytes:
    """An image (H, W, 3) as a PNG file's content."""
    height, width = color.shape[:2]
    rows = np.hstack([np.zeros((height, 1), np.uint8), color.reshape(height, -1)])  # filter type 0 before each row

    def png_chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = png_chunk(b"IHDR", header) + png_chunk(b"IDAT", zlib.compress(rows.tobytes())) + png_chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body
