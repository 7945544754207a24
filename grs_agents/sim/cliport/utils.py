"""Colours, rigid transforms and helpers under the names that CLIPort programs use; quaternions are (x, y, z, w)."""

import random
from collections.abc import Sequence
from typing import Any

import numpy as np

from grs_agents.base import Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.world import colors

IDENTITY = transforms.IDENTITY
apply = transforms.transform_points
eulerXYZ_to_quatXYZW = transforms.eulerXYZ_to_quatXYZW
invert = transforms.invert_pose
multiply = transforms.compose_poses
multiply_quaternions = q_mult = transforms.multiply_quaternions
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
"""Descriptions of the kitting shapes by number."""


def get_colors_names(mode: str) -> list[str]:
    """Colour names of a mode: ``'train'``, ``'full'`` (both sets), else the set kept for evaluation."""
    if mode == "train":
        return list(TRAIN_COLORS)
    return list(dict.fromkeys(TRAIN_COLORS + EVAL_COLORS)) if mode == "full" else list(EVAL_COLORS)


def get_colors(mode: str = "train", n_colors: int = -1, **_: object) -> tuple[list[list[float]], list[str]]:
    """All colours of a mode, or ``n_colors`` of them at random, and their names."""
    names = get_colors_names(mode)
    chosen = names if n_colors < 0 else random.sample(names, n_colors)
    return [list(COLORS[name]) for name in chosen], chosen


def get_random_color() -> tuple[list[list[float]], list[str]]:
    """A colour of the training set and its name, each in a list."""
    return get_colors(n_colors=1)


class TreeNode:
    """A part of a box: ``bbox`` is (6,) its lowest and highest x, y, z; ``KDTree`` fills in ``children``."""

    def __init__(self, parent: "TreeNode | None", children: list["TreeNode"], bbox: Any) -> None:
        self.parent, self.children, self.bbox = parent, children, bbox


def KDTree(node: TreeNode, min_object_dim: float, margin: float, bboxes: list[Any]) -> None:
    """Cut a box at random into boxes with ``margin`` between them, until no side can be halved to ``min_object_dim``.

    The boxes (6,) that are left are added to ``bboxes``. Metres.
    """
    bbox: FloatArray = np.asarray(node.bbox, dtype=np.float64)
    size = bbox[3:] - bbox[:3]
    long = np.flatnonzero(size > 2 * min_object_dim)
    if len(long) == 0:
        bboxes.append(bbox)
        return
    axis = random.choice([int(index) for index in long])
    cut = random.uniform(float(bbox[axis]) + min_object_dim, float(bbox[axis + 3]) - min_object_dim)
    lower, upper = bbox.copy(), bbox.copy()
    lower[axis + 3], upper[axis] = cut - margin / 2, cut + margin / 2
    node.children = [TreeNode(node, [], lower), TreeNode(node, [], upper)]
    for child in node.children:
        KDTree(child, min_object_dim, margin, bboxes)


def solve_hanoi_all(n_disks: int) -> list[list[int]]:
    """The moves ``[disk, from rod, to rod]`` that bring a tower from rod 0 to rod 2; disk 0 is the smallest."""

    def moves(disk: int, source: int, target: int) -> list[list[int]]:
        if disk < 0:
            return []
        spare = 3 - source - target
        return [*moves(disk - 1, source, spare), [disk, source, target], *moves(disk - 1, spare, target)]

    return moves(n_disks - 1, 0, 2)


_SEEN = """alarm clock, android toy, black boot with leopard print, black fedora, black razer mouse, black sandal,
black shoe with orange stripes, bull figure, butterfinger chocolate, c clamp, can opener, crayon box, dog statue,
frypan, green and white striped towel, grey soccer shoe with cleats, hard drive, honey dipper, magnifying glass,
mario figure, nintendo 3ds, nintendo cartridge, office depot box, orca plush toy, pepsi gold caffeine free box,
pepsi wild cherry box, porcelain cup, purple tape, red and white flashlight, rhino figure, rocket racoon figure,
scissors, silver tape, spatula with purple head, spiderman figure, tablet, toy school bus"""
_UNSEEN = """ball puzzle, black and blue sneakers, black shoe with green stripes, brown fedora, dinosaur figure, hammer,
light brown boot with golden laces, lion figure, pepsi max box, pepsi next box, porcelain salad plate, porcelain spoon,
red and white striped towel, red cup, screwdriver, toy train, unicorn toy, white razer mouse, yoshi figure"""
_seen, _unseen = (text.replace("\n", " ").split(", ") for text in (_SEEN, _UNSEEN))
google_seen_obj_shapes = google_unseen_obj_shapes = {"train": _seen, "val": _unseen, "test": _unseen}
"""CLIPort's names of its scanned household objects; the objects themselves are not in the library."""
google_all_shapes = {mode: sorted(_seen + _unseen) for mode in ("train", "val", "test")}


def map_kit_scale(size: Sequence[float]) -> list[float]:
    """The ``SCALE`` of a kitting shape of a nominal size (m): (0.03, 0.03, 0.02) gives the usual (3, 3, 1) / 1000."""
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
