"""Labelled scenes are read whole, or refused by name."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from evals.benchmark.ground_truth import labelled_folders, read_labelled
from grs_agents.base.errors import InputError


def _labelled(folder: Path, labels: np.ndarray, truth: object = None) -> Path:
    cv2.imwrite(str(folder / "labels.png"), labels)
    if truth is not None:
        (folder / "truth.json").write_text(json.dumps(truth))
    return folder


def test_the_sample_scene_is_labelled(sample_scene: Path) -> None:
    scene = read_labelled(sample_scene)
    assert len(scene.truth.objects) == scene.labels.max() == 11
    assert scene.truth.objects[0].rotation == pytest.approx((0, 0, np.sin(0.025), np.cos(0.025)))
    assert scene.ignored() == frozenset()


def test_what_is_hardly_seen_is_ignored(scene_folder: Callable[..., Path]) -> None:
    labels = np.zeros((24, 32), np.uint16)
    labels[:15, :20], labels[20:, :3], labels[:15, 20:] = 1, 2, 700
    objects = [{"id": 1, "whole": 4000}, {"id": 700, "whole": 200}, {"id": 900, "whole": 50}]
    scene = read_labelled(_labelled(scene_folder(), labels, {"objects": objects}))
    assert scene.ignored() == frozenset({1, 2, 900})


def test_labels_alone_are_enough(scene_folder: Callable[..., Path]) -> None:
    scene = read_labelled(_labelled(scene_folder(), np.ones((24, 32), np.uint8)))
    assert scene.truth.objects == ()


@pytest.mark.parametrize(("first", "unlabelled"), [(8, 0), (16, 24 * 4)])
def test_labels_made_on_the_depth_say_nothing_where_there_is_none(
    scene_folder: Callable[..., Path], first: int, unlabelled: int
) -> None:
    depth, labels = np.full((24, 32), 800, np.uint16), np.zeros((24, 32), np.uint8)
    depth[:, 8:12], labels[:, first:20] = 0, 1
    scene = read_labelled(_labelled(scene_folder(depth=cv2.imencode(".png", depth)[1].tobytes()), labels))
    assert np.count_nonzero(scene.unlabelled) == unlabelled


@pytest.mark.parametrize("labels", [np.zeros((24, 32, 3), np.uint8), np.zeros((12, 16), np.uint8)])
def test_labels_of_another_kind_are_refused(scene_folder: Callable[..., Path], labels: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"labels\.png"):
        read_labelled(_labelled(scene_folder(), labels))


@pytest.mark.parametrize("truth", [{"objects": [{"asset": "x"}]}, {"objects": [{"id": 1, "pose": 2}]}, [1], "x"])
def test_a_faulty_truth_is_refused(scene_folder: Callable[..., Path], truth: object) -> None:
    with pytest.raises(InputError, match=r"truth\.json"):
        read_labelled(_labelled(scene_folder(), np.ones((24, 32), np.uint8), truth))


def test_a_folder_without_labels_is_refused(scene_folder: Callable[..., Path], tmp_path: Path) -> None:
    scene_folder()
    with pytest.raises(InputError, match="no labelled scene"):
        labelled_folders(tmp_path)
    with pytest.raises(InputError, match=r"labels\.png"):
        read_labelled(tmp_path)
