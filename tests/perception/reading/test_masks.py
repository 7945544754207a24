"""Masks that come with a scene become one picture of numbers from 1."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.masks import read_masks
from tests.perception.reading.conftest import FORMS, Truth, npy_of, png, write, write_npz

SHAPE = (36, 48)


def stack(truth: Truth) -> Any:
    return np.stack([truth.labels == 7, truth.labels == 3])


def folder_of(folder: Path, truth: Truth) -> Path:
    write(
        folder / "masks",
        None,
        **{f"{number}__png": png(mask.astype(np.uint8)) for number, mask in enumerate(stack(truth))},
    )
    return folder


GIVEN = {
    "masks.png": lambda folder, truth: write(folder, masks__png=png(truth.labels)),
    "labels.png": lambda folder, truth: write(folder, labels__png=png(truth.labels.astype(np.uint16))),
    "as RGB": lambda folder, truth: write(folder, masks__png=png(np.repeat(truth.labels[..., None], 3, axis=2))),
    "numbers": lambda folder, truth: write(folder, masks__npy=npy_of(truth.labels, folder)),
    "stack": lambda folder, truth: write(folder, masks__npy=npy_of(stack(truth), folder)),
    "folder": folder_of,
    "npz": lambda folder, truth: write_npz(folder / "a.npz", truth),
    "npz stack": lambda folder, truth: write_npz(folder / "a.npz", truth, masks=stack(truth)),
    "bop": FORMS["bop"],
}


@pytest.mark.parametrize("form", GIVEN)
def test_every_form_tells_the_same(tmp_path: Path, truth: Truth, form: str) -> None:
    labels = read_masks(GIVEN[form](tmp_path, truth), SHAPE).labels
    assert set(np.unique(labels)) == {0, 1, 2}
    assert ((labels > 0) == (truth.labels > 0)).all()
    assert len({int(number) for number in labels[truth.labels == 3]}) == 1


def test_masks_come_to_the_size_of_the_frame(tmp_path: Path, truth: Truth) -> None:
    labels = read_masks(write(tmp_path, masks__png=png(truth.labels)), (72, 96)).labels
    assert ((labels > 0) == np.repeat(np.repeat(truth.labels > 0, 2, 0), 2, 1)).all()


def test_the_smaller_of_two_masks_is_on_top(tmp_path: Path, truth: Truth) -> None:
    small, large = np.zeros((2, *SHAPE), bool)
    small[10:15, 10:15], large[5:30, 5:30] = True, True
    labels = read_masks(write_npz(tmp_path / "a.npz", truth, masks=np.stack([small, large])), SHAPE).labels
    assert len(np.unique(labels[small])) == 1 and labels[12, 12] != labels[20, 20]


@pytest.mark.parametrize(
    ("masks", "word"),
    [
        (np.zeros(SHAPE, np.uint8), "0 objects"),
        (np.zeros((0, *SHAPE), bool), "empty"),
        (np.zeros((2, *SHAPE), bool), "0 objects"),
        (np.ones((300, *SHAPE), bool), "300 masks"),
        (np.arange(36 * 48).reshape(SHAPE), "1727 objects"),
        (np.ones((36, 36), np.uint8), "36x36"),
        (np.ones(SHAPE), "float64"),
        (np.full(SHAPE, -1), "-1"),
        (np.full(SHAPE, 2**40), "1099511627776"),
        (np.full(SHAPE, 2**64 - 1, np.uint64), "18446744073709551615"),
        (np.ones(3, np.uint8), "shape"),
    ],
    ids=lambda value: str(value)[:20],
)
def test_what_are_no_masks_is_named(tmp_path: Path, truth: Truth, masks: Any, word: str) -> None:
    with pytest.raises(InputError, match=word):
        read_masks(write_npz(tmp_path / "a.npz", truth, masks=masks), SHAPE)


def test_no_masks_are_named(tmp_path: Path, truth: Truth) -> None:
    for source in (FORMS["folder"](tmp_path / "folder", truth), tmp_path / "folder/rgb.png"):
        with pytest.raises(InputError, match=r"no masks.*segment_rgbd"):
            read_masks(source, SHAPE)
    (tmp_path / "folder/masks.txt").write_bytes(b"1")
    with pytest.raises(InputError, match=r"masks\.txt"):
        read_masks(tmp_path / "folder", SHAPE)
    with pytest.raises(InputError, match="no masks"):
        read_masks(write_npz(tmp_path / "a.npz", truth, masks=None), SHAPE)
