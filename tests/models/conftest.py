"""Scenes, prompts and a scripted server for the tests of the chat models."""

import json
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import pytest
from hypothesis import strategies as st

from grs_agents.base import content
from tests.chat_server import Answer, Json, chat_server, completion

COLORS = ("red", "green", "blue", "yellow", "white", "brown")
CATEGORIES = ("box", "can", "bottle", "cube", "bowl", "object")


def render(role: str, values: Mapping[str, str]) -> str:
    """The prompt of a role, filled in."""
    text = content.content_path("prompts", role).read_text(encoding="utf-8")
    return re.sub(r"\{\{\s*([a-z_]+)\s*\}\}", lambda found: values[found.group(1)], text)


def scene_object(
    name: str,
    center: tuple[float, float],
    size: tuple[float, float, float],
    color: str = "red",
    category: str = "box",
    asset: str = "",
    height: float | None = None,
    reachable: bool = True,
) -> Json:
    """One object as the scene section of a prompt lists it."""
    z = size[2] / 2 if height is None else height
    position = (*center, z)
    return {
        "name": name,
        "asset": asset or f"proxy/{name}.urdf",
        "description": f"a {color} {category}",
        "category": category,
        "color": color,
        "position": list(position),
        "orientation": [0.0, 0.0, 0.0, 1.0],
        "size": list(size),
        "box": {
            "low": [c - e / 2 for c, e in zip(position, size, strict=True)],
            "high": [c + e / 2 for c, e in zip(position, size, strict=True)],
        },
        "reachable": reachable,
        "hollow": category == "bowl",
    }


def rich_scene() -> Json:
    """Eight free-standing things of several kinds and colours; beyond them there is room for targets."""
    return {
        "objects": [
            scene_object("red_box_1", (0.34, -0.30), (0.10, 0.12, 0.05), "red"),
            scene_object("red_can_1", (0.36, -0.12), (0.07, 0.07, 0.08), "red", "can"),
            scene_object("blue_box_1", (0.36, 0.06), (0.08, 0.08, 0.04), "blue"),
            scene_object("blue_can_1", (0.34, 0.22), (0.066, 0.066, 0.06), "blue", "can"),
            scene_object("green_cube_1", (0.49, 0.15), (0.04, 0.04, 0.04), "green", "cube"),
            scene_object("green_box_1", (0.52, -0.05), (0.05, 0.09, 0.12), "green"),
            scene_object("yellow_cube_1", (0.50, -0.22), (0.05, 0.05, 0.05), "yellow", "cube"),
            scene_object("white_carton_1", (0.34, 0.38), (0.07, 0.07, 0.16), "white", "carton"),
        ]
    }


@st.composite
def scenes(draw: Callable[..., Any]) -> Json:
    """Any scene: 1 to 20 things of 1 to 40 cm, overlapping, stacked, tall, thin, out of reach."""
    count = draw(st.integers(1, 20))
    extent = st.floats(0.01, 0.4)
    objects: list[Json] = []
    for number in range(count):
        size = (draw(extent), draw(extent), draw(extent))
        center = (draw(st.floats(0.0, 1.2)), draw(st.floats(-0.9, 0.9)))
        lifted = draw(st.sampled_from((0.0, 0.0, 0.0, 0.06)))
        objects.append(
            scene_object(
                f"thing_{number}",
                center,
                size,
                draw(st.sampled_from(COLORS)),
                draw(st.sampled_from(CATEGORIES)),
                asset=draw(st.sampled_from(("", "HOPE/Corn.urdf", "block/red_block.urdf"))),
                height=size[2] / 2 + lifted,
                reachable=draw(st.booleans()),
            )
        )
    return {"objects": objects}


class Scripted:
    """A server on loopback that gives prepared (status, headers, body) answers, the last one for ever."""

    def __init__(self) -> None:
        self.answers: list[Answer] = []
        self.requests: list[tuple[str, Json]] = []

    def say(self, status: int, body: Json | bytes, **headers: str) -> None:
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        self.answers.append((status, named, data))

    def complete(self, text: str | None = "hello", finish: str | None = "stop", **message: Any) -> None:
        usage = {"prompt_tokens": 11, "completion_tokens": 5, "total_tokens": 16}
        self.say(200, completion({"content": text, **message}, usage, finish))

    def answer(self, body: Json, authorization: str) -> Answer:
        """The next prepared answer."""
        self.requests.append((authorization, body))
        return self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]


@pytest.fixture
def server() -> Iterator[tuple[Scripted, str]]:
    """A scripted OpenAI-compatible server and its base URL."""
    script = Scripted()
    with chat_server(script.answer) as url:
        yield script, url
