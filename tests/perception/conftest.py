"""Synthetic frames: boxes, cylinders and bowls on a plane, seen by a camera that casts one ray through each pixel."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from grs_agents.perception.types import Camera, RGBDFrame

Array = npt.NDArray[np.float64]
WIDTH, HEIGHT, FOCAL = 480, 360, 420.0


@dataclass(frozen=True)
class Thing:
    """A box (size x, y, z), or a cylinder (diameter, diameter, height), hollow down to 5 mm where ``wall`` is given."""

    kind: str
    center: tuple[float, float]
    size: tuple[float, float, float]
    yaw: float = 0.0
    bottom: float = 0.0
    wall: float = 0.0


@dataclass(frozen=True)
class Rendered:
    """A frame with its truth: (H, W) labels, 0 for the table, in the order of the things."""

    frame: RGBDFrame
    labels: npt.NDArray[np.int32]
    things: Sequence[Thing] = field(default_factory=tuple)


def look_at(eye: Sequence[float], target: Sequence[float]) -> Array:
    """4x4 transform from an OpenCV camera at ``eye`` to the world."""
    forward = np.subtract(target, eye)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1.0))
    right /= np.linalg.norm(right)
    transform = np.eye(4)
    transform[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    transform[:3, 3] = eye
    return transform


def _surfaces(thing: Thing, points: Array) -> npt.NDArray[np.bool_]:
    """Which (N, 3) points lie in the solid."""
    cosine, sine = np.cos(thing.yaw), np.sin(thing.yaw)
    shifted = points[:, :2] - np.array(thing.center)
    local = np.stack([shifted @ [cosine, sine], shifted @ [-sine, cosine]], axis=1)
    half = np.array(thing.size[:2]) / 2
    z = points[:, 2] - thing.bottom
    tall = (z >= 0) & (z <= thing.size[2])
    if thing.kind == "box":
        inside, hole = (np.abs(local) <= half).all(axis=1), (np.abs(local) <= half - thing.wall).all(axis=1)
    else:
        radius = np.linalg.norm(local, axis=1)
        inside, hole = radius <= half[0], radius <= half[0] - thing.wall
    return inside & tall & ~(hole & (z > 0.005) if thing.wall else np.zeros_like(tall))


def _crossing_of_hull(thing: Thing, origin: Array, rays: Array) -> tuple[Array, Array]:
    """How far along each of (N, 3) rays the filled thing begins and ends: two (N,). A miss ends first."""
    turn = np.array([[np.cos(thing.yaw), -np.sin(thing.yaw)], [np.sin(thing.yaw), np.cos(thing.yaw)]])
    half = np.array(thing.size[:2]) / 2
    eye, toward = (origin[:2] - np.array(thing.center)) @ turn, rays[:, :2] @ turn
    with np.errstate(divide="ignore", invalid="ignore"):
        if thing.kind == "box":
            sides = np.stack([(-half - eye) / toward, (half - eye) / toward])
            begins, ends = sides.min(axis=0).max(axis=1), sides.max(axis=0).min(axis=1)
        else:
            square, along = (toward**2).sum(axis=1), toward @ eye
            root = np.sqrt(along**2 - square * (eye @ eye - half[0] ** 2))
            begins = np.where(np.isnan(root), np.inf, (-along - root) / square)  # the ray passes by
            ends = (-along + root) / square
        levels = (thing.bottom + np.array([[0.0], [thing.size[2]]]) - origin[2]) / rays[:, 2]
    return np.fmax(begins, levels.min(axis=0)), np.fmin(ends, levels.max(axis=0))


def render(
    things: Sequence[Thing],
    noise: float = 0.001,
    seed: int = 0,
    calibrated: bool = False,
    eye: tuple[float, float, float] = (-0.25, 0.0, 0.75),
) -> Rendered:
    """March along each pixel's ray in small steps until it enters a thing or the table (1.4 x 1.4 m).

    Steps that are before the hull of a thing are not tried one by one.
    """
    pose = look_at(eye, (0.5, 0.0, 0.0))
    rows, columns = np.indices((HEIGHT, WIDTH))
    rays = np.stack([(columns - WIDTH / 2) / FOCAL, (rows - HEIGHT / 2) / FOCAL, np.ones((HEIGHT, WIDTH))], axis=-1)
    rays = rays.reshape(-1, 3) @ pose[:3, :3].T
    origin = pose[:3, 3]
    depth = np.where(rays[:, 2] < -1e-6, -eye[2] / np.minimum(rays[:, 2], -1e-6), 1e3)
    floor = origin + depth[:, None] * rays
    depth[~((np.abs(floor[:, :2] - (0.5, 0.0)) < 0.7).all(axis=1))] = 0
    labels = np.zeros(HEIGHT * WIDTH, np.int32)
    for number, thing in enumerate(things, 1):
        toward = np.array([*thing.center, thing.bottom + thing.size[2] / 2]) - origin
        reach = float(np.linalg.norm(thing.size)) / 2
        along = rays @ toward / (rays**2).sum(axis=1)
        near = np.flatnonzero(np.linalg.norm(rays * along[:, None] - toward, axis=1) < reach)
        start = np.maximum(along[near] - 1.1 * reach / 0.8, 0.05)
        hit = np.full(len(near), np.inf)
        enters, leaves = _crossing_of_hull(thing, origin, rays[near])
        step = max(0.002, reach / 80)
        count = np.maximum(np.ceil((enters - start) / step), 0)  # of steps, the next to be tried
        while len(open_rays := np.flatnonzero(np.isinf(hit) & (start + count * step <= leaves))):
            at = start[open_rays] + count[open_rays] * step
            entered = _surfaces(thing, origin + at[:, None] * rays[near[open_rays]])
            hit[open_rays[entered]] = at[entered]
            count[open_rays] += 1
        closer = hit < np.where(depth[near] > 0, depth[near] - 1e-9, np.inf)
        depth[near[closer]] = hit[closer]
        labels[near[closer]] = number
    rng = np.random.default_rng(seed)
    depth = np.where(depth > 0, depth + rng.normal(0, noise, depth.shape), 0).reshape(HEIGHT, WIDTH)
    colors = np.vstack([[150, 140, 130], rng.integers(30, 255, (len(things), 3))]).astype(np.uint8)
    labels = labels.reshape(HEIGHT, WIDTH)
    camera = Camera(
        fx=FOCAL,
        fy=FOCAL,
        cx=WIDTH / 2,
        cy=HEIGHT / 2,
        width=WIDTH,
        height=HEIGHT,
        depth_scale=0.001,
        T_robot_cam=tuple(tuple(float(v) for v in row) for row in pose) if calibrated else None,
    )
    return Rendered(RGBDFrame(colors[labels], depth.astype(np.float32), camera, Path("synthetic")), labels, things)


THINGS = (
    Thing("box", (0.45, 0.2), (0.08, 0.12, 0.15), yaw=0.4),
    Thing("cylinder", (0.4, 0.0), (0.08, 0.08, 0.1)),
    Thing("cylinder", (0.6, -0.2), (0.16, 0.16, 0.07), wall=0.008),
    Thing("box", (0.35, -0.2), (0.05, 0.05, 0.05)),
)


@pytest.fixture(scope="session")
def rendered() -> Rendered:
    """Four things of the common kinds, apart from each other, camera calibrated."""
    return render(THINGS, calibrated=True)


@pytest.fixture(scope="session")
def stacked() -> Rendered:
    """A box on a larger box, and beside them two touching boxes of different height."""
    return render(
        (
            Thing("box", (0.5, 0.18), (0.18, 0.2, 0.06)),
            Thing("box", (0.5, 0.18), (0.07, 0.07, 0.08), bottom=0.06),
            Thing("box", (0.5, -0.10), (0.1, 0.1, 0.14)),
            Thing("box", (0.46, -0.20), (0.1, 0.098, 0.05)),
        )
    )
