"""Drawing labels: textures whose upper part wraps around a package; the lower part holds its two caps."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from evals.synthesis.meshes import STRIP

Image = npt.NDArray[np.uint8]
Motif = Literal["disc", "dots", "stripes", "waves", "leaves", "squares"]
PIXELS_PER_METRE = 5000
SIDE = 512


@dataclass(frozen=True)
class Label:
    """The print of a package. Colours are ``rrggbb``.

    Attributes:
        lines: the printed name, a word or two per line.
        base, band, text: background, the bands above and below, the letters.
        motif, spot: the drawing and its colour.
        body: colour above and below the label (a bottle's plastic, a can's metal).
        cap: lid and top.
        span: vertical extent of the label on the height (0..1).
        lid: height fraction at which the lid begins.
    """

    lines: tuple[str, ...]
    base: str
    band: str
    text: str
    motif: Motif
    spot: str
    body: str = "c8ccd0"
    cap: str = "d4d6d8"
    span: tuple[float, float] = (0.0, 1.0)
    lid: float = 1.0


def bgr(color: str) -> tuple[int, int, int]:
    """An ``rrggbb`` colour as OpenCV orders it."""
    return (int(color[4:6], 16), int(color[2:4], 16), int(color[0:2], 16))


def label_texture(label: Label, panels: Sequence[float], height: float, printed_cap: bool) -> Image:
    """The (512, 512, 3) BGR texture of a package.

    Args:
        label: its design.
        panels: widths in m of the faces around it, from the left edge of its +x face, counter-clockwise.
        height: m.
        printed_cap: the top is printed as the sides are (a box), rather than a plain lid.
    """
    rows = round(SIDE * STRIP)
    scale = PIXELS_PER_METRE
    faces = [_face(label, round(width * scale), round(height * scale)) for width in panels]
    image = np.zeros((SIDE, SIDE, 3), np.uint8)
    image[:rows] = cv2.resize(np.hstack(faces), (SIDE, rows), interpolation=cv2.INTER_AREA)
    image[rows:] = bgr(label.cap)
    if printed_cap:
        top = np.full((SIDE - rows, SIDE // 2, 3), bgr(label.base), np.uint8)
        _name(top, label.lines, label.text, (0.08, 0.92), (0.15, 0.85))
        image[rows:, : SIDE // 2] = top
        image[rows:, SIDE // 2 :] = bgr(label.base)
    else:
        _lid(image[rows:], label)
    return image


def _face(label: Label, width: int, height: int) -> Image:
    face = np.full((height, width, 3), bgr(label.body), np.uint8)
    top, bottom = round(height * (1 - label.span[1])), round(height * (1 - label.span[0]))
    print_area = face[top:bottom]
    print_area[:] = bgr(label.base)
    if width < 0.035 * PIXELS_PER_METRE:
        _bands(print_area, label)
        _facts(print_area, label)
    else:
        _motif(print_area, label)
        _bands(print_area, label)
        _name(print_area, label.lines, label.text, (0.07, 0.93), (0.17, 0.56))
    if label.lid < 1:
        lid = round(height * (1 - label.lid))
        face[:lid] = bgr(label.cap)
        for column in range(0, width, 12):
            cv2.line(face, (column, 4), (column, lid - 4), _shade(label.cap, 0.86), 2)
    return face


def _bands(area: Image, label: Label) -> None:
    height = area.shape[0]
    area[: round(height * 0.12)] = bgr(label.band)
    area[round(height * 0.90) :] = bgr(label.band)


def _facts(area: Image, label: Label) -> None:
    """The small print of a narrow side: grey lines on a light field."""
    height, width = area.shape[:2]
    left, right, low, high = (round(f * s) for f, s in ((0.15, width), (0.85, width), (0.25, height), (0.8, height)))
    area[low:high, left:right] = _shade(label.base, 1.25)
    for row in range(low + 12, high - 8, 18):
        cv2.line(area, (left + 8, row), (right - 8 - (row * 7) % max(1, width // 4), row), (70, 70, 70), 4)


def _name(
    area: Image, lines: Sequence[str], color: str, across: tuple[float, float], down: tuple[float, float]
) -> None:
    """Print ``lines`` as large as they fit into a part of ``area`` (fractions of its width and height)."""
    height, width = area.shape[:2]
    room = (across[1] - across[0]) * width
    each = (down[1] - down[0]) * height / len(lines)
    font = cv2.FONT_HERSHEY_DUPLEX
    sizes = [cv2.getTextSize(line, font, 1.0, 2)[0] for line in lines]
    scale = min(0.72 * each / sizes[0][1], *(room / size[0] for size in sizes))
    thickness = max(1, round(scale * 2.6))
    for index, (line, size) in enumerate(zip(lines, sizes, strict=True)):
        x = round((across[0] + across[1]) / 2 * width - size[0] * scale / 2)
        y = round(down[0] * height + (index + 0.5) * each + size[1] * scale / 2)
        cv2.putText(area, line, (x, y), font, scale, bgr(color), thickness, cv2.LINE_AA)


def _motif(area: Image, label: Label) -> None:
    height, width = area.shape[:2]
    color, dark = bgr(label.spot), _shade(label.spot, 0.7)
    middle, low, unit = width // 2, round(height * 0.73), max(6, round(min(width, height) * 0.085))
    if label.motif == "disc":
        cv2.ellipse(area, (middle, low), (round(width * 0.3), round(height * 0.13)), 0, 0, 360, color, -1, cv2.LINE_AA)
        cv2.ellipse(area, (middle, low), (round(width * 0.3), round(height * 0.13)), 0, 0, 360, dark, 4, cv2.LINE_AA)
    elif label.motif == "dots":
        for index in range(9):
            x = middle + round((index - 4) * unit * 1.05)
            y = low + round(unit * 0.75) * (1 if index % 2 else -1)
            cv2.circle(area, (x, y), unit, color, -1, cv2.LINE_AA)
            cv2.circle(area, (x, y), unit, dark, 2, cv2.LINE_AA)
    elif label.motif == "stripes":
        for x in range(-height, width, 4 * unit):
            corners = np.array([[x, height], [x + unit, height], [x + unit + height // 2, 0], [x + height // 2, 0]])
            cv2.fillPoly(area, [corners], color, cv2.LINE_AA)
        area[round(height * 0.15) : round(height * 0.6)] = bgr(label.base)
    elif label.motif == "waves":
        x = np.arange(width, dtype=np.float64)
        y = low + unit * np.sin(x * 2 * np.pi / width * 2)
        edge = np.stack([x, y], 1)
        corners = np.vstack([edge, [[width, height], [0, height]]]).astype(np.int32)
        cv2.fillPoly(area, [corners], color, cv2.LINE_AA)
    elif label.motif == "leaves":
        for index in range(5):
            centre = (middle + round((index - 2) * unit * 1.9), low)
            cv2.ellipse(area, centre, (round(unit * 1.7), round(unit * 0.6)), -35, 0, 360, color, -1, cv2.LINE_AA)
            cv2.ellipse(area, centre, (round(unit * 1.7), round(unit * 0.6)), -35, 0, 360, dark, 2, cv2.LINE_AA)
    else:
        for index in range(4):
            x = middle + round((index - 1.5) * unit * 2.3)
            cv2.rectangle(area, (x - unit, low - unit), (x + unit, low + unit), color, -1, cv2.LINE_AA)
            cv2.rectangle(area, (x - unit, low - unit), (x + unit, low + unit), dark, 3, cv2.LINE_AA)


def _lid(area: Image, label: Label) -> None:
    """Rings on plain lids."""
    height, width = area.shape[:2]
    for part in (0.25, 0.75):
        for radius in (0.9, 0.72):
            axes = (round(width * 0.24 * radius), round(height * 0.48 * radius))
            cv2.ellipse(
                area,
                (round(width * part), height // 2),
                axes,
                0,
                0,
                360,
                _shade(label.cap, 0.82),
                2,
                cv2.LINE_AA,
            )


def _shade(color: str, factor: float) -> tuple[int, int, int]:
    blue, green, red = (min(255, round(channel * factor)) for channel in bgr(color))
    return (blue, green, red)
