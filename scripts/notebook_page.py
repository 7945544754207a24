"""A hook of mkdocs: a page that links a notebook shows its cells, too."""

import json
import re
from pathlib import Path
from typing import Any

_MARK = "<!-- cells -->"
_LINK = re.compile(r"\]\(([\w/]+\.ipynb)\)")


def on_page_markdown(markdown: str, config: Any, **_: Any) -> str:
    """The page, with text and code of the cells of the notebook that it links in the place of its mark."""
    if _MARK not in markdown:
        return markdown
    link = _LINK.search(markdown)
    assert link is not None, f"a page with {_MARK} must link a notebook"
    cells = json.loads((Path(config["docs_dir"]) / link[1]).read_text("utf-8"))["cells"]
    texts = [("".join(cell["source"]), cell["cell_type"]) for cell in cells]
    shown = [text if kind == "markdown" else f"```python\n{text}\n```" for text, kind in texts]
    return markdown.replace(_MARK, re.sub(r"\A# .*\n", "", "\n\n".join(shown)))  # the page has a heading
