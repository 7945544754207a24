"""The sample scene: groceries, two cubes, a bowl and an open box on a table."""

from pathlib import Path

import numpy as np

from evals.synthesis.built_asset import png
from evals.synthesis.sensors.simple import MILLIMETRE, noisy_rgb, stereo_depth
from grs_agents.files import write_bytes, write_json, write_text
from grs_agents.library.library import Library
from grs_agents.library.posed_meshes import PlacedAsset, placed_triangles
from scripts.assets.picture import View, picture

SEED = 2
VIEW = View(640, 480, 600.0, eye=(1.13, 0.02, 0.86), target=(0.47, 0.0, 0.03))
GROCERIES: tuple[PlacedAsset, ...] = (
    PlacedAsset("HOPE/Milk.urdf", 0.34, -0.345, 0.05),
    PlacedAsset("HOPE/OrangeJuice.urdf", 0.34, -0.225, -0.06),
    PlacedAsset("HOPE/Cookies.urdf", 0.34, -0.085, 0.04),
    PlacedAsset("HOPE/Mustard.urdf", 0.34, 0.055, -0.08),
    PlacedAsset("HOPE/TomatoSauce.urdf", 0.34, 0.175, 0.1),
    PlacedAsset("HOPE/Raisins.urdf", 0.34, 0.305, 0.06),
    PlacedAsset("block/red_block.urdf", 0.66, -0.345, 0.05),
    PlacedAsset("block/blue_block.urdf", 0.57, -0.345, -0.04),
    PlacedAsset("HOPE/Tuna.urdf", 0.62, -0.235, -0.2),
    PlacedAsset("bowl/bowl.urdf", 0.61, -0.06),
    PlacedAsset("container/open_box.urdf", 0.58, 0.23, np.pi / 2),
)

_SOURCE = """Rendered, not photographed: a synthetic RGB-D picture of objects from this project's own library, drawn by
the project's own code with a stereo-like noise model (quantised disparity, pixels lost at depth edges).
Licence: Apache-2.0, as the project.

rgb.png      8-bit RGB
depth.png    uint16, millimetres along the optical axis, 0 = no measurement, registered to rgb.png
camera.json  intrinsics, metres per depth unit, T_robot_cam (camera frame, OpenCV axes, to robot base frame)
labels.png   uint8 object ids, 0 = background
truth.json   what stands where: id, asset, position (m, centre, robot frame), yaw (rad)
"""


def write_scene(folder: Path, library: Library) -> None:
    """Draw the sample scene into ``folder``; the same code draws the same bytes."""
    rng = np.random.default_rng(SEED)
    shot = picture(placed_triangles(GROCERIES, library), VIEW, rng)
    cx, cy = VIEW.centre()
    camera = {"fx": VIEW.focal, "fy": VIEW.focal, "cx": cx, "cy": cy, "width": VIEW.width, "height": VIEW.height}
    matrix = VIEW.camera_to_robot().round(9).tolist()
    write_bytes(folder / "rgb.png", png(np.ascontiguousarray(noisy_rgb(shot.rgb, rng)[:, :, ::-1])))
    write_bytes(folder / "depth.png", png(stereo_depth(shot.depth, VIEW.focal, rng)))
    write_bytes(folder / "labels.png", png(shot.labels))
    write_json(folder / "camera.json", camera | {"depth_scale": MILLIMETRE, "T_robot_cam": matrix})
    write_json(folder / "truth.json", {"objects": [_truth(*entry, library) for entry in enumerate(GROCERIES, 1)]})
    write_text(folder / "SOURCE.txt", _SOURCE)


def _truth(number: int, thing: PlacedAsset, library: Library) -> dict[str, object]:
    position, yaw = thing.pose(library)
    return {"id": number, "asset": thing.asset, "position": [round(p, 4) for p in position], "yaw": round(yaw, 4)}
