"""Whole scenes: things of the library and others in a heap on a table in a room, photographed by a noisy camera."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt
from pydantic import Field

from evals.benchmark.ground_truth import TrueObject, Truth
from evals.synthesis.built_asset import png
from evals.synthesis.camera import HIGHEST_TILT, LOWEST_TILT, random_camera
from evals.synthesis.clutter import CENTER, RestingObject, SynthesisError, settle_heap
from evals.synthesis.distractors import FOLDER, write_distractors
from evals.synthesis.drawing import PerfectImage, draw_scene, triangles_of, unoccluded_mask
from evals.synthesis.scenery import random_scenery
from evals.synthesis.sensors import SENSORS, SensorKind
from evals.synthesis.sensors.common import noisy_rgb
from grs_agents.base import Frozen, Vec3
from grs_agents.files import write_bytes, write_json, write_text
from grs_agents.library import Library, Triangles, build_posed_triangles
from grs_agents.perception import Aabb, Camera

_SHINY = 0.15
"""Share of the things that mirror."""
_SOURCE = """Rendered, not photographed: objects of this project's library and random others, settled by MuJoCo.
Made by `grs eval perception`; licence: Apache-2.0, as the project.

rgb.png         8-bit RGB
depth.png       uint16, millimetres along the optical axis, 0 = no measurement, registered to rgb.png
depth_true.png  the same without noise
camera.json     intrinsics, metres per depth unit, T_robot_cam (camera frame, OpenCV axes, to robot base frame)
labels.png      uint8 object ids, 0 = background
truth.json      what stands where: id, asset (empty: not in the library), pose, box (robot frame, m), visible pixels
"""


class Recipe(Frozen):
    """What a scene is made from; the same recipe makes the same files.

    Attributes:
        seed: of everything random.
        objects: how many things there are.
        distractors: how many of them the library does not hold.
        tilt: how far the camera looks down, degrees.
        sensor: which noise the depth has.
        width, height: of the pictures, pixels.
    """

    seed: Annotated[int, Field(ge=0)] = 0
    objects: Annotated[int, Field(ge=1, le=40)] = 15
    distractors: Annotated[int, Field(ge=0)] = 4
    tilt: Annotated[float, Field(ge=LOWEST_TILT, le=HIGHEST_TILT)] = 45.0
    sensor: SensorKind = "stereo"
    width: Annotated[int, Field(ge=64, le=4096)] = 640
    height: Annotated[int, Field(ge=48, le=4096)] = 480


@dataclass(frozen=True)
class SynthesisedScene:
    """A made scene.

    Attributes:
        recipe: what it was made from.
        camera: calibrated.
        rgb: (H, W, 3) uint8.
        depth: (H, W) m, 0 = not measured.
        seen: the perfect picture; its labels are the truth.
        truth: what stands where.
    """

    recipe: Recipe
    camera: Camera
    rgb: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float64]
    seen: PerfectImage
    truth: Truth

    def write(self, folder: Path) -> None:
        """Write the scene folder; ``truth.json`` comes last, so that a folder which holds it is whole."""
        labels = self.seen.labels.astype(np.uint8)
        write_bytes(folder / "rgb.png", png(np.ascontiguousarray(self.rgb[:, :, ::-1])))
        write_bytes(folder / "depth.png", png(self._units(self.depth)))
        write_bytes(folder / "depth_true.png", png(self._units(self.seen.depth)))
        write_bytes(folder / "labels.png", png(labels))
        write_json(folder / "camera.json", self.camera.model_dump(mode="json"))
        write_text(folder / "SOURCE.txt", _SOURCE)
        write_json(folder / "truth.json", self.truth.model_dump(mode="json", exclude_none=True))

    def _units(self, depth: npt.NDArray[np.float64]) -> npt.NDArray[np.uint16]:
        return np.rint(np.clip(depth / self.camera.depth_scale, 0, 65535)).astype(np.uint16)


def recipes(
    count: int, seed: int = 0, objects: int = 15, distractors: int = 4, size: tuple[int, int] = (640, 480)
) -> tuple[Recipe, ...]:
    """Recipes of different scenes: tilts spread evenly over 20 to 90 degrees in random order, the sensors in turn."""
    rng = np.random.default_rng(seed)
    steps = (rng.permutation(count) + rng.random(count)) / max(count, 1)
    tilts = LOWEST_TILT + (HIGHEST_TILT - LOWEST_TILT) * steps
    kinds = list(SENSORS)
    return tuple(
        Recipe(
            seed=1000 * seed + index,
            objects=objects,
            distractors=min(distractors, objects),
            tilt=round(float(tilts[index]), 1),
            sensor=kinds[index % len(kinds)],
            width=size[0],
            height=size[1],
        )
        for index in range(count)
    )


def synthesise(recipe: Recipe, library: Library) -> SynthesisedScene:
    """Make a scene.

    Raises:
        SynthesisError: there are more distractors than objects, or the heap does not come to rest.
    """
    if recipe.distractors > recipe.objects:
        raise SynthesisError(
            f"{recipe.distractors} distractors among {recipe.objects} objects", "ask for more objects or fewer of them"
        )
    rng = np.random.default_rng(recipe.seed)
    with tempfile.TemporaryDirectory(prefix="grs-synth-") as folder:
        strange = write_distractors(Path(folder), recipe.distractors, rng)
        names = [*_chosen(recipe.objects - recipe.distractors, library, rng), *strange]
        both = library.with_overlay(Path(folder))
        resting = settle_heap(names, both, rng)
        triangles = build_posed_triangles([(one.asset, one.pose) for one in resting], both)
    camera = random_camera(recipe.tilt, _middle(resting), (recipe.width, recipe.height), rng)
    shiny = [number for number in range(1, recipe.objects + 1) if rng.random() < _SHINY]
    seen = draw_scene(triangles, random_scenery(rng), camera, shiny)
    truth = Truth(
        objects=tuple(_true_object(number, one, triangles, seen, camera) for number, one in enumerate(resting, 1)),
        sensor=recipe.sensor,
        tilt=recipe.tilt,
        seed=recipe.seed,
    )
    depth = SENSORS[recipe.sensor](seen, camera, rng)
    return SynthesisedScene(recipe, camera, noisy_rgb(seen.rgb, rng), depth, seen, truth)


def _chosen(count: int, library: Library, rng: np.random.Generator) -> list[str]:
    """Different things of the library, cubes counting as one, for as long as there are enough."""
    things = [asset for asset in library.everyday_assets() if asset.category != "proxy"]
    groups: dict[str, list[str]] = {}
    for asset in things:
        groups.setdefault(asset.category if asset.category == "cube" else asset.name, []).append(asset.name)
    keys = sorted(groups)
    picked = [keys[int(index)] for index in rng.permutation(len(keys))[:count]]
    picked += [keys[int(index)] for index in rng.integers(len(keys), size=count - len(picked))]
    return [str(rng.choice(groups[key])) for key in picked]


def _middle(resting: Sequence[RestingObject]) -> Vec3:
    x, y, z = (float(value) for value in np.mean([one.pose[0] for one in resting], axis=0))
    return ((x + CENTER[0]) / 2, (y + CENTER[1]) / 2, z)


def _true_object(
    number: int, one: RestingObject, triangles: Triangles, seen: PerfectImage, camera: Camera
) -> TrueObject:
    mine = triangles_of(triangles, number)
    low, high = mine.corners.min(axis=(0, 1)).round(5).tolist(), mine.corners.max(axis=(0, 1)).round(5).tolist()
    return TrueObject(
        id=number,
        asset="" if one.asset.startswith(f"{FOLDER}/") else one.asset,
        position=one.pose[0],
        orientation=one.pose[1],
        box=Aabb(low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2])),
        visible=int((seen.labels == number).sum()),
        whole=int(unoccluded_mask(mine, camera).sum()),
    )
