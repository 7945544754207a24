"""The role that describes 3D models: from what was measured, and it says so."""

import json
from typing import cast

from grs_agents.models.offline.prompt_text import PromptText
from grs_agents.models.offline.scene_objects import numbers

_KINDS = (
    "bottle", "can", "box", "bowl", "mug", "cup", "plate", "jar", "carton", "tub", "canister", "cube", "pitcher",
    "ball", "basket", "tray", "toy", "bag", "book", "pan", "sponge", "hammer", "scissors", "marker",
)  # fmt: skip


def describe_asset(prompt: PromptText) -> str:
    """Reply to the ``describe_asset`` prompt from its facts alone; the pictures are not looked at."""
    facts = prompt.json("facts")
    told = facts.get("colors")
    colors = [str(one) for one in cast(list[object], told)] if isinstance(told, list) and told else ["gray"]
    words = str(facts.get("file_name", "")).lower().replace("_", " ").replace("-", " ").split()
    words = [word for word in words if word.isalpha()]
    category = next((word for word in reversed(words) if word in _KINDS), "object")
    size = numbers(facts.get("size_m"), 3)
    across = max(size[:2]) if size else 0.0
    build = "" if not size else "tall " if size[2] > 1.6 * across else "flat " if size[2] < 0.45 * across else ""
    called = " ".join(words) or category
    hollow = ", hollow" if facts.get("hollow") is True else ""
    paint = f"{build}{' and '.join(colors[:2])}"
    article = "An" if paint[0] in "aeiou" else "A"
    text = f"{article} {paint} {called}{hollow} (told from its name and measurements, not seen)."
    reply = {"description": text, "color": colors[0], "category": category}
    return f"```json\n{json.dumps(reply)}\n```"
