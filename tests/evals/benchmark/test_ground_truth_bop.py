"""A synthesised scene written as a BOP data set gives the figures that it gives as a folder."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from evals.benchmark.box_errors import object_figures
from evals.benchmark.ground_truth import bop_sources, read_labelled
from evals.synthesis import Recipe, SynthesisedScene, synthesise
from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.library.posed_meshes import build_posed_triangles
from grs_agents.library.shapes import IDENTITY_PLACEMENT, matrix_from_quaternion
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.table_finding import find_table

RECIPE = Recipe(seed=11, objects=4, distractors=0, tilt=55.0, sensor="time_of_flight", width=320, height=240)


def _ply(points: np.ndarray) -> str:
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    return head + "".join(f"{x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in points)


@pytest.fixture(scope="module")
def scene() -> SynthesisedScene:
    """Four things of the library."""
    return synthesise(RECIPE, Library())


@pytest.fixture(scope="module")
def bop(scene: SynthesisedScene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scene as image 3 of scene 1 of a data set's split."""
    root = tmp_path_factory.mktemp("bop")
    folder, camera = root / "test" / "000001", scene.camera
    pose = np.array(camera.T_robot_cam)
    scene.write(root / "plain")
    for name in ("rgb", "depth", "mask_visib"):
        (folder / name).mkdir(parents=True)
    for name in ("rgb", "depth"):
        (folder / name / "000003.png").write_bytes((root / "plain" / f"{name}.png").read_bytes())
    (root / "models").mkdir()
    poses, shown = [], []
    for index, one in enumerate(scene.truth.objects):
        assert one.position is not None and one.orientation is not None
        mask = (scene.seen.labels == one.id).astype(np.uint8) * 255
        cv2.imwrite(str(folder / "mask_visib" / f"000003_{index:06d}.png"), mask)
        points = build_posed_triangles([(one.asset, IDENTITY_PLACEMENT)], Library()).corners.reshape(-1, 3)
        (root / "models" / f"obj_{one.id:06d}.ply").write_text(_ply(1000 * points))
        rotation = pose[:3, :3].T @ matrix_from_quaternion(one.orientation)
        shift = 1000 * pose[:3, :3].T @ (np.array(one.position) - pose[:3, 3])
        poses.append({"obj_id": one.id, "cam_R_m2c": rotation.ravel().tolist(), "cam_t_m2c": shift.tolist()})
        shown.append({"px_count_visib": one.visible, "px_count_all": one.whole})
    entry = {"cam_K": [camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1], "depth_scale": 1.0}
    for name, value in (("camera", entry), ("gt", poses), ("gt_info", shown)):
        (folder / f"scene_{name}.json").write_text(json.dumps({"3": value}))
    return root


def test_true_masks_have_true_boxes_in_the_found_frame(bop: Path, scene: SynthesisedScene) -> None:
    labelled = read_labelled(Path(f"bop:{bop}/test/1/3"))
    assert [one.visible for one in labelled.truth.objects] == [one.visible for one in scene.truth.objects]
    assert np.array_equal(labelled.labels > 0, scene.seen.labels > 0)
    table = find_table(labelled.frame, np.random.default_rng(0))
    candidates = measure_candidates(labelled.frame, table, labelled.labels)
    figures = object_figures(labelled, labelled.labels, candidates, Library(), table)
    centers = [one.center for one in figures if one.center is not None]
    assert len(centers) == 4
    assert np.median(centers) < 0.01
    assert all(one.angle is None for one in figures)


def test_a_split_a_scene_and_an_image_name_its_images(bop: Path) -> None:
    image = f"bop:{bop}/test/000001/3"
    for source in (f"bop:{bop}/test", f"bop:{bop}/test/000001"):
        assert bop_sources(source, 5) == [image]
    assert bop_sources(f"bop:{bop}/test/1/3", 5) == [f"bop:{bop}/test/1/3"]
    with pytest.raises(InputError, match="no scene folder"):
        bop_sources(f"bop:{bop}/train/7/1", 5)


def test_images_are_spread_evenly(bop: Path, tmp_path: Path) -> None:
    scene = tmp_path / "test" / "000004"
    scene.mkdir(parents=True)
    (scene / "scene_camera.json").write_text(json.dumps({str(number): {} for number in range(100)}))
    assert [Path(one).name for one in bop_sources(f"bop:{tmp_path}/test", 3)] == ["0", "50", "99"]


@pytest.mark.parametrize(("name", "value"), [("gt_info", {"3": 5}), ("gt_info", []), ("gt", {"3": [{"obj_id": 1}]})])
def test_a_faulty_truth_is_refused(bop: Path, tmp_path: Path, name: str, value: object) -> None:
    import shutil

    root = tmp_path / "set"
    shutil.copytree(bop, root)
    (root / "test" / "000001" / f"scene_{name}.json").write_text(json.dumps(value))
    with pytest.raises(InputError, match=f"scene_{name}"):
        read_labelled(Path(f"bop:{root}/test/1/3"))
