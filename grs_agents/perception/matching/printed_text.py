"""Text printed on an object: read by OCR where a reader is installed, compared with the words of an asset."""

import re
from collections.abc import Sequence
from difflib import SequenceMatcher
from functools import lru_cache
from importlib import import_module
from typing import Any

import cv2
import numpy as np

from grs_agents.library.asset import Asset
from grs_agents.perception.types import Mask, RGBDFrame

_SHORTEST = 4  # letters of a word; shorter words are too often misread
_ALIKE = 0.74  # least similarity of two spellings
_SURE = 0.6  # least confidence of the reader
_EDGE, _LARGEST = 320, 4.0  # a crop is enlarged to this longer side (pixels), by at most this factor
_COMMON = (
    "with from small large white black green blue brown yellow orange purple pink dark light "
    "bottle carton canister container"
)
"""Words of a description about the look of an object rather than its print; the words of its kind are all kept."""


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
    large = cv2.resize(crop, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    found = read(np.ascontiguousarray(large, np.uint8), use_cls=False)
    if found.txts is None:
        return []
    text = " ".join(line for line, score in zip(found.txts, found.scores, strict=True) if score >= _SURE)
    return [word for word in re.findall(r"[a-z]+", text.lower()) if len(word) >= _SHORTEST]


def score_word_match(words: Sequence[str], asset: Asset) -> float:
    """Best similarity of a read word to a word of an asset: 0 without a similar word, 1 for equal spelling."""
    best = 0.0
    for word in words:
        for expected in expected_printed_words(asset):
            alike = SequenceMatcher(None, word, expected).ratio()
            best = max(best, alike if alike >= _ALIKE else 0.0)
    return best


def expected_printed_words(asset: Asset) -> frozenset[str]:
    """The words that may be printed on an asset: of its kind, and of its description without `_COMMON`."""
    kind = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", asset.kind).lower()
    described = set(re.findall(r"[a-z]+", asset.description.lower())) - set(_COMMON.split())
    words = {*re.findall(r"[a-z]+", kind), *described}
    return frozenset(word for word in words if len(word) >= _SHORTEST)
