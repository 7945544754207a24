"""A scene with the arm, a bin and products that the library lacks: the truth says which pixels are whose."""

from pathlib import Path

import numpy as np
import pytest

from evals.benchmark.ground_truth import read_labelled
from evals.synthesis import Recipe, SynthesisedScene, SynthesisError, recipes, synthesise
from grs_agents.library.library import Library
from grs_agents.sim.arms.registry import get_arm

CROWDED = Recipe(
    seed=3, objects=4, distractors=0, absent=2, arm=True, walls=True, tilt=60.0, sensor="stereo", width=160, height=120
)


@pytest.fixture(scope="module")
def crowded() -> SynthesisedScene:
    """Four things, two of them absent products, in a bin, with the arm in the picture."""
    return synthesise(CROWDED, Library())


def _points(scene: SynthesisedScene, mask: np.ndarray) -> np.ndarray:
    """(N, 3) true points of pixels, robot frame."""
    camera, depth = scene.camera, scene.seen.depth[mask]
    rows, columns = np.nonzero(mask)
    local = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(len(rows))], -1)
    pose = np.array(camera.T_robot_cam)
    return local * depth[:, None] @ pose[:3, :3].T + pose[:3, 3]


def test_every_raised_pixel_is_an_object_the_robot_or_a_wall(crowded: SynthesisedScene) -> None:
    everything = np.ones(crowded.robot.shape, bool)
    raised = _points(crowded, everything)[:, 2].reshape(everything.shape) > 0.003
    near = crowded.seen.depth < 1.5  # the room's walls rise above the table too
    owned = crowded.robot | crowded.walls | (crowded.seen.labels > 0)
    assert not (crowded.robot & crowded.walls).any()
    assert not ((crowded.robot | crowded.walls) & (crowded.seen.labels > 0)).any()
    assert (owned | ~raised | ~near).all()
    assert 0.005 < crowded.robot.mean() < 0.35


def test_the_robots_pixels_are_where_its_joints_bring_it(crowded: SynthesisedScene) -> None:
    joints = np.array(crowded.camera.joints)
    arm = get_arm()
    tip, _ = arm.tip_pose(joints)
    reached = _points(crowded, crowded.robot)
    assert len(joints) == arm.dof
    assert arm.find_collision_at_joints(joints) is None
    assert (np.linalg.norm(reached, axis=1) < 1.3).all()
    assert tip[2] > 0.05


def test_walls_stand_around_all_objects(crowded: SynthesisedScene) -> None:
    walls = _points(crowded, crowded.walls)
    lows = np.min([one.box.low[:2] for one in crowded.truth.objects if one.box], axis=0)
    highs = np.max([one.box.high[:2] for one in crowded.truth.objects if one.box], axis=0)
    outside = ((walls[:, :2] < lows + 1e-6) | (walls[:, :2] > highs - 1e-6)).any(axis=1)
    assert outside.all()
    assert walls[:, 2].max() < 0.145


def test_absent_products_are_told(crowded: SynthesisedScene) -> None:
    absent = [one for one in crowded.truth.objects if one.absent]
    assert [one.asset for one in absent] == ["", ""]
    assert all(one.kind for one in absent)
    assert all(one.asset in Library() for one in crowded.truth.objects if not one.absent)


def test_a_written_scene_tells_what_is_fixed(crowded: SynthesisedScene, tmp_path: Path) -> None:
    crowded.write(tmp_path / "scene")
    scene = read_labelled(tmp_path / "scene")
    assert scene.fixed is not None
    assert np.array_equal(scene.fixed, crowded.robot | crowded.walls)
    assert scene.frame.camera.joints == crowded.camera.joints
    assert scene.truth == crowded.truth


def test_recipes_keep_what_they_are_like() -> None:
    made = recipes(5, seed=3, like=CROWDED)
    assert all(one.walls and one.arm and one.absent == 2 for one in made)
    assert min(one.tilt for one in made) >= 40.0


def test_more_strange_things_than_objects_are_refused() -> None:
    with pytest.raises(SynthesisError, match="3 absent products"):
        synthesise(CROWDED.model_copy(update={"absent": 3, "distractors": 2}), Library())
