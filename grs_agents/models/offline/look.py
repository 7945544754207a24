"""The roles that look: the describer and the matcher."""

import base64
import json
import math
from collections.abc import Sequence
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt
from langchain_core.messages import HumanMessage

from grs_agents.models.offline.text import Json, PromptText, words
from grs_agents.models.offline.things import COLORS, numbers

Image = npt.NDArray[np.uint8]
SLIVER = 0.006
"""Nothing thinner than this is taken for an object, metres."""
SIZE_TOLERANCE, SIZE_SLACK = 0.15, 0.006
"""How far a measured extent may be from an asset's: this share of it plus this many metres."""
_BANDS = (
    (8, "red"),
    (20, "orange"),
    (34, "yellow"),
    (82, "green"),
    (128, "blue"),
    (158, "purple"),
    (172, "pink"),
    (181, "red"),
)
"""Upper hue (OpenCV's half degrees) of each colour name."""
_ROUND = frozenset({"cylinder", "can", "bottle", "jar", "canister", "tub", "mug", "cup", "bowl", "plate", "sphere"})


def images(message: HumanMessage) -> list[bytes]:
    """The pictures in a message, as encoded files, in their order."""
    blocks = cast(list[Any], message.content) if isinstance(message.content, list) else []
    found: list[bytes] = []
    for block in blocks:
        if isinstance(block, dict):
            data = cast(Json, block).get("base64")
            if isinstance(data, str):
                found.append(base64.b64decode(data))
    return found


def describe(prompt: PromptText, pictures: Sequence[bytes]) -> str:
    """Reply to the ``describe`` prompt from the measurements and the crop's colours."""
    measured = prompt.json("measurements")
    size = _size(measured)
    names = _colors(measured, pictures)
    shape = _shape(measured)
    category = _category(shape, size) if size else "object"
    is_object = size is None or _plausible(size, measured)
    what = category if category != "object" else shape
    extent = " x ".join(f"{100 * edge:.0f}" for edge in size) + " cm" if size else "unknown size"
    second = f" with some {names[1]}" if len(names) > 1 else ""
    description = f"A {_build(size)}{names[0]} {what}{second}, {shape}-shaped, about {extent}."
    if not is_object:
        description = f"A {names[0]} segment of {extent}, too thin or too large to be an object."
    return _fenced(
        {
            "is_object": is_object,
            "description": description,
            "color": names[0],
            "shape": shape,
            "category": category,
        }
    )


def match(prompt: PromptText) -> str:
    """Reply to the ``match`` prompt: the asset of the same size, colour and shape, if there is exactly one."""
    candidate = prompt.json("candidate")
    size = _size(candidate)
    if candidate.get("is_object") is False or (size is not None and not _plausible(size, candidate)):
        return _fenced({"match": "no_object", "asset": None, "reason": "the segment is no plausible object"})
    told = " ".join(str(candidate.get(key, "")) for key in ("description", "category", "shape"))
    color = str(candidate.get("color_name") or candidate.get("color") or "").lower()
    scores: list[tuple[float, str]] = []
    for asset in prompt.rows("assets"):
        extent = numbers(asset.get("size"), 3)
        if size and extent and _same_build(told, asset) and color == str(asset.get("color", "")).lower():
            difference = _difference(size, extent)
            if difference <= 1.0:
                scores.append((difference, str(asset.get("name"))))
    scores.sort()
    if not scores:
        return _fenced({"match": "no_asset", "asset": None, "reason": f"no {color} asset of this size and shape"})
    if len(scores) > 1 and scores[1][0] < scores[0][0] + 0.25:
        names = " and ".join(name for _, name in scores[:3])
        return _fenced({"match": "no_asset", "asset": None, "reason": f"{names} fit equally well"})
    reason = f"same colour and shape; extents differ by {100 * SIZE_TOLERANCE * scores[0][0]:.0f} % at most"
    return _fenced({"match": "asset", "asset": scores[0][1], "reason": reason})


def color_names(image: Image) -> list[str]:
    """The names of the one or two dominant colours in the middle of a BGR picture."""
    height, width = image.shape[:2]
    top, left = height // 6, width // 6
    middle = image[top : height - top, left : width - left]
    pixels = cv2.cvtColor(middle, cv2.COLOR_BGR2HSV).reshape(-1, 3)
    counts: dict[str, int] = {}
    for hue, saturation, value in pixels[:: max(1, len(pixels) // 4000)]:
        name = color_name(int(hue), int(saturation), int(value))
        counts[name] = counts.get(name, 0) + 1
    ranked = sorted(counts, key=lambda name: (-counts[name], name))
    total = sum(counts.values())
    return [name for name in ranked[:2] if counts[name] >= 0.2 * total] or ranked[:1]


def color_name(hue: int, saturation: int, value: int) -> str:
    """The plain name of an OpenCV HSV colour (hue 0..179, others 0..255)."""
    if value < 50:
        return "black"
    if saturation < 45:
        return "white" if value > 175 else "gray"
    if 5 <= hue < 22 and value < 130:
        return "brown"
    return next(name for limit, name in _BANDS if hue < limit)


def _colors(measured: Json, pictures: Sequence[bytes]) -> list[str]:
    name = str(measured.get("color_name") or measured.get("color") or "").lower()
    if name in COLORS:
        return [name]
    rgb = numbers(measured.get("color"), 3)
    if rgb:
        pixel = np.array([[[255 * min(1.0, max(0.0, part)) for part in reversed(rgb)]]], np.uint8)
        return [color_name(*(int(part) for part in cv2.cvtColor(pixel, cv2.COLOR_BGR2HSV)[0, 0]))]
    image = cv2.imdecode(np.frombuffer(pictures[0], np.uint8), cv2.IMREAD_COLOR) if pictures else None
    return color_names(cast(Image, image)) if image is not None else ["gray"]


def _size(measured: Json) -> tuple[float, ...] | None:
    return numbers(measured.get("size"), 3)


def _shape(measured: Json) -> str:
    shape = str(measured.get("shape") or "box").lower()
    return shape if shape in (*_ROUND, "box") else "box"


def _plausible(size: Sequence[float], measured: Json) -> bool:
    points = measured.get("points")
    seen = not isinstance(points, int | float) or points >= 30
    low, middle, high = sorted(size)
    return seen and low >= SLIVER and middle >= 0.012 and high <= 0.6 and high <= 25 * low


def _category(shape: str, size: Sequence[float]) -> str:
    across, height = max(size[:2]), size[2]
    if shape in ("cylinder", "sphere"):
        if across > 0.1:
            return "plate" if height < 0.035 else "bowl" if height < 0.09 else "canister"
        return "bottle" if height > 2 * across else "can"
    if shape != "box":
        return shape
    even = max(size) <= 1.25 * min(size)
    if even and max(size) <= 0.07:
        return "cube"
    return "carton" if height >= 2 * across and height > 0.12 else "box"


def _build(size: Sequence[float] | None) -> str:
    if size is None:
        return ""
    across = max(size[:2])
    return "tall " if size[2] > 1.6 * across else "flat " if size[2] < 0.45 * across else ""


def _same_build(told: str, asset: Json) -> bool:
    """Whether what was told and the asset are both round or both angular."""
    kind = {*words(str(asset.get("category", ""))), *words(str(asset.get("description", "")))}
    return bool({*words(told)} & _ROUND) == bool(kind & _ROUND)


def _difference(measured: Sequence[float], extent: Sequence[float]) -> float:
    """The largest difference of the sorted extents in units of the tolerance."""
    pairs = zip(sorted(measured), sorted(extent), strict=True)
    return max(math.fabs(a - b) / (SIZE_TOLERANCE * b + SIZE_SLACK) for a, b in pairs)


def _fenced(value: Json) -> str:
    return f"```json\n{json.dumps(value, ensure_ascii=False)}\n```"
