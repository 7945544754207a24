"""The offline roles that look: the describer, the matcher, and the describer of 3D models by their measurements."""

import base64
import json
import re
from collections.abc import Iterator, Sequence
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt
from langchain_core.messages import HumanMessage

from grs_agents.library.colors import COLORS, color_name_from_rgb
from grs_agents.models.offline.prompt_text import Json, PromptText, parse_finite_floats, split_words

Image = npt.NDArray[np.uint8]
"""BGR, as OpenCV decodes it."""
MIN_THICKNESS = 0.006
"""Nothing thinner than this is taken for an object, metres."""
SIZE_SLACK = 0.005
"""Every measured extent may be wrong by this much (metres) and by a share of the asset's extent."""
SHORT_TOLERANCE, TOLERANCE = 0.33, 0.12
"""The share where it is too short across, since the camera sees one side only, and where it is not."""
MAX_DIFFERENCE = 0.9
"""The most that an asset may differ, 1 being the bounds above reached by every extent."""
LEAD = 0.2
"""How much better the best asset must be than the next."""
MIN_COLOR_SHARE = 0.05
"""The share of an object's pixels from which a second colour is worth telling."""
_ROUND_OR_ANGULAR = frozenset({"bottle", "jar", "canister", "tub"})
"""Kinds that look round or angular by the side one sees."""
_PLAIN = frozenset({"white", "gray", "black"})
_ROUND = frozenset({"cylinder", "can", "bottle", "jar", "canister", "tub", "mug", "cup", "bowl", "plate", "sphere"})


def extract_message_images(message: HumanMessage) -> list[bytes]:
    """The pictures in a message, as encoded files, in their order."""
    blocks = cast(list[Any], message.content) if isinstance(message.content, list) else []
    files = [cast(Json, block).get("base64") for block in blocks if isinstance(block, dict)]
    return [base64.b64decode(file) for file in files if isinstance(file, str)]


def describe_segments(prompt: PromptText, pictures: Sequence[bytes]) -> str:
    """Reply to the ``describe`` prompt from the measurements and the crop's colours; a sheet is not looked at."""
    segments = prompt.section_json_rows("segments")
    shown = pictures if len(segments) == 1 else ()
    return _format_json_block(*(_describe_segment(measured, shown) for measured in segments))


def _describe_segment(measured: Json, pictures: Sequence[bytes]) -> Json:
    """One segment, in the form that the prompt asks for."""
    size = _parse_measured_size(measured)
    names = _object_color_names(measured, pictures)
    shape = _parse_measured_shape(measured)
    category = _guess_category(shape, size) if size else "object"
    is_object = size is None or _is_plausible_object(size, measured)
    what = category if category != "object" else shape
    extent = " x ".join(f"{100 * edge:.0f}" for edge in size) + " cm" if size else "unknown size"
    second = f" with some {' and '.join(names[1:])}" if len(names) > 1 else ""
    description = f"A {_choose_tall_or_flat_word(size)}{names[0]} {what}{second}, {shape}-shaped, about {extent}."
    if not is_object:
        description = f"A {names[0]} segment of {extent}, too thin or too large to be an object."
    return {
        "id": measured.get("id"),
        "is_object": is_object,
        "part_of": None,
        "description": description,
        "color": names[0],
        "shape": shape,
        "category": category,
        "open_top": measured.get("open_top") is True,
    }


def match_asset(prompt: PromptText) -> str:
    """Reply to the ``match_asset`` prompt: the asset of the same size, colour and shape, if there is exactly one."""
    candidate = prompt.section_json("candidate")
    size = _parse_measured_size(candidate)
    if candidate.get("is_object") is False or (size is not None and not _is_plausible_object(size, candidate)):
        return _format_json_block({"match": "no_object", "asset": None, "reason": "the segment is no plausible object"})
    wording = " ".join(str(candidate.get(key, "")) for key in ("description", "category", "shape", "color"))
    scores = sorted(_score_asset_differences(size, wording, prompt.section_json_rows("assets"))) if size else []
    if not scores:
        return _format_json_block(
            {"match": "no_asset", "asset": None, "reason": "no asset of this size, shape and colour"}
        )
    if len(scores) > 1 and scores[1][0] < scores[0][0] + LEAD:
        names = " and ".join(name for _, name in scores[:3])
        return _format_json_block({"match": "no_asset", "asset": None, "reason": f"{names} fit equally well"})
    reason = f"size, shape and colours agree, at {100 * scores[0][0]:.0f} % of what is allowed to differ"
    return _format_json_block({"match": "asset", "asset": scores[0][1], "reason": reason})


def _score_asset_differences(
    size: Sequence[float], wording: str, assets: Sequence[Json]
) -> Iterator[tuple[float, str]]:
    """How much each asset differs that may be what was measured and described, and its name."""
    for asset in assets:
        extent = parse_finite_floats(asset.get("size"), 3)
        if extent and _has_same_roundness(wording, asset):
            difference = _score_size_difference(size, extent) + _score_color_difference(wording, asset)
            if difference <= MAX_DIFFERENCE:
                yield difference, str(asset.get("name"))


def dominant_color_names(image: Image, mean: Sequence[float] | None = None) -> list[str]:
    """The names of the dominant colours of an object in a crop, the largest first.

    The crop's margin is darker than the object; where it is not, its ``mean`` colour (RGB, 0..1) is used.
    """
    rgb = image[..., ::-1] / 255
    edge = np.concatenate([rgb[0], rgb[-1], rgb[:, 0], rgb[:, -1]]).max(axis=1)
    pixels = rgb.reshape(-1, 3)[:: max(1, image.shape[0] * image.shape[1] // 6000)]
    kept = pixels[pixels.max(axis=1) >= float(np.percentile(edge, 90)) + 0.04]
    if len(kept) < 0.1 * len(pixels):
        return [color_name_from_rgb((mean[0], mean[1], mean[2]))] if mean else ["gray"]
    lit = min(1.35, 0.95 / max(0.05, float(np.percentile(kept.max(axis=1), 95))))
    levels, amounts = np.unique(np.round(np.minimum(kept * max(1.0, lit), 1.0) * 20), axis=0, return_counts=True)
    shares: dict[str, float] = {}
    shaded: dict[str, float] = {}
    for level, amount in zip(levels, amounts, strict=True):
        red, green, blue = (float(part) / 20 for part in level)
        name, share = color_name_from_rgb((red, green, blue)), float(amount) / len(kept)
        shares[name] = shares.get(name, 0.0) + share
        if name == "brown":  # perhaps something red or orange in its own shade
            most = max(red, green, blue)
            lit_name = color_name_from_rgb((red / most, green / most, blue / most))
            shaded[lit_name] = shaded.get(lit_name, 0.0) + share
    for name, share in shaded.items():
        if shares.get(name, 0.0) > 0.5 * share:
            shares[name] += share
            shares["brown"] -= share
    ranked = sorted(shares, key=lambda name: (-shares[name], name))
    return ranked[:1] + [name for name in ranked[1:4] if shares[name] >= MIN_COLOR_SHARE]


def _object_color_names(measured: Json, pictures: Sequence[bytes]) -> list[str]:
    mean = parse_finite_floats(measured.get("mean_color_rgb"), 3)
    if mean and (not pictures or max(mean) < 0.3):
        return [color_name_from_rgb((mean[0], mean[1], mean[2]))]
    image = cv2.imdecode(np.frombuffer(pictures[0], np.uint8), cv2.IMREAD_COLOR) if pictures else None
    return dominant_color_names(cast(Image, image), mean) if image is not None else ["gray"]


def _parse_measured_size(measured: Json) -> tuple[float, ...] | None:
    return parse_finite_floats(measured.get("size_m"), 3)


def _parse_measured_shape(measured: Json) -> str:
    shape = str(measured.get("outline") or "box").lower()
    return shape if shape in (*_ROUND, "box") else "box"


def _is_plausible_object(size: Sequence[float], measured: Json) -> bool:
    points = measured.get("pixels")
    seen = not isinstance(points, int | float) or points >= 30
    low, middle, high = sorted(size)
    return seen and low >= MIN_THICKNESS and middle >= 0.012 and high <= 0.6 and high <= 25 * low


def _guess_category(shape: str, size: Sequence[float]) -> str:
    across, height = max(size[:2]), size[2]
    if shape in ("cylinder", "sphere"):
        if across > 0.1:
            return "plate" if height < 0.035 else "bowl" if height < 0.09 else "canister"
        return "bottle" if height > 2 * across else "can"
    if shape != "box":
        return shape
    if max(size) <= min(0.07, 1.25 * min(size)):
        return "cube"
    return "carton" if height >= 2 * across and height > 0.12 else "box"


def _choose_tall_or_flat_word(size: Sequence[float] | None) -> str:
    if size is None:
        return ""
    across = max(size[:2])
    return "tall " if size[2] > 1.6 * across else "flat " if size[2] < 0.45 * across else ""


def _has_same_roundness(wording: str, asset: Json) -> bool:
    """Whether the wording and the asset are both round or both angular, as far as that can be seen."""
    if asset.get("category") in _ROUND_OR_ANGULAR:
        return True
    kind = {*split_words(str(asset.get("category", ""))), *split_words(str(asset.get("description", "")))}
    return bool({*split_words(wording)} & _ROUND) == bool(kind & _ROUND)


def _score_size_difference(measured: Sequence[float], extent: Sequence[float]) -> float:
    """How far the extents disagree, 1 being the most that is allowed; an asset may stand on any of its sides."""
    across = sorted(measured[:2])
    best = 10.0
    for axis in range(3):
        rest = sorted(edge for number, edge in enumerate(extent) if number != axis)
        parts = [abs(measured[2] - extent[axis]) / (TOLERANCE * extent[axis] + SIZE_SLACK)]
        for seen, edge in zip(across, rest, strict=True):
            parts.append(abs(seen - edge) / ((SHORT_TOLERANCE if seen < edge else TOLERANCE) * edge + SIZE_SLACK))
        best = min(best, (max(parts) + sum(parts) / 3) / 2 + (0.0 if axis == 2 else 0.1))
    return best


def _score_color_difference(wording: str, asset: Json) -> float:
    """How far the colours disagree: 0 where all that stand out are shared, 2 where none is."""
    own = _colors_named_in_text(f"{asset.get('color', '')} {asset.get('description', '')}")
    seen = _colors_named_in_text(wording)
    vivid = [color for color in seen if color not in _PLAIN]
    if not vivid:
        return 2.0 if not {*own} & {*seen} else 0.4 if {*own} - _PLAIN else 0.0
    if vivid[0] not in own:
        return 2.0
    return 0.15 * (len({*own} - _PLAIN - {*vivid}) + len({*vivid} - {*own}))


def _colors_named_in_text(text: str) -> list[str]:
    """The colours a text names, in order; orange and brown are the same in other light."""
    named = ["orange" if word == "brown" else word for word in split_words(text) if word in COLORS]
    return list(dict.fromkeys(named))


def _format_json_block(*values: Json) -> str:
    lines = "\n".join(json.dumps(value, ensure_ascii=False) for value in values)
    return f"```json\n{lines}\n```"


_CATEGORIES_TEXT = """
bottle can box bowl mug cup plate jar carton tub canister cube pitcher ball basket tray toy bag book pan sponge hammer
scissors marker
"""
_CATEGORIES = _CATEGORIES_TEXT.split()


def describe_asset(prompt: PromptText) -> str:
    """Reply to the ``describe_asset`` prompt from its facts alone; the pictures are not looked at."""
    facts = prompt.section_json("facts")
    colors = [str(color) for color in facts.get("colors") or ()] if isinstance(facts.get("colors"), list) else []
    colors = colors or ["gray"]
    name = re.split(r"[\s_-]+", str(facts.get("file_name", "")).lower())
    spoken = [word for word in name if word.isalpha()]
    category = next((word for word in reversed(spoken) if word in _CATEGORIES), "object")
    paint = f"{_choose_tall_or_flat_word(parse_finite_floats(facts.get('size_m'), 3))}{' and '.join(colors[:2])}"
    article = "An" if paint[0] in "aeiou" else "A"
    hollow = ", hollow" if facts.get("hollow") is True else ""
    text = f"{article} {paint} {' '.join(spoken) or category}{hollow} (told from its name and measurements, not seen)."
    return _format_json_block({"description": text, "color": colors[0], "category": category})
