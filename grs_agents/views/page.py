"""Pieces of an HTML page that needs nothing from anywhere; all text that comes from outside is escaped here."""

import base64
import html
from collections.abc import Iterable, Sequence
from itertools import repeat
from typing import Literal

import numpy as np
import numpy.typing as npt

from grs_agents.terminal import visible
from grs_agents.views.common.scene_objects import Rectangle

Verdict = Literal["", "good", "bad"]
"""The class, and so the colour, of what went well or wrong."""
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
_STYLE = """
:root{color-scheme:light dark;--line:#8884;--good:#1a7f37;--bad:#cf222e;--soft:#8881}
body{font:16px/1.5 system-ui,sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem}
h1{margin:0 0 .2rem}h2{margin:2.4rem 0 .6rem;border-bottom:1px solid var(--line)}
table{border-collapse:collapse;width:100%}td,th{padding:.25rem .6rem;border-bottom:1px solid var(--line);
text-align:left;vertical-align:top;overflow-wrap:break-word}td.n,th.n{text-align:right;white-space:nowrap}
pre{background:var(--soft);padding:.8rem;overflow:auto;font:13px/1.45 ui-monospace,monospace;border-radius:6px}
figure{margin:0}figcaption{font-size:.9rem;opacity:.8}img,svg{max-width:100%;height:auto;display:block;border-radius:6px}
.row{display:flex;flex-wrap:wrap;gap:1rem}.row>*{flex:1 1 20rem}.strip{display:flex;gap:4px}
.strip>*{flex:1 1 0;min-width:0}
.good{color:var(--good)}.bad{color:var(--bad)}.add{color:var(--good)}.del{color:var(--bad)}.hunk{opacity:.6}
.table{overflow-x:auto}
.status{font-size:1.2rem;font-weight:600}.quiet{opacity:.75}summary{cursor:pointer}
"""


def text(value: object) -> str:
    """``value`` as text of a page: escaped, control characters spelt out."""
    return html.escape(visible(str(value)), quote=True)


def page(title: str, body: Iterable[str]) -> str:
    """A whole page. Its policy lets no browser run or fetch anything, even if something got through."""
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f'<meta name="viewport" content="width=device-width"><title>{text(title)}</title>\n'
        f"<style>{_STYLE}</style></head>\n<body>\n" + "\n".join(body) + "\n</body></html>\n"
    )


def section(heading: str, *parts: str) -> str:
    """A heading and what stands below it; nothing without parts."""
    inner = "\n".join(part for part in parts if part)
    return f"<section><h2>{text(heading)}</h2>\n{inner}</section>" if inner else ""


def paragraph(value: object, kind: str = "") -> str:
    """A paragraph of text."""
    return f"<p{_kind(kind)}>{text(value)}</p>"


def table(
    heads: Sequence[str],
    rows: Iterable[Sequence[object]],
    numbers: Sequence[int] = (),
    verdicts: Sequence[Verdict] = (),
) -> str:
    """A table of text.

    Args:
        heads: of the columns.
        rows: the cells.
        numbers: columns that are set to the right.
        verdicts: the colour of each row; none has one without.
    """

    def cells(tag: str, values: Sequence[object]) -> str:
        kinds = [' class="n"' if index in numbers else "" for index in range(len(values))]
        return "".join(f"<{tag}{kind}>{text(value)}</{tag}>" for kind, value in zip(kinds, values, strict=True))

    colors: Iterable[Verdict] = verdicts or repeat("")
    lines = "".join(f"<tr{_kind(color)}>{cells('td', row)}</tr>\n" for row, color in zip(rows, colors, strict=False))
    return f'<div class="table"><table><tr>{cells("th", heads)}</tr>\n{lines}</table></div>'


def _kind(name: str) -> str:
    return f' class="{name}"' if name else ""


def folded(summary: str, inner: str, opened: bool = False, verdict: Verdict = "") -> str:
    """Something to open by a click."""
    head = f"<summary{_kind(verdict)}>{text(summary)}</summary>"
    return f"<details{' open' if opened else ''}>{head}\n{inner}</details>"


def code(value: str) -> str:
    """A block of code."""
    return f"<pre>{text(value)}</pre>"


def diff(value: str) -> str:
    """A unified diff in colours."""
    kinds = {"+": "add", "-": "del", "@": "hunk"}
    lines = (f'<span class="{kinds.get(line[:1], "")}">{text(line)}</span>' for line in value.split("\n"))
    return "<pre>" + "\n".join(lines) + "</pre>"


def picture(image: npt.NDArray[np.uint8], caption: str = "", marks: Sequence[tuple[str, Rectangle]] = ()) -> str:
    """An image (H, W, 3) as a JPEG inside the page, with named boxes (pixels) drawn over it."""
    height, width = image.shape[:2]
    source = f"data:image/jpeg;base64,{base64.b64encode(_jpeg(image)).decode()}"
    if marks:
        boxes = "".join(_mark(name, box, width / 640) for name, box in marks)
        below = f'<image href="{source}" width="{width}" height="{height}"/>'
        drawn = f'<svg viewBox="0 0 {width} {height}">{below}{boxes}</svg>'
    else:
        drawn = f'<img src="{source}" width="{width}" height="{height}" alt="{text(caption)}">'
    return f"<figure>{drawn}<figcaption>{text(caption)}</figcaption></figure>"


def _mark(name: str, box: Rectangle, scale: float) -> str:
    left, top, width, height = box
    look = f'fill="none" stroke="#ffcd3c" stroke-width="{2 * scale:.1f}"'
    outline = f'stroke="#000" stroke-width="{3 * scale:.1f}" paint-order="stroke" fill="#ffcd3c"'
    return (
        f'<rect x="{left}" y="{top}" width="{width}" height="{height}" {look}/>'
        f'<text x="{left}" y="{top - 3 * scale:.1f}" font-size="{15 * scale:.1f}" {outline}>{text(name)}</text>'
    )


def _jpeg(image: npt.NDArray[np.uint8]) -> bytes:
    import cv2

    return cv2.imencode(".jpg", np.ascontiguousarray(image[:, :, ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()
