"""What is printed on an object: read from its crop where a reader is installed, compared with an asset's words."""

import re
from collections.abc import Sequence
from difflib import SequenceMatcher
from functools import lru_cache
from importlib import import_module
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.library.asset import Asset
from grs_agents.perception.types import Mask, RGBDFrame

_SHORTEST = 4  # words of fewer letters are too often misread
_ALIKE = 0.74
_SURE = 0.6
_EDGE, _LARGEST = 320, 4.0  # a crop is enlarged until its longer side has so many pixels, at most so many times
_COMMON = (
    "with from small large white black green blue brown yellow orange purple pink dark light "
    "bottle carton canister container"
)
"""Words of a description that say how an object looks rather than what is printed on it; its kind is kept whole."""


@lru_cache(maxsize=1)
def load_ocr_reader() -> Any:
    """The reader, or ``None`` where none is installed (extra ``ocr``)."""
    try:
        rapidocr = import_module("rapidocr")
    except ImportError:
        return None
    threads = {f"EngineConfig.onnxruntime.{kind}_op_num_threads": 1 for kind in ("intra", "inter")}
    return rapidocr.RapidOCR(params={"Global.log_level": "critical", **threads})


def read_words(frame: RGBDFrame, mask: Mask) -> list[str]:
    """The words printed on an object, in lower case; none where no reader is installed."""
    read = load_ocr_reader()
    if read is None:
        return []
    left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
    crop = frame.rgb[max(0, top - 4) : top + height + 4, max(0, left - 4) : left + width + 4, ::-1]
    scale = min(_LARGEST, max(1.0, _EDGE / max(crop.shape[:2])))
    found = read(_enlarge_crop(crop, scale), use_cls=False)
    if found.txts is None:
        return []
    told = " ".join(text for text, score in zip(found.txts, found.scores, strict=True) if score >= _SURE)
    return [word for word in re.findall(r"[a-z]+", told.lower()) if len(word) >= _SHORTEST]


def score_word_match(words: Sequence[str], asset: Asset) -> float:
    """How well words that were read fit an asset: 0 where none does, 1 where one is spelt as one of its own."""
    own = expected_printed_words(asset)
    best = 0.0
    for word in words:
        for mine in own:
            alike = SequenceMatcher(None, word, mine).ratio()
            best = max(best, alike if alike >= _ALIKE else 0.0)
    return best


def expected_printed_words(asset: Asset) -> frozenset[str]:
    """The words that may be printed on an asset: those of its kind, and what its description says besides looks."""
    kind = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", asset.kind).lower()
    described = set(re.findall(r"[a-z]+", asset.description.lower())) - set(_COMMON.split())
    words = {*re.findall(r"[a-z]+", kind), *described}
    return frozenset(word for word in words if len(word) >= _SHORTEST)


def _enlarge_crop(crop: npt.NDArray[np.uint8], scale: float) -> npt.NDArray[np.uint8]:
    large = cv2.resize(crop, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    return np.ascontiguousarray(large, np.uint8)
