"""The surroundings of the objects: a table in a room, the appearance of their surfaces, and the light."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
FLOOR = -0.74
_TEXELS = 512
_ROW = 4096


@dataclass(frozen=True)
class Surface:
    """A rectangle with a picture that is repeated over it.

    Attributes:
        corner: (3,) m, robot frame.
        sides: (2, 3) from the corner along both sides, m.
        texture: (T, T, 3) red, green, blue in 0..1.
        tile: side of one repetition, m.
    """

    corner: Floats
    sides: Floats
    texture: Floats
    tile: float

    @property
    def normal(self) -> Floats:
        """(3,) unit normal."""
        cross = np.cross(*self.sides)
        return cross / np.linalg.norm(cross)

    def hit(self, rays: Floats, eye: Floats, reach: Floats) -> npt.NDArray[np.int64]:
        """Shorten the rays that the surface stops.

        Args:
            rays: (N, 3) directions.
            eye: (3,) origin of the rays, m.
            reach: (N,) lengths so far; changed in place.

        Returns:
            The numbers of the rays that it stops.
        """
        slope = dot_products(rays, self.normal)
        with np.errstate(divide="ignore"):
            far = float((self.corner - eye) @ self.normal) / slope
        near = np.flatnonzero((far > 1e-3) & (far < reach))
        along = self._along(eye + far[near, None] * rays[near])
        stopped = near[(np.abs(along[:, 0] - 0.5) <= 0.5) & (np.abs(along[:, 1] - 0.5) <= 0.5)]
        reach[stopped] = far[stopped]
        return stopped

    def color(self, points: Floats) -> Floats:
        """(N, 3) red, green, blue in 0..1 at points (N, 3) of the surface."""
        lengths = np.linalg.norm(self.sides, axis=1)
        return bilinear(self.texture, self._along(points) * lengths / self.tile * len(self.texture))

    def _along(self, points: Floats) -> Floats:
        """(N, 2) coordinates of points along both sides, 0..1."""
        offset = points - self.corner
        return np.stack([dot_products(offset, side / float(side @ side)) for side in self.sides], axis=1)


def dot_products(vectors: Floats, vector: Floats) -> Floats:
    """Scalar products (N,) of vectors (N, 3) with a vector; ten times as fast as a matrix product of this shape."""
    return vectors[:, 0] * vector[0] + vectors[:, 1] * vector[1] + vectors[:, 2] * vector[2]


def bilinear(image: Floats, texels: Floats) -> Floats:
    """(N, C) samples of a picture (T, U, C) that goes on over its edges, at (N, 2) columns and rows."""
    count, height, width = len(texels), image.shape[0], image.shape[1]
    places = np.zeros((max(1, -(-count // _ROW)) * _ROW, 2), np.float32)
    places[:count] = texels % (width, height)
    columns, rows = places.T.reshape(2, -1, _ROW)  # OpenCV refuses a picture of a single long row
    sampled = cv2.remap(image.astype(np.float32), columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(sampled, np.float64).reshape(-1, image.shape[2])[:count]


@dataclass(frozen=True)
class Light:
    """A lamp far away and the light from everywhere else.

    Attributes:
        direction: (3,) unit vector towards the lamp.
        lamp, sky: (3,) red, green, blue of either.
    """

    direction: Floats
    lamp: Floats
    sky: Floats


@dataclass(frozen=True)
class Scenery:
    """A room with a table, and its light."""

    surfaces: tuple[Surface, ...]
    light: Light


def random_scenery(rng: np.random.Generator) -> Scenery:
    """A table of random size, wider than the heap, somewhere in a room, under a random lamp."""
    low = np.array([0.5, 0.0]) - rng.uniform(0.5, 0.8, 2)
    high = np.array([0.5, 0.0]) + rng.uniform(0.5, 0.8, 2)
    wide, deep = high - low
    top, wood = random_texture(rng), random_texture(rng)
    tile = float(rng.uniform(0.3, 0.9))
    sides = [((low[0], low[1]), (wide, 0.0)), ((high[0], low[1]), (0.0, deep))]
    sides += [((high[0], high[1]), (-wide, 0.0)), ((low[0], high[1]), (0.0, -deep))]
    surfaces = [Surface(np.array([*low, 0.0]), np.array([[wide, 0.0, 0.0], [0.0, deep, 0.0]]), top, tile)]
    surfaces += [
        Surface(np.array([*corner, -0.03]), np.array([[*along, 0.0], [0.0, 0.0, 0.03]]), wood, 0.5)
        for corner, along in sides
    ]
    surfaces += _room(rng)
    height, bearing = np.deg2rad(rng.uniform(35, 80)), rng.uniform(-np.pi, np.pi)
    direction = np.array([np.cos(height) * np.cos(bearing), np.cos(height) * np.sin(bearing), np.sin(height)])
    warmth, share, exposure = rng.uniform(-0.08, 0.12), rng.uniform(0.35, 0.65), rng.uniform(0.8, 1.25)
    tint = np.array([1 + warmth, 1.0, 1 - warmth])
    light = Light(direction, exposure * share * 1.15 * tint, exposure * (1 - share) * (2 - tint))
    return Scenery(tuple(surfaces), light)


def _room(rng: np.random.Generator) -> list[Surface]:
    """Floor and four walls around the table."""
    low, high = np.array([0.5, 0.0]) - rng.uniform(1.4, 2.5, 2), np.array([0.5, 0.0]) + rng.uniform(1.4, 2.5, 2)
    (x, y), (wide, deep), tall = low, high - low, 3.0
    floor, wall = random_texture(rng), random_texture(rng)
    rectangles = [
        ((x, y), ((wide, 0.0, 0.0), (0.0, deep, 0.0)), floor),
        ((x, y), ((0.0, deep, 0.0), (0.0, 0.0, tall)), wall),
        ((x + wide, y), ((0.0, deep, 0.0), (0.0, 0.0, tall)), wall),
        ((x, y), ((wide, 0.0, 0.0), (0.0, 0.0, tall)), wall),
        ((x, y + deep), ((wide, 0.0, 0.0), (0.0, 0.0, tall)), wall),
    ]
    return [Surface(np.array([*corner, FLOOR]), np.array(sides), image, 1.0) for corner, sides, image in rectangles]


def random_texture(rng: np.random.Generator) -> Floats:
    """(T, T, 3) red, green, blue in 0..1: planks, a plain coat, checks or speckles, of a random tone."""
    make = _TEXTURES[int(rng.integers(len(_TEXTURES)))]
    value, saturation = rng.uniform(0.2, 0.8), rng.uniform(0.0, 0.25) * rng.random()
    hue = rng.uniform(0, 2 * np.pi)
    tone = value * (1 + saturation * np.cos(hue + np.array([0.0, 2.1, 4.2])))
    return np.clip(make(rng)[:, :, None] * tone, 0.02, 1.0)


def _planks(rng: np.random.Generator) -> Floats:
    grain = 1 + 0.10 * _noise(rng, (96, 4)) + 0.05 * _noise(rng, (256, 12))
    count = int(rng.integers(3, 7))
    plank = np.arange(_TEXELS) * count // _TEXELS
    seam = np.where(np.diff(plank, append=-1) != 0, 0.75, 1.0)
    return grain * (rng.uniform(0.9, 1.08, count)[plank] * seam)[:, None]


def _plain(rng: np.random.Generator) -> Floats:
    return 1 + 0.015 * _noise(rng, (16, 16))


def _checks(rng: np.random.Generator) -> Floats:
    count = int(rng.integers(3, 9))
    square = np.arange(_TEXELS) * 2 * count // _TEXELS % 2
    return 1 - rng.uniform(0.1, 0.5) * (square[:, None] ^ square[None]) + 0.03 * _noise(rng, (128, 128))


def _speckles(rng: np.random.Generator) -> Floats:
    return 1 + rng.uniform(0.05, 0.2) * _noise(rng, (170, 170)) + 0.08 * _noise(rng, (24, 24))


_TEXTURES: tuple[Callable[[np.random.Generator], Floats], ...] = (_planks, _plain, _checks, _speckles)


def _noise(rng: np.random.Generator, cells: tuple[int, int]) -> Floats:
    """(T, T) smooth noise of about unit deviation with ``cells`` down and across, which goes on over the edges."""
    coarse = np.pad(rng.normal(size=cells), 2, mode="wrap")
    rows, columns = (_TEXELS * (count + 4) // count for count in cells)
    fine = np.asarray(cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_CUBIC), np.float64)
    top, left = (2 * _TEXELS // count for count in cells)
    return fine[top : top + _TEXELS, left : left + _TEXELS]
