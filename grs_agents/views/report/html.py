"""HTML elements of a report: escaped text, tables, code, diffs, pictures. A page loads no external resource."""

import base64
import html
from collections.abc import Iterable, Sequence
from itertools import repeat
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from grs_agents.base.control_characters import escape_control_chars
from grs_agents.views.common.scene_objects import Rectangle

Verdict = Literal["", "good", "bad"]
"""CSS class, and so the colour, of success and failure."""
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
STYLE = Path(__file__).with_name("style.css").read_text("utf-8")


def escape_html(value: object) -> str:
    """``value`` as escaped HTML text, with control characters spelt out."""
    return html.escape(escape_control_chars(str(value)), quote=True)


def render_page(title: str, body: Iterable[str]) -> str:
    """A whole page. Its content security policy blocks scripts and requests even if escaping missed some markup."""
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f'<meta name="viewport" content="width=device-width,initial-scale=1"><title>{escape_html(title)}</title>\n'
        f"<style>{STYLE}</style></head>\n<body>\n" + "\n".join(body) + "\n</body></html>\n"
    )


def render_section(heading: str, *parts: str) -> str:
    """A heading with its parts; empty without parts."""
    inner = "\n".join(part for part in parts if part)
    return f"<section><h2>{escape_html(heading)}</h2>\n{inner}</section>" if inner else ""


def render_paragraph(value: object, kind: str = "") -> str:
    """A paragraph of text."""
    return f"<p{_class_attribute(kind)}>{escape_html(value)}</p>"


def render_table(
    heads: Sequence[str],
    rows: Iterable[Sequence[object]],
    numbers: Sequence[int] = (),
    verdicts: Sequence[Verdict] = (),
) -> str:
    """A table of text. Columns ``numbers`` are right-aligned; ``verdicts`` colours the rows."""

    def render_table_cells(tag: str, values: Sequence[object]) -> str:
        kinds = [' class="n"' if index in numbers else "" for index in range(len(values))]
        return "".join(f"<{tag}{kind}>{escape_html(value)}</{tag}>" for kind, value in zip(kinds, values, strict=True))

    colors: Iterable[Verdict] = verdicts or repeat("")
    pairs = zip(rows, colors, strict=False)
    lines = "".join(f"<tr{_class_attribute(color)}>{render_table_cells('td', row)}</tr>\n" for row, color in pairs)
    return f'<div class="table"><table><tr>{render_table_cells("th", heads)}</tr>\n{lines}</table></div>'


def _class_attribute(name: str) -> str:
    return f' class="{name}"' if name else ""


def render_collapsible(summary: str, inner: str, opened: bool = False, verdict: Verdict = "") -> str:
    """A collapsible block."""
    head = f"<summary{_class_attribute(verdict)}>{escape_html(summary)}</summary>"
    return f"<details{' open' if opened else ''}>{head}\n{inner}</details>"


def render_side_by_side(*parts: str) -> str:
    """Parts in a row, as far as the page is wide enough; empty without parts."""
    inner = "".join(part for part in parts if part)
    return f'<div class="row">{inner}</div>' if inner else ""


def render_code_block(value: str) -> str:
    """A code block."""
    return f"<pre>{escape_html(value)}</pre>"


def render_diff(value: str) -> str:
    """A unified diff in colours."""
    kinds = {"+++": "hunk", "---": "hunk", "@@": "hunk", "+": "add", "-": "del", "": ""}
    classes = (next(kind for mark, kind in kinds.items() if line.startswith(mark)) for line in value.split("\n"))
    pairs = zip(classes, value.split("\n"), strict=True)
    lines = (f'<span class="{kind}">{escape_html(line)}</span>' for kind, line in pairs)
    return "<pre>" + "\n".join(lines) + "</pre>"


def render_film(film: bytes, still: npt.NDArray[np.uint8], caption: str) -> str:
    """An animated WebP within the page; ``still`` (H, W, 3) replaces it in print and under reduced motion."""
    height, width = still.shape[:2]
    source = f'<source media="print, (prefers-reduced-motion: reduce)" srcset="{picture_url(still)}">'
    moving = f"data:image/webp;base64,{base64.b64encode(film).decode()}"
    shown = f'<img src="{moving}" width="{width}" height="{height}" alt="{escape_html(caption)}">'
    return f"<figure><picture>{source}{shown}</picture><figcaption>{escape_html(caption)}</figcaption></figure>"


def render_picture(image: npt.NDArray[np.uint8], caption: str = "", marks: Sequence[tuple[str, Rectangle]] = ()) -> str:
    """An image (H, W, 3) as a JPEG within the page, with named boxes (pixels) drawn over it."""
    height, width = image.shape[:2]
    source = picture_url(image)
    if marks:
        scale, boxes = width / 640, ""
        look = f'fill="none" stroke="#ffcd3c" stroke-width="{2 * scale:.1f}"'
        outline = f'stroke="#000" stroke-width="{3 * scale:.1f}" paint-order="stroke" fill="#ffcd3c"'
        for name, (left, top, box_width, box_height) in marks:
            place = f'x="{left}" y="{top - 3 * scale:.1f}" font-size="{15 * scale:.1f}"'
            boxes += f'<rect x="{left}" y="{top}" width="{box_width}" height="{box_height}" {look}/>'
            boxes += f"<text {place} {outline}>{escape_html(name)}</text>"
        photo = f'<image href="{source}" width="{width}" height="{height}"/>'
        drawing = f'<svg viewBox="0 0 {width} {height}">{photo}{boxes}</svg>'
    else:
        drawing = f'<img src="{source}" width="{width}" height="{height}" alt="{escape_html(caption)}">'
    return f"<figure>{drawing}<figcaption>{escape_html(caption)}</figcaption></figure>"


def picture_url(image: npt.NDArray[np.uint8]) -> str:
    """An image (H, W, 3), red first, as the data URL of a JPEG."""
    import cv2

    bgr = np.ascontiguousarray(image[:, :, ::-1])
    jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()
    return f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}"
