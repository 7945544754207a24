"""Describer and matcher: colours from pictures, plausibility from sizes, and no asset rather than a wrong one."""

import base64
import json
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from langchain_core.messages import HumanMessage

from grs_agents.models.offline.chat import OfflineChatModel
from tests.models.conftest import Json, render
from tests.models.roles import block

ASSETS: list[Json] = [
    {"name": f"HOPE/{name}.urdf", "description": description, "color": color, "category": category, "size": size}
    for name, description, color, category, size in (
        ("Milk", "a white and blue carton of milk", "white", "carton", [0.073, 0.072, 0.19]),
        ("Corn", "a yellow can of corn", "yellow", "can", [0.071, 0.066, 0.058]),
        ("Peas", "a green can of peas", "green", "can", [0.071, 0.066, 0.058]),
        ("Beans", "a green can of beans", "green", "can", [0.071, 0.066, 0.058]),
        ("Raisins", "a purple box of raisins", "purple", "box", [0.04, 0.086, 0.123]),
    )
]


def ask(role: str, values: dict[str, str], image: np.ndarray | None = None) -> Json:
    blocks: list[str | dict[Any, Any]] = []
    if image is not None:
        data = base64.b64encode(cv2.imencode(".png", image)[1].tobytes()).decode()
        blocks.append({"type": "image", "base64": data, "mime_type": "image/png"})
    blocks.append({"type": "text", "text": render(role, values)})
    results: Json = json.loads(block(str(OfflineChatModel().invoke([HumanMessage(content=blocks)]).text), "json"))
    return results


def measured(size: tuple[float, float, float], rgb: tuple[float, float, float], outline: str = "box") -> Json:
    return {"id": 1, "size_m": list(size), "mean_color_rgb": list(rgb), "outline": outline, "pixels": 900}


def described(size: tuple[float, float, float], color: str, what: str = "box") -> Json:
    text = {"description": f"A {color} {what}", "color": color, "shape": what, "category": what}
    return {**measured(size, (0.5, 0.5, 0.5)), **text}


def crop(bgr: tuple[int, int, int]) -> np.ndarray:
    """An object of one colour in a dark brown margin."""
    image = np.full((90, 90, 3), (25, 40, 60), np.uint8)
    image[20:70, 20:70] = bgr
    return image


@pytest.mark.parametrize(
    ("bgr", "name"),
    [((40, 40, 215), "red"), ((200, 90, 40), "blue"), ((60, 160, 50), "green"), ((240, 240, 240), "white")],
)
def test_the_colour_comes_from_the_object_not_from_the_dark_margin(bgr: tuple[int, int, int], name: str) -> None:
    rgb = (bgr[2] / 255, bgr[1] / 255, bgr[0] / 255)
    words = ask("describe", {"pictures": "", "segments": json.dumps(measured((0.1, 0.1, 0.1), rgb))}, crop(bgr))
    assert words["color"] == name
    assert name in words["description"]
    assert words["is_object"] is True


@pytest.mark.parametrize("size", [(0.2, 0.2, 0.003), (0.005, 0.3, 0.1), (0.9, 0.5, 0.2)])
def test_slivers_and_furniture_are_no_objects(size: tuple[float, float, float]) -> None:
    assert (
        ask("describe", {"pictures": "", "segments": json.dumps(measured(size, (0.5, 0.5, 0.5)))})["is_object"] is False
    )
    asked = {"segments": json.dumps(described(size, "gray")), "assets": "", "pictures": ""}
    assert ask("match", asked)["match"] == "no_object"


@settings(max_examples=40, deadline=None)
@given(
    size=st.tuples(*[st.floats(0.001, 1.0)] * 3),
    rgb=st.tuples(*[st.floats(0, 1)] * 3),
    outline=st.sampled_from(("box", "cylinder", "weird")),
)
def test_every_measurement_gets_a_whole_description(
    size: tuple[float, float, float], rgb: tuple[float, float, float], outline: str
) -> None:
    words = ask("describe", {"pictures": "", "segments": json.dumps(measured(size, rgb, outline))})
    assert {"id", "is_object", "description", "color", "shape", "category"} <= set(words)
    assert all(words[key] for key in ("description", "color", "shape", "category"))


def match(candidate: Json) -> Json:
    lines = "\n".join(json.dumps(asset) for asset in ASSETS)
    return ask("match", {"segments": json.dumps(candidate), "assets": lines, "pictures": ""})


def test_the_asset_of_the_same_size_shape_and_colour_is_named() -> None:
    assert match(described((0.04, 0.084, 0.125), "purple"))["asset"] == "HOPE/Raisins.urdf"
    assert match(described((0.07, 0.066, 0.057), "yellow", "can"))["asset"] == "HOPE/Corn.urdf"


def test_an_object_seen_from_one_side_is_matched_though_it_measures_short() -> None:
    assert match(described((0.03, 0.084, 0.123), "purple"))["asset"] == "HOPE/Raisins.urdf"


def test_lying_objects_are_matched() -> None:
    assert match(described((0.12, 0.086, 0.04), "purple"))["asset"] == "HOPE/Raisins.urdf"


@pytest.mark.parametrize(
    "candidate",
    [
        described((0.04, 0.084, 0.125), "red"),
        described((0.04, 0.084, 0.18), "purple"),
        described((0.07, 0.066, 0.058), "green", "can"),
        described((0.2, 0.2, 0.2), "white"),
    ],
    ids=["colour", "height", "two alike", "size"],
)
def test_no_asset_rather_than_a_wrong_one(candidate: Json) -> None:
    words = match(candidate)
    assert words["match"] == "no_asset"
    assert words["asset"] is None
    assert words["reason"]
