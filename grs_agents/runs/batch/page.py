"""``index.html``: every run of a batch with its photo, verdict, reason, cost and report; without scripts."""

import html
from pathlib import Path
from typing import Final
from urllib.parse import quote

from grs_agents.base.terminal.control_characters import escape_control_chars
from grs_agents.runs.batch.results import BatchResults
from grs_agents.runs.batch.row import BatchRow

_PHOTO: Final = "scene/rgb.png"
_REPORT: Final = "report.html"
_POLICY: Final = "default-src 'none'; img-src 'self' file:; style-src 'unsafe-inline'"
_STYLE: Final = """
:root{color-scheme:light dark;--line:#8884;--good:#1a7f37;--bad:#cf222e}
body{font:15px/1.45 system-ui,sans-serif;margin:1.5rem auto;max-width:90rem;padding:0 1rem}
.runs{display:grid;grid-template-columns:repeat(auto-fill,minmax(17rem,1fr));gap:1rem}
article{border:1px solid var(--line);border-radius:8px;overflow:hidden;break-inside:avoid}
article>div{padding:.5rem .8rem;overflow-wrap:anywhere}img{width:100%;aspect-ratio:4/3;object-fit:cover;display:block}
h1{font-size:1.4rem}h2{font-size:1rem;margin:0}p{margin:.25rem 0}.quiet{opacity:.75;font-size:.85rem}
.accepted{color:var(--good)}.rejected,.failed,.killed{color:var(--bad)}
"""


def render_page(out: Path, results: BatchResults) -> str:
    """The page of the batch in ``out``; photos and reports are linked by paths below it."""
    total = results.summary
    families = ", ".join(f"{name or 'none'} {count}" for name, count in total["families"].items())
    head = (
        f"<p>{total['accepted']} of {total['runs']} accepted, {total['different_tasks']} different tasks "
        f"({_to_html(families)}), {total['seconds']:.0f} s, ${total['cost']:.2f}</p>"
    )
    runs = "".join(_render_run_as_html(out, row) for row in results.rows)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Batch</title>'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}"><style>{_STYLE}</style></head>'
        f'<body><h1>{_to_html(out.resolve().name)}</h1>{head}<div class="runs">{runs}</div></body></html>\n'
    )


def _render_run_as_html(out: Path, row: BatchRow) -> str:
    photo = (
        f'<img loading="lazy" alt="" src="{_link_to_run_file(row, _PHOTO)}">'
        if (out / row.run / _PHOTO).is_file()
        else ""
    )
    report = f'<a href="{_link_to_run_file(row, _REPORT)}">report</a>' if (out / row.run / _REPORT).is_file() else ""
    folder = f'<a href="{_link_to_run_file(row, "")}">files</a>'
    repeats = f"<p>the same task as {_to_html(row.repeats)}</p>" if row.repeats else ""
    reward = "" if row.reward is None else f"reward {row.reward:.2f}, "
    fixes = row.code_fixes + row.test_fixes + row.task_fixes
    return (
        f'<article id="{_to_html(row.run)}">{photo}<div><h2>{_to_html(row.run)} '
        f'<span class="{_to_html(row.status)}">{_to_html(row.status)}</span></h2><p>{_to_html(row.description)}</p>'
        f'{repeats}<p class="quiet">{_to_html(row.reason)}</p><p class="quiet">{reward}{fixes} fixes, '
        f"{row.model_calls} model calls, {row.input_tokens + row.output_tokens} tokens, ${row.cost:.2f}, "
        f"{row.seconds:.1f} s</p><p>{report} {folder}</p></div></article>"
    )


def _link_to_run_file(row: BatchRow, file: str) -> str:
    return _to_html(quote(f"{row.run}/{file}"))


def _to_html(text: str) -> str:
    return html.escape(escape_control_chars(text))
