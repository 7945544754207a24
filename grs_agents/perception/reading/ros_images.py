"""Pictures of ROS messages: sensor_msgs/Image and sensor_msgs/CompressedImage, colour and depth."""

import re
import struct
import warnings
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.pictures import MOST_PIXELS, open_picture_bytes
from grs_agents.perception.reading.frame_assembly import MILLIMETRE, RecordedDepth
from grs_agents.perception.types import Image

Kind = Literal["color", "grey", "depth", "unknown"]

_BGR, _GREY = cv2.COLOR_BGR2RGB, cv2.COLOR_GRAY2RGB
COLORS: dict[str, tuple[int, int | None]] = {
    "rgb8": (3, None),
    **dict.fromkeys(("bgr8", "8uc3"), (3, _BGR)),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    **dict.fromkeys(("bgra8", "8uc4"), (4, cv2.COLOR_BGRA2RGB)),
    **dict.fromkeys(("mono8", "8uc1"), (1, _GREY)),
    **dict.fromkeys(("yuv422", "uyvy"), (2, cv2.COLOR_YUV2RGB_UYVY)),
    **dict.fromkeys(("yuv422_yuy2", "yuyv"), (2, cv2.COLOR_YUV2RGB_YUY2)),
    # OpenCV names a Bayer pattern by its second row, ROS by its first.
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2RGB),
    "bayer_bggr8": (1, cv2.COLOR_BayerRG2RGB),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2RGB),
    "bayer_grbg8": (1, cv2.COLOR_BayerGB2RGB),
}
"""Bytes of a pixel, and OpenCV's conversion to RGB, by ``encoding`` in lower case."""
DEPTHS: dict[str, tuple[str, float]] = {
    **dict.fromkeys(("16uc1", "mono16"), ("u2", MILLIMETRE)),
    "32fc1": ("f4", 1.0),
}
"""Type of a pixel and metres per unit (REP 118), by ``encoding``."""
SCALE_SOURCE = "the encoding of the messages"
NOT_DEPTH = re.compile(r"infra|(^|[/_])ir([/_]|$)|confiden|amplitude|thermal|disparity|fisheye", re.IGNORECASE)
"""Topics of 16-bit pictures that are no depth."""
COMPRESSED_HEADER = struct.Struct("<iff")
"""Beginning of a compressedDepth picture: format, and the two parameters of its quantised inverse depth."""


def classify_image(topic: str, message: Any, compressed: bool) -> Kind:
    """Kind of the pictures of a topic, by its first message."""
    if compressed:
        name = str(message.format).lower()
        if "compresseddepth" in name or topic.endswith("/compressedDepth"):
            return "depth"
        with open_picture_bytes(bytes(message.data), topic) as image:
            mode = image.mode
        if mode[0] in "IF":
            return "unknown" if NOT_DEPTH.search(topic) else "depth"
        return "grey" if mode == "L" else "color"
    encoding = str(message.encoding).lower()
    if encoding in DEPTHS:
        return "unknown" if NOT_DEPTH.search(topic) else "depth"
    if encoding not in COLORS:
        return "unknown"
    return "grey" if encoding in ("mono8", "8uc1") else "color"


def decode_color_image(message: Any, compressed: bool, where: str) -> Image:
    """(H, W, 3) RGB of a message. Raises InputError: it is torn, too large, or its encoding is not of `COLORS`."""
    if compressed:
        with open_picture_bytes(bytes(message.data), where) as image:
            return np.asarray(image.convert("RGB"))
    encoding = str(message.encoding).lower()
    if encoding not in COLORS:
        raise InputError(f"{where} has the encoding {encoding[:40]!a}", f"record one of {', '.join(COLORS)}")
    channels, code = COLORS[encoding]
    pixels = _pixels_of_message(message, channels, np.dtype(np.uint8), where)
    pixels = np.ascontiguousarray(pixels[..., 0] if channels == 1 else pixels)
    return np.ascontiguousarray(pixels if code is None else np.asarray(cv2.cvtColor(pixels, code), np.uint8))


def decode_depth_image(message: Any, compressed: bool, where: str) -> RecordedDepth:
    """Depth of a message. Raises InputError: as `decode_color_image`, for `DEPTHS`."""
    if compressed:
        return _decode_compressed_depth(message, where)
    encoding = str(message.encoding).lower()
    if encoding not in DEPTHS:
        raise InputError(f"{where} has the encoding {encoding[:40]!a}", "record depth as 16UC1 (mm) or 32FC1 (m)")
    kind, scale = DEPTHS[encoding]
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    units = _pixels_of_message(message, 1, dtype, where)[..., 0].astype(kind)
    return RecordedDepth(units, scale, where, SCALE_SOURCE)


def _decode_compressed_depth(message: Any, where: str) -> RecordedDepth:
    data, name = bytes(message.data), str(message.format)
    if "rvl" in name.lower():
        raise InputError(f"{where} has the format {name[:60]!a}", "record depth raw, or compressed as PNG")
    header = b""
    if not data.startswith(b"\x89PNG"):
        header, data = data[: COMPRESSED_HEADER.size], data[COMPRESSED_HEADER.size :]
    with warnings.catch_warnings(action="ignore"), open_picture_bytes(data, where, ("PNG", "TIFF")) as image:
        units = np.array(image)
    if units.ndim != 2 or units.dtype.itemsize < 2:
        raise InputError(f"{where} holds a picture of mode {image.mode}, no depth", "record depth as 16UC1 or 32FC1")
    if not name.lower().startswith("32fc1") or units.dtype.kind == "f":
        return RecordedDepth(units, 1.0 if units.dtype.kind == "f" else MILLIMETRE, where, SCALE_SOURCE)
    if len(header) != COMPRESSED_HEADER.size:
        raise InputError(f"{where} has no header of its quantisation", "record depth raw")
    _, factor, offset = COMPRESSED_HEADER.unpack(header)
    with np.errstate(all="ignore"):
        metres = np.float32(factor) / (units.astype(np.float32) - np.float32(offset))
    return RecordedDepth(np.where(units > 0, metres, np.float32(0)), 1.0, where, SCALE_SOURCE)


def _pixels_of_message(message: Any, channels: int, dtype: "np.dtype[Any]", where: str) -> "npt.NDArray[Any]":
    """(H, W, C) pixels of an uncompressed picture."""
    rows, columns, step = int(message.height), int(message.width), int(message.step)
    needed = columns * channels * dtype.itemsize
    if not 0 < rows * columns <= MOST_PIXELS or step < needed or len(message.data) < rows * step:
        raise InputError(
            f"{where} is a picture of {columns}x{rows} pixels of {channels * dtype.itemsize} bytes, in rows of {step} "
            f"bytes, with {len(message.data)} bytes",
            f"record it again, with at most {MOST_PIXELS} pixels",
        )
    lines = np.asarray(message.data, np.uint8)[: rows * step].reshape(rows, step)[:, :needed]
    return np.ascontiguousarray(lines).view(dtype).reshape(rows, columns, channels)
