"""Masks of annotation tools: the same two things as COCO, as LabelMe and as a picture of labels."""

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image as Pillow

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.foreign_scene import read_foreign_masks
from grs_agents.perception.reading.masks import GivenMasks, read_masks
from tests.perception.reading.conftest import Truth, png, write

SHAPE = (36, 48)
BOXES = {"mug": (10, 10, 25, 20), "bowl": (30, 25, 40, 30)}
"""Left, top, right and bottom edge of the things in `Truth.labels`, in pixels from the picture's corner."""


def polygon(name: str) -> list[float]:
    left, top, right, bottom = BOXES[name]
    return [left, top, right, top, right, bottom, left, bottom]


def mask(truth: Truth, name: str) -> npt.NDArray[np.bool_]:
    return truth.labels == (3 if name == "mug" else 7)


def runs(pixels: npt.NDArray[np.bool_]) -> list[int]:
    """Lengths of runs of pixels outside and inside in turn, down the columns."""
    flat = pixels.ravel(order="F")
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flat]).astype(np.int8)))
    return np.diff(np.concatenate([[0], edges, [len(flat)]])).tolist()


def packed(lengths: list[int]) -> str:
    """COCO's compressed run lengths: five bits a character, as differences from the third on."""
    text = ""
    for number, length in enumerate(lengths):
        value = length - (lengths[number - 2] if number > 2 else 0)
        while True:
            bits, value = value & 31, value >> 5
            more = not ((value == 0 and not bits & 16) or (value == -1 and bits & 16))
            text += chr(48 + bits + 32 * more)
            if not more:
                break
    return text


def coco(truth: Truth, form: str, **changes: Any) -> dict[str, Any]:
    def outline(name: str) -> Any:
        lengths = runs(mask(truth, name))
        size = list(SHAPE)
        return {
            "polygon": [polygon(name)],
            "runs": {"size": size, "counts": lengths},
            "packed": {"size": size, "counts": packed(lengths)},
        }[form]

    items = [
        {"id": 7 + number, "image_id": 5, "category_id": 3 - number, "segmentation": outline(name), "iscrowd": 0}
        for number, name in enumerate(BOXES)
    ]
    return {
        "images": [
            {"id": 4, "file_name": "other.png", "width": 48, "height": 36},
            {"id": 5, "file_name": "images/rgb.png", "width": 48, "height": 36},
        ],
        "categories": [{"id": 3, "name": "mug"}, {"id": 2, "name": "bowl"}],
        "annotations": [*items, {"id": 1, "image_id": 4, "category_id": 3, "segmentation": [[0, 0, 9, 0, 9, 9]]}],
        **changes,
    }


def labelme(truth: Truth, form: str, **changes: Any) -> dict[str, Any]:
    shapes: list[dict[str, Any]] = []
    for name, (left, top, right, bottom) in BOXES.items():
        points: list[Any] = np.reshape(polygon(name), (-1, 2)).tolist()
        shape: dict[str, Any] = {"label": name, "group_id": None, "shape_type": form}
        if form == "rectangle":
            points = [[right, bottom], [left, top]]
        if form == "mask":
            points = [[left, top], [right - 1, bottom - 1]]
            shape["mask"] = base64.b64encode(png(np.full((bottom - top, right - left), 255, np.uint8))).decode()
        shapes.append({**shape, "points": points})
    shapes.append({"label": "note", "points": [[1, 1]], "shape_type": "point"})
    return {"shapes": shapes, "imagePath": "rgb.png", "imageHeight": 36, "imageWidth": 48, **changes}


def given_beside(folder: Path, truth: Truth, name: str, values: object) -> Path:
    """A scene folder of a photo and an annotation file."""
    write(folder, None, rgb__png=png(truth.rgb))
    (folder / name).write_text(json.dumps(values))
    return folder


def assert_same(masks: GivenMasks, truth: Truth) -> None:
    assert set(masks.names) == set(BOXES)
    for number, name in enumerate(masks.names, start=1):
        assert ((masks.labels == number) == mask(truth, name)).all()


FORMS: dict[str, tuple[str, Callable[[Truth], object]]] = {
    **{
        f"coco {form}": ("_annotations.coco.json", lambda truth, form=form: coco(truth, form))
        for form in ("polygon", "runs", "packed")
    },
    **{
        f"labelme {form}": ("rgb.json", lambda truth, form=form: labelme(truth, form))
        for form in ("polygon", "rectangle", "mask")
    },
    "instances": ("instances_default.json", lambda truth: coco(truth, "polygon")),
    "masks.json": ("masks.json", lambda truth: labelme(truth, "polygon")),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_tells_the_same(tmp_path: Path, truth: Truth, form: str) -> None:
    name, values = FORMS[form]
    folder = given_beside(tmp_path, truth, name, values(truth))
    assert_same(read_masks(folder, SHAPE), truth)
    assert_same(read_masks(folder / "rgb.png", SHAPE), truth)


def test_run_lengths_are_exact_and_names_pass_the_worker(tmp_path: Path, truth: Truth) -> None:
    masks = read_foreign_masks(given_beside(tmp_path, truth, "annotations.json", coco(truth, "packed")), SHAPE)
    assert masks.names == ("mug", "bowl")
    assert ((masks.labels == 1) == mask(truth, "mug")).all() and ((masks.labels == 2) == mask(truth, "bowl")).all()


@given(data=st.data())
def test_packed_run_lengths_of_any_mask_are_exact(
    tmp_path_factory: pytest.TempPathFactory, truth: Truth, data: Any
) -> None:
    seed = data.draw(st.integers(0, 10**6))
    pixels = np.random.default_rng(seed).random(SHAPE) < data.draw(st.sampled_from([0.02, 0.5, 0.98]))
    pixels[0, 0] |= not pixels.any()
    values = coco(truth, "packed")
    values["annotations"] = [
        {"image_id": 5, "category_id": 3, "segmentation": {"size": list(SHAPE), "counts": packed(runs(pixels))}}
    ]
    folder = given_beside(tmp_path_factory.mktemp("coco"), truth, "annotations.json", values)
    assert ((read_masks(folder, SHAPE).labels > 0) == pixels).all()


def test_circles_groups_and_crowds(tmp_path: Path, truth: Truth) -> None:
    circle = {"label": "plate", "points": [[20, 18], [28, 18]], "shape_type": "circle"}
    parts = [
        {"label": "tray", "group_id": 4, "points": [[left, 2], [left + 4, 2], [left + 4, 6], [left, 6]]}
        for left in (1, 40)
    ]
    folder = given_beside(tmp_path / "a", truth, "rgb.json", labelme(truth, "polygon", shapes=[circle, *parts]))
    masks = read_masks(folder, SHAPE)
    assert masks.names == ("plate", "tray")
    assert abs(int((masks.labels == 1).sum()) - np.pi * 64) < 30
    assert masks.labels[4, 3] == masks.labels[4, 42] == 2
    values = coco(truth, "runs")
    values["annotations"][1]["iscrowd"] = 1
    assert read_masks(given_beside(tmp_path / "b", truth, "coco.json", values), SHAPE).names == ("mug",)


def test_masks_come_to_the_size_of_the_frame(tmp_path: Path, truth: Truth) -> None:
    folder = given_beside(tmp_path, truth, "annotations.json", coco(truth, "runs"))
    labels = read_masks(folder, (72, 96)).labels
    assert ((labels > 0) == np.repeat(np.repeat(truth.labels > 0, 2, 0), 2, 1)).all()


def test_masks_of_a_person_go_before_annotations(tmp_path: Path, truth: Truth) -> None:
    folder = given_beside(tmp_path, truth, "annotations.json", coco(truth, "runs"))
    (folder / "masks.png").write_bytes(png((truth.labels == 3).astype(np.uint8)))
    assert read_masks(folder, SHAPE).labels.max() == 1


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"images": []}, "annotates 0 pictures"),
        (
            {"images": [{"id": 5, "file_name": name} for name in ("a.png", "b.png")]},
            r"annotates 2 pictures \(a.png, b.png\)",
        ),
        (
            {"images": [{"id": 5, "file_name": "rgb.png", "width": 10**9, "height": 10**9}]},
            "the picture is 1000000000x",
        ),
        ({"images": [{"id": 5, "file_name": "rgb.png", "width": "wide"}]}, "the picture is wide"),
        ({"annotations": []}, "no polygon and no mask"),
        ({"annotations": [{"image_id": 5, "segmentation": [["a", "b"]]}]}, "no pairs of numbers"),
        ({"annotations": [{"image_id": 5, "segmentation": [[1, 2, 3]]}]}, "no pairs of numbers"),
        ({"annotations": [{"image_id": 5, "segmentation": [[1e999, 2, 3, 4, 5, 6]]}]}, "not finite"),
        (
            {"annotations": [{"image_id": 5, "segmentation": {"size": [36, 48], "counts": [5, 10**12]}}]},
            "run lengths of",
        ),
        (
            {"annotations": [{"image_id": 5, "segmentation": {"size": [36, 48], "counts": [2000, -272]}}]},
            "run lengths of",
        ),
        ({"annotations": [{"image_id": 5, "segmentation": {"size": [48, 36], "counts": [1728]}}]}, "run lengths of"),
        ({"annotations": [{"image_id": 5, "segmentation": {"size": [36, 48], "counts": "o" * 99}}]}, "run lengths of"),
        (
            {"annotations": [{"image_id": 5, "segmentation": {"size": [36, 48], "counts": "\u20ac\x00"}}]},
            "run lengths of",
        ),
        ({"annotations": [{"image_id": 5, "segmentation": [[0, 0, 1, 0, 1, 1]]}] * 300}, "outlines 300 things"),
    ],
    ids=lambda value: str(value)[:60],
)
def test_an_odd_data_set_is_named(tmp_path: Path, truth: Truth, change: dict[str, Any], word: str) -> None:
    with pytest.raises(InputError, match=word):
        read_masks(given_beside(tmp_path, truth, "annotations.json", coco(truth, "runs", **change)), SHAPE)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"imageHeight": None}, "the picture is 48xNone"),
        ({"shapes": []}, "no polygon and no mask"),
        ({"shapes": [{"shape_type": "circle", "points": [[1, 2]]}]}, "a circle of 1 points"),
        ({"shapes": [{"points": None}]}, "no pairs of numbers"),
        ({"shapes": [{"shape_type": "mask", "points": [[1, 1], [2, 2]], "mask": "??"}]}, "not base64"),
        ({"shapes": [{"shape_type": "mask", "points": [[1, 1], [2, 2]], "mask": "AAAA"}]}, "not a readable picture"),
        (
            {
                "shapes": [
                    {
                        "shape_type": "mask",
                        "points": [[99, 1], [2, 2]],
                        "mask": base64.b64encode(png(np.ones((2, 2), np.uint8))).decode(),
                    }
                ]
            },
            "outside the picture",
        ),
    ],
    ids=lambda value: str(value)[:60],
)
def test_odd_shapes_are_named(tmp_path: Path, truth: Truth, change: dict[str, Any], word: str) -> None:
    with pytest.raises(InputError, match=word):
        read_masks(given_beside(tmp_path, truth, "rgb.json", labelme(truth, "polygon", **change)), SHAPE)


@pytest.mark.parametrize("content", [b"", b"[]", b"{}", b"\xff", b"[" * 9999, b'{"images": 3, "annotations": []}'])
def test_what_is_no_annotation_is_named(tmp_path: Path, truth: Truth, content: bytes) -> None:
    folder = given_beside(tmp_path, truth, "annotations.json", {})
    (folder / "annotations.json").write_bytes(content)
    with pytest.raises(InputError, match=r"annotations\.json"):
        read_masks(folder, SHAPE)


def test_names_are_cleaned(tmp_path: Path, truth: Truth) -> None:
    categories = [{"id": 3, "name": "\x1b[2J mug \n" + "x" * 500}, {"id": 2, "name": 7}]
    names = read_masks(
        given_beside(tmp_path, truth, "coco.json", coco(truth, "runs", categories=categories)), SHAPE
    ).names
    assert names[0].startswith("\\x1b[2J mug x") and len(names[0]) == 60 and names[1] == ""


def test_the_void_of_a_palette_and_colours_as_labels(tmp_path: Path, truth: Truth) -> None:
    numbers = truth.labels.copy()
    numbers[20:22, 10:25] = 255
    picture = Pillow.fromarray(numbers).convert("P")
    palette = np.zeros((256, 3), np.uint8)
    palette[3], palette[7], palette[255] = (128, 0, 0), (0, 128, 0), (224, 224, 192)
    picture.putpalette(palette.tobytes())
    (tmp_path / "voc").mkdir()
    picture.save(tmp_path / "voc/labels.png")
    write(tmp_path / "colours", None, labels__png=png(palette[numbers]))
    write(tmp_path / "ids", None, labels__png=png(numbers.astype(np.uint16) * 200))
    for name in ("voc", "colours"):
        assert ((read_masks(tmp_path / name, SHAPE).labels > 0) == (truth.labels > 0)).all()
    assert read_masks(tmp_path / "ids", SHAPE).labels.max() == 3  # a plain picture has no void
    with pytest.raises(InputError, match=r"labels\.png has \d+ colours, more than 256"):
        read_masks(write(tmp_path / "photo", None, labels__png=png(truth.rgb)), SHAPE)
