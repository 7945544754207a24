"""A hook of mkdocs: no page of the site may fetch anything from elsewhere."""

import re
from typing import Any

_FETCHED = re.compile(
    r"<(?:script|img|iframe|source|video)\b[^>]*\bsrc=[\"']?(?:https?:)?//[^\"' >]+"
    r"|<link\b(?![^>]*\brel=[\"']?(?:canonical|next|prev)\b)[^>]*\bhref=[\"']?(?:https?:)?//[^\"' >]+"
)


def on_post_page(output: str, page: Any, **_: Any) -> str:
    """Refuse a page that a browser without a network would not show whole.

    Raises:
        ValueError: the page fetches a script, a style, a font or a picture from elsewhere.
    """
    if fetched := _FETCHED.findall(output):
        raise ValueError(f"{page.file.src_path} fetches from elsewhere: {', '.join(fetched)}; put it into docs/")
    return output
