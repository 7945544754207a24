"""The describer of segments, the matcher of assets, and the describer of 3D models, by measurements and colours."""

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
"""Least thickness of an object, m."""
SIZE_SLACK = 0.005
"""Absolute tolerance of a measured extent (m), added to the relative tolerance."""
SHORT_TOLERANCE, TOLERANCE = 0.33, 0.12
"""Relative tolerance of an extent: if too short across, since the camera sees only the near side, and otherwise."""
MAX_DIFFERENCE = 0.9
"""Largest difference of a match; 1 if every extent is at its tolerance."""
LEAD = 0.2
"""Least difference between the best and the next asset."""
MIN_COLOR_SHARE = 0.05
"""Least share of an object's pixels for a second colour in its description."""
_ROUND_OR_ANGULAR = frozenset({"bottle", "jar", "canister", "tub"})
"""Categories that look round or angular depending on the view."""
_PLAIN = frozenset({"white", "gray", "black"})
_ROUND = frozenset({"cylinder", "can", "bottle", "jar", "canister", "tub", "mug", "cup", "bowl", "plate", "sphere"})


def extract_message_images(message: HumanMessage) -> list[bytes]:
    """The pictures in a message, as encoded files, in their order."""
    blocks = cast(list[Any], message.content) if isinstance(message.content, list) else []
    files = [cast(Json, block).get("base64") for block in blocks if isinstance(block, dict)]
    return [base64.b64decode(file) for file in files if isinstance(file, str)]


def describe_segments(prompt: PromptText, pictures: Sequence[bytes]) -> str:
    """Reply to the ``describe`` prompt from the measurements and the crop's colours; a sheet of crops is ignored."""
    segments = prompt.section_json_rows("segments")
    shown = pictures if len(segments) == 1 else ()
    descriptions: list[Json] = []
    for measured in segments:
        size = _parse_measured_size(measured)
        mean = parse_finite_floats(measured.get("mean_color_rgb"), 3)
        if mean and (not shown or max(mean) < 0.3):
            names = [color_name_from_rgb((mean[0], mean[1], mean[2]))]
        else:
            image = cv2.imdecode(np.frombuffer(shown[0], np.uint8), cv2.IMREAD_COLOR) if shown else None
            names = dominant_color_names(cast(Image, image), mean) if image is not None else ["gray"]
        shape = str(measured.get("outline") or "box").lower()
        shape = shape if shape in (*_ROUND, "box") else "box"
        category = "object"
        if size is not None:
            across, height = max(size[:2]), size[2]
            if shape in ("cylinder", "sphere"):
                category = "bottle" if height > 2 * across else "can"
                if across > 0.1:
                    category = "plate" if height < 0.035 else "bowl" if height < 0.09 else "canister"
            elif shape != "box":
                category = shape
            elif max(size) <= min(0.07, 1.25 * min(size)):
                category = "cube"
            else:
                category = "carton" if height >= 2 * across and height > 0.12 else "box"
        is_object = size is None or _is_plausible_object(size, measured)
        what = category if category != "object" else shape
        if label := split_words(str(measured.get("label") or "")):  # a person named the mask
            what, category = " ".join(label), label[-1]
        extent = " x ".join(f"{100 * edge:.0f}" for edge in size) + " cm" if size else "unknown size"
        second = f" with some {' and '.join(names[1:])}" if len(names) > 1 else ""
        description = f"A {_choose_tall_or_flat_word(size)}{names[0]} {what}{second}, {shape}-shaped, about {extent}."
        if not is_object:
            description = f"A {names[0]} segment of {extent}, too thin or too large to be an object."
        described: Json = {
            "id": measured.get("id"),
            "is_object": is_object,
            "part_of": None,
            "description": description,
            "color": names[0],
            "shape": shape,
            "category": category,
            "open_top": measured.get("open_top") is True,
        }
        descriptions.append(described)
    return _format_json_block(*descriptions)


def match_segments(prompt: PromptText) -> str:
    """Reply to the ``match`` prompt: for each segment the asset of the same size, colour and shape, if it is unique."""
    assets = prompt.section_json_rows("assets")
    return _format_json_block(*(_match_segment(segment, assets) for segment in prompt.section_json_rows("segments")))


def _match_segment(segment: Json, assets: Sequence[Json]) -> Json:
    number, size = segment.get("id"), _parse_measured_size(segment)
    if size is not None and not _is_plausible_object(size, segment):
        return {"id": number, "match": "no_object", "asset": None, "reason": "the segment is no plausible object"}
    wording = " ".join(str(segment.get(key, "")) for key in ("description", "category", "shape", "color"))
    scores = sorted(_score_asset_differences(size, wording, assets)) if size else []
    if not scores:
        reason = "no asset of this size, shape and colour"
    elif len(scores) > 1 and scores[1][0] < scores[0][0] + LEAD:
        reason = f"{' and '.join(name for _, name in scores[:3])} fit equally well"
    else:
        reason = f"size, shape and colours agree, at {100 * scores[0][0]:.0f} % of what is allowed to differ"
        return {"id": number, "match": "asset", "asset": scores[0][1], "reason": reason}
    return {"id": number, "match": "no_asset", "asset": None, "reason": reason}


def _score_asset_differences(
    size: Sequence[float], wording: str, assets: Sequence[Json]
) -> Iterator[tuple[float, str]]:
    """Difference (1: at the tolerance) and name of each asset that may match the measurements and the description."""
    for asset in assets:
        extent = parse_finite_floats(asset.get("size"), 3)
        kind = {*split_words(str(asset.get("category", ""))), *split_words(str(asset.get("description", "")))}
        alike = bool({*split_words(wording)} & _ROUND) == bool(kind & _ROUND)
        if extent and (alike or asset.get("category") in _ROUND_OR_ANGULAR):
            across = sorted(size[:2])
            best = 10.0
            for axis in range(3):
                rest = sorted(edge for number, edge in enumerate(extent) if number != axis)
                parts = [abs(size[2] - extent[axis]) / (TOLERANCE * extent[axis] + SIZE_SLACK)]
                for measured, edge in zip(across, rest, strict=True):
                    tolerance = SHORT_TOLERANCE if measured < edge else TOLERANCE
                    parts.append(abs(measured - edge) / (tolerance * edge + SIZE_SLACK))
                best = min(best, (max(parts) + sum(parts) / 3) / 2 + (0.0 if axis == 2 else 0.1))
            # The difference of the colours: 0 if all vivid colours are shared, 2 if none is
            known = {*_colors_named_in_text(f"{asset.get('color', '')} {asset.get('description', '')}")}
            seen = _colors_named_in_text(wording)
            vivid = [color for color in seen if color not in _PLAIN]
            if vivid and vivid[0] in known:
                difference = best + 0.15 * (len(known - _PLAIN - {*vivid}) + len({*vivid} - known))
            elif vivid or not known & {*seen}:
                difference = best + 2.0
            else:
                difference = best + (0.4 if known - _PLAIN else 0.0)
            if difference <= MAX_DIFFERENCE:
                yield difference, str(asset.get("name"))


def dominant_color_names(image: Image, mean: Sequence[float] | None = None) -> list[str]:
    """Names of the dominant colours of an object in a crop, the largest first.

    The crop's margin is darker than the object; otherwise its ``mean`` colour (RGB, 0..1) is used.
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
        if name == "brown":  # perhaps a shaded part of a red or orange object
            most = max(red, green, blue)
            lit_name = color_name_from_rgb((red / most, green / most, blue / most))
            shaded[lit_name] = shaded.get(lit_name, 0.0) + share
    for name, share in shaded.items():
        if shares.get(name, 0.0) > 0.5 * share:
            shares[name] += share
            shares["brown"] -= share
    ranked = sorted(shares, key=lambda name: (-shares[name], name))
    return ranked[:1] + [name for name in ranked[1:4] if shares[name] >= MIN_COLOR_SHARE]


def _parse_measured_size(measured: Json) -> tuple[float, ...] | None:
    return parse_finite_floats(measured.get("size_m"), 3)


def _is_plausible_object(size: Sequence[float], measured: Json) -> bool:
    points = measured.get("pixels")
    seen = not isinstance(points, int | float) or points >= 30
    low, middle, high = sorted(size)
    return seen and low >= MIN_THICKNESS and middle >= 0.012 and high <= 0.6 and high <= 25 * low


def _choose_tall_or_flat_word(size: Sequence[float] | None) -> str:
    if size is None:
        return ""
    across = max(size[:2])
    return "tall " if size[2] > 1.6 * across else "flat " if size[2] < 0.45 * across else ""


def _colors_named_in_text(text: str) -> list[str]:
    """Colours that a text names, in order; orange and brown are the same under different light."""
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
    """Reply to the ``describe_asset`` prompt from its facts alone; the pictures are ignored."""
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
