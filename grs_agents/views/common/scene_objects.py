"""The objects of a scene as events tell them: their number in the label picture, their name, where they are."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

Rectangle = tuple[int, int, int, int]
"""Left, top, width and height in pixels."""


def label_of(item: dict[str, Any], index: int) -> int:
    """The pixel value of an object in the label picture: given, or its id, or its place in the list from 1."""
    for key in ("label", "id"):
        if isinstance(item.get(key), int):
            return item[key]
    return index + 1


def name_of(item: dict[str, Any]) -> str:
    """What an object is called, as well as is known."""
    return str(item.get("name") or item.get("description") or f"object {item.get('id', '')}")


def rectangles(labels: npt.NDArray[Any]) -> dict[int, Rectangle]:
    """The box around each label of a label picture (H, W), 0 left out."""
    found: dict[int, Rectangle] = {}
    for label in np.flatnonzero(np.bincount(labels.ravel())):
        if label:
            left, top, width, height = cv2.boundingRect((labels == label).astype(np.uint8))
            found[int(label)] = (left, top, width, height)
    return found
