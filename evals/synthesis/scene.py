"""Whole scenes: things of the library and others in a heap on a table or in a bin, photographed by a noisy camera, with
the arm in the picture or without."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt
from pydantic import Field

from evals.benchmark.ground_truth import TrueObject, Truth
from evals.synthesis.bin_walls import WALLS, write_bin_walls
from evals.synthesis.built_asset import png, write_assets
from evals.synthesis.camera import HIGHEST_TILT, LOWEST_TILT, random_camera
from evals.synthesis.clutter import CENTER, RestingObject, SynthesisError, settle_heap
from evals.synthesis.distractors import build_distractors
from evals.synthesis.drawing import PerfectImage, draw_scene, join_triangles, triangles_of, unoccluded_mask
from evals.synthesis.products import build_products
from evals.synthesis.robot import free_postures, robot_triangles
from evals.synthesis.scenery import random_scenery
from evals.synthesis.sensors import SENSORS, SensorKind
from evals.synthesis.sensors.common import noisy_rgb
from grs_agents.base import Frozen, Vec3
from grs_agents.base.files import write_bytes, write_json, write_text
from grs_agents.library.library import Library
from grs_agents.library.posed_meshes import Triangles, build_posed_triangles
from grs_agents.perception.types import Aabb, Camera
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.instance.task_instance import InstanceObject

_SHINY = 0.15
"""Share of specular objects."""
_SOURCE = """Rendered, not photographed: objects of this project's library and random others, settled by MuJoCo.
Made by `grs eval perception`; licence: Apache-2.0, as the project.

rgb.png         8-bit RGB
depth.png       uint16, millimetres along the optical axis, 0 = no measurement, registered to rgb.png
depth_true.png  the same without noise
camera.json     intrinsics, metres per depth unit, T_robot_cam (camera frame, OpenCV axes, to robot base frame)
labels.png      uint8 object ids, 0 = background
robot.png       255 where the robot is seen, whose joints camera.json gives; where it is in the picture
walls.png       255 where the walls of a bin around the objects are seen; where there is one
truth.json      what stands where: id, asset (empty: not in the library), pose, box (robot frame, m), visible pixels
"""
_POSTURES, _VIEWS = 6, 8
"""Largest numbers of arm postures, and of camera poses tried for these."""
_ROBOT_SHOWN = (0.01, 0.35)
"""Share of the picture covered by the robot without occlusion."""
_ROBOT_HIDES = 0.45
"""Largest share of the objects' pixels hidden by the robot."""
_NEAREST = 0.1
"""Least distance of the robot from the camera, m."""
LOWEST_TILT_OVER_WALLS = 40.0
"""Least downward tilt over walls, degrees: from lower, walls occlude the objects."""


class Recipe(Frozen):
    """The recipe of a scene; the same recipe makes the same files.

    Attributes:
        seed: of everything random.
        objects: number of objects.
        distractors: number of them with a random shape, which the library lacks.
        absent: number of them that are products resembling the library's, which it lacks too.
        arm: the robot is in the picture, at random joints.
        walls: a bin is around the objects.
        tilt: downward tilt of the camera, degrees.
        sensor: noise model of the depth.
        width, height: of the pictures, pixels.
    """

    seed: Annotated[int, Field(ge=0)] = 0
    objects: Annotated[int, Field(ge=1, le=40)] = 15
    distractors: Annotated[int, Field(ge=0)] = 4
    absent: Annotated[int, Field(ge=0)] = 0
    arm: bool = False
    walls: bool = False
    tilt: Annotated[float, Field(ge=LOWEST_TILT, le=HIGHEST_TILT)] = 45.0
    sensor: SensorKind = "stereo"
    width: Annotated[int, Field(ge=64, le=4096)] = 640
    height: Annotated[int, Field(ge=48, le=4096)] = 480


@dataclass(frozen=True)
class SynthesisedScene:
    """A synthesised scene.

    Attributes:
        recipe: its recipe.
        camera: calibrated.
        rgb: (H, W, 3) uint8.
        depth: (H, W) m, 0 = not measured.
        seen: the noise-free picture; its labels are the truth.
        truth: objects and poses.
        robot, walls: (H, W) masks of these.
    """

    recipe: Recipe
    camera: Camera
    rgb: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float64]
    seen: PerfectImage
    truth: Truth
    robot: npt.NDArray[np.bool_]
    walls: npt.NDArray[np.bool_]

    def write(self, folder: Path) -> None:
        """Write the scene folder; ``truth.json`` comes last, so that a folder which holds it is whole."""
        labels = self.seen.labels.astype(np.uint8)
        write_bytes(folder / "rgb.png", png(np.ascontiguousarray(self.rgb[:, :, ::-1])))
        write_bytes(folder / "depth.png", png(self._units(self.depth)))
        write_bytes(folder / "depth_true.png", png(self._units(self.seen.depth)))
        write_bytes(folder / "labels.png", png(labels))
        for name, mask in (("robot", self.robot), ("walls", self.walls)):
            if mask.any():
                write_bytes(folder / f"{name}.png", png(np.where(mask, 255, 0).astype(np.uint8)))
        write_json(folder / "camera.json", self.camera.model_dump(mode="json", exclude_none=True))
        write_text(folder / "SOURCE.txt", _SOURCE)
        write_json(folder / "truth.json", self.truth.model_dump(mode="json", exclude_none=True))

    def _units(self, depth: npt.NDArray[np.float64]) -> npt.NDArray[np.uint16]:
        return np.rint(np.clip(depth / self.camera.depth_scale, 0, 65535)).astype(np.uint16)


def recipes(count: int, seed: int = 0, like: Recipe | None = None) -> tuple[Recipe, ...]:
    """Recipes of different scenes: tilts spread evenly over 20 (in a bin 40) to 90 degrees in random order, the sensors
    in turn, all else as in ``like``, with no more distractors than there is place for."""
    like = like or Recipe()
    rng = np.random.default_rng(seed)
    steps = (rng.permutation(count) + rng.random(count)) / max(count, 1)
    lowest = LOWEST_TILT_OVER_WALLS if like.walls else LOWEST_TILT
    tilts = lowest + (HIGHEST_TILT - lowest) * steps
    kinds = list(SENSORS)
    return tuple(
        like.model_copy(
            update={
                "seed": 1000 * seed + index,
                "distractors": max(0, min(like.distractors, like.objects - like.absent)),
                "tilt": round(float(tilts[index]), 1),
                "sensor": kinds[index % len(kinds)],
            }
        )
        for index in range(count)
    )


@dataclass(frozen=True)
class _Arranged:
    """Objects at rest and their ground truth; triangles of objects, walls and robot, in this order of owners; and
    the camera."""

    resting: Sequence[RestingObject]
    kinds: Sequence[str]
    triangles: Triangles
    camera: Camera


def synthesise(recipe: Recipe, library: Library) -> SynthesisedScene:
    """Make a scene.

    Raises:
        SynthesisError: there are more strange things than objects, the heap does not come to rest, or the robot has no
            room in the picture.
    """
    if recipe.distractors + recipe.absent > recipe.objects:
        raise SynthesisError(
            f"{recipe.distractors} distractors and {recipe.absent} absent products among {recipe.objects} objects",
            "ask for more objects or fewer of them",
        )
    rng = np.random.default_rng(recipe.seed)
    with tempfile.TemporaryDirectory(prefix="grs-synth-") as folder:
        arranged = _arranged(recipe, library, Path(folder), rng)
    resting, triangles, camera = arranged.resting, arranged.triangles, arranged.camera
    shiny = [number for number in range(1, recipe.objects + 1) if rng.random() < _SHINY]
    seen = draw_scene(triangles, random_scenery(rng), camera, shiny)
    walls, robot = (seen.labels == recipe.objects + number for number in (1, 2))
    seen = replace(seen, labels=np.where(walls | robot, 0, seen.labels))
    truth = Truth(
        objects=tuple(
            _true_object(number, item, kind, item.asset in library, triangles, seen, camera)
            for number, (item, kind) in enumerate(zip(resting, arranged.kinds, strict=True), 1)
        ),
        sensor=recipe.sensor,
        tilt=recipe.tilt,
        seed=recipe.seed,
    )
    depth = SENSORS[recipe.sensor](seen, camera, rng)
    return SynthesisedScene(recipe, camera, noisy_rgb(seen.rgb, rng), depth, seen, truth, robot, walls)


def _arranged(recipe: Recipe, library: Library, folder: Path, rng: np.random.Generator) -> _Arranged:
    """Objects at rest, walls around them, the arm above, and the camera's pose; ``folder`` receives their assets."""
    strange = build_distractors(recipe.distractors, rng) + build_products(recipe.absent, library, rng)
    names = write_assets(folder / "strange", strange)
    both = library.copy_with_overlay_root(folder / "strange")
    known = recipe.objects - recipe.distractors - recipe.absent
    things = [asset for asset in library.everyday_assets() if asset.category != "proxy"]
    groups: dict[str, list[str]] = {}
    for asset in things:
        groups.setdefault(asset.category if asset.category == "cube" else asset.name, []).append(asset.name)
    keys = sorted(groups)
    picked = [keys[int(index)] for index in rng.permutation(len(keys))[:known]]
    picked += [keys[int(index)] for index in rng.integers(len(keys), size=known - len(picked))]
    resting = settle_heap([*[str(rng.choice(groups[key])) for key in picked], *names], both, rng)
    kinds = [both.asset(item.asset).category for item in resting]
    posed = [(item.asset, item.pose) for item in resting]
    triangles = build_posed_triangles(posed, both)
    if recipe.walls:
        flat = triangles.corners[:, :, :2]
        around = np.stack([flat.min(axis=(0, 1)), flat.max(axis=(0, 1))])
        posed.append((WALLS, write_bin_walls(folder / "bin", around, rng)))
        both = both.copy_with_overlay_root(folder / "bin")
        triangles = build_posed_triangles(posed, both)
    size = (recipe.width, recipe.height)
    if not recipe.arm:
        return _Arranged(resting, kinds, triangles, random_camera(recipe.tilt, _middle(resting), size, rng))
    items = [InstanceObject(id=number, asset=asset, pose=pose) for number, (asset, pose) in enumerate(posed, 1)]
    arm = get_arm()
    postures = free_postures(arm, items, both, _POSTURES, rng)
    for _ in range(_VIEWS):
        camera = random_camera(recipe.tilt, _middle(resting), size, rng)
        for joints in postures:
            robot = robot_triangles(arm, joints, recipe.objects + 2)
            if _shows_robot(robot, triangles, camera):
                rounded = tuple(round(float(joint), 9) for joint in joints)
                camera = camera.model_copy(update={"joints": rounded})
                return _Arranged(resting, kinds, join_triangles(triangles, robot), camera)
    raise SynthesisError(f"{len(postures)} postures leave the robot no room in the picture", "take another seed")


def _shows_robot(robot: Triangles, others: Triangles, camera: Camera) -> bool:
    """True if the picture shows a part of the robot, and the robot hides few pixels of the rest."""
    pose = np.asarray(camera.T_robot_cam, np.float64)
    if ((robot.corners - pose[:3, 3]) @ pose[:3, 2]).min() < _NEAREST:
        return False
    mine, theirs = unoccluded_mask(robot, camera), unoccluded_mask(others, camera)
    return bool(_ROBOT_SHOWN[0] < mine.mean() < _ROBOT_SHOWN[1] and (mine & theirs).sum() < _ROBOT_HIDES * theirs.sum())


def _middle(resting: Sequence[RestingObject]) -> Vec3:
    x, y, z = (float(value) for value in np.mean([item.pose[0] for item in resting], axis=0))
    return ((x + CENTER[0]) / 2, (y + CENTER[1]) / 2, z)


def _true_object(
    number: int, item: RestingObject, kind: str, known: bool, triangles: Triangles, seen: PerfectImage, camera: Camera
) -> TrueObject:
    mine = triangles_of(triangles, number)
    low, high = mine.corners.min(axis=(0, 1)).round(5).tolist(), mine.corners.max(axis=(0, 1)).round(5).tolist()
    return TrueObject(
        id=number,
        asset=item.asset if known else "",
        absent=not known,
        kind=kind,
        position=item.pose[0],
        orientation=item.pose[1],
        box=Aabb(low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2])),
        visible=int((seen.labels == number).sum()),
        whole=int(unoccluded_mask(mine, camera).sum()),
    )
