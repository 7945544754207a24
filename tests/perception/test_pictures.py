"""The pictures that a run keeps."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from grs_agents.perception.picture_files import draw_candidate_overlay, save_candidates, save_frame
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.table_finding import find_table
from tests.perception.conftest import Rendered
from tests.pictures import read_picture


def test_a_frame_is_kept_as_it_was(rendered: Rendered, tmp_path: Path) -> None:
    files = save_frame(rendered.frame, tmp_path)
    rgb = cv2.cvtColor(read_picture(tmp_path / files["rgb"], cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    assert np.array_equal(rgb, rendered.frame.rgb)
    depth = read_picture(tmp_path / files["depth"])
    assert np.abs(depth * 0.001 - rendered.frame.depth).max() < 0.0006


def test_candidates_are_kept_with_their_masks(rendered: Rendered, tmp_path: Path) -> None:
    table = find_table(rendered.frame, np.random.default_rng(0))
    found = measure_candidates(rendered.frame, table, rendered.labels)
    records = save_candidates(rendered.frame, found, tmp_path)
    assert [record.id for record in records] == [1, 2, 3, 4]
    assert [record.hollow for record in records] == [False, False, True, False]
    for record, one in zip(records, found, strict=True):
        mask = read_picture(tmp_path / record.mask)
        assert np.array_equal(mask > 0, one.mask)
        assert (tmp_path / record.crop).is_file()
    labels = read_picture(tmp_path / "scene/masks.png")
    assert np.array_equal(labels, rendered.labels)


def test_the_annotated_photo_marks_the_candidates_only(rendered: Rendered) -> None:
    table = find_table(rendered.frame, np.random.default_rng(0))
    picture = draw_candidate_overlay(
        rendered.frame, {one.id: one.mask for one in measure_candidates(rendered.frame, table, rendered.labels)}
    )
    assert picture.shape == rendered.frame.rgb.shape
    assert np.array_equal(picture[:20], rendered.frame.rgb[:20])
    assert (picture != rendered.frame.rgb)[rendered.labels > 0].any(axis=-1).mean() > 0.9


def test_the_annotated_photo_of_a_large_one_is_smaller_and_marks_the_same(rendered: Rendered) -> None:
    frame, labels = rendered.frame, rendered.labels
    large = replace(frame, **{name: getattr(frame, name).repeat(4, 0).repeat(4, 1) for name in ("rgb", "depth")})
    masks = {number: labels == number for number in range(1, 5)}
    picture = draw_candidate_overlay(large, {number: mask.repeat(4, 0).repeat(4, 1) for number, mask in masks.items()})
    assert max(picture.shape) == 1280
    plain = cv2.resize(frame.rgb, picture.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    changed = np.asarray((np.abs(picture.astype(int) - plain) > 8).any(axis=-1))
    seen = cv2.resize((labels > 0).astype(np.uint8), picture.shape[1::-1], interpolation=cv2.INTER_NEAREST).view(bool)
    assert changed[seen].mean() > 0.9
    assert changed[: picture.shape[0] // 20].mean() < 0.05
