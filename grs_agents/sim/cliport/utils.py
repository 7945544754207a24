"""Colours and rigid transforms under the names that CLIPort programs use; quaternions are (x, y, z, w)."""

import random
from collections.abc import Sequence

from grs_agents.base import Vec3
from grs_agents.geometry import FloatArray, transforms
from grs_agents.sim.world import colors

IDENTITY = transforms.IDENTITY
apply = transforms.transform_points
eulerXYZ_to_quatXYZW = transforms.eulerXYZ_to_quatXYZW
invert = transforms.invert_pose
multiply = transforms.compose_poses
multiply_quaternions = transforms.multiply_quaternions
plain_pose = transforms.parse_pose
quat = transforms.to_unit_quaternion
quatXYZW_to_eulerXYZ = transforms.quatXYZW_to_eulerXYZ
rotation_matrix = transforms.quaternion_to_matrix
vec3 = transforms.to_vec3
yaw_of = transforms.yaw_of_quaternion
COLORS = colors.COLORS
COLORS_NAMES = list(COLORS)
TRAIN_COLORS = ["blue", "red", "green", "yellow", "brown", "gray", "cyan"]
EVAL_COLORS = ["blue", "red", "green", "orange", "purple", "pink", "white"]
_SHAPES = """letter R shape, letter A shape, triangle, square, plus, letter T shape, diamond, pentagon, rectangle,
flower, star, circle, letter G shape, letter V shape, letter E shape, letter L shape, ring, hexagon, heart,
letter M shape"""
assembling_kit_shapes = dict(enumerate(_SHAPES.replace("\n", " ").split(", ")))
"""What the kitting shapes look like, by number."""


def get_colors_names(mode: str) -> list[str]:
    """The names of the colours of a mode: ``'train'``, ``'full'`` (both sets), else those kept for evaluation."""
    if mode == "train":
        return list(TRAIN_COLORS)
    return list(dict.fromkeys(TRAIN_COLORS + EVAL_COLORS)) if mode == "full" else list(EVAL_COLORS)


def get_colors(mode: str, n_colors: int = -1, **_: object) -> tuple[list[list[float]], list[str]]:
    """All colours of a mode or ``n_colors`` of them at random, and their names."""
    names = get_colors_names(mode)
    chosen = names if n_colors < 0 else random.sample(names, n_colors)
    return [list(COLORS[name]) for name in chosen], chosen


def map_kit_scale(size: Sequence[float]) -> list[float]:
    """The ``SCALE`` of a kitting shape spoken of by a size (m): (0.03, 0.03, 0.02) gives the usual (3, 3, 1) / 1000."""
    return [size[0] / 10, size[1] / 10, size[2] / 20]


def xyz_to_pix(position: Sequence[float], bounds: FloatArray, pixel_size: float) -> tuple[int, int]:
    """The (row, column) of a position in a top-down map of ``bounds``."""
    return (round((position[1] - bounds[1, 0]) / pixel_size), round((position[0] - bounds[0, 0]) / pixel_size))


def pix_to_xyz(pixel: Sequence[int], height: FloatArray, bounds: FloatArray, pixel_size: float) -> Vec3:
    """The position under (row, column) of a top-down height map of ``bounds``."""
    row, column = int(pixel[0]), int(pixel[1])
    return (
        float(bounds[0, 0] + column * pixel_size),
        float(bounds[1, 0] + row * pixel_size),
        float(bounds[2, 0] + height[row, column]),
    )
