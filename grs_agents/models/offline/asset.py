"""The role that describes 3D models: from what was measured, and it says so."""

import json

from grs_agents.models.offline.text import PromptText
from grs_agents.models.offline.things import numbers

_KINDS = (
    "bottle", "can", "box", "bowl", "mug", "cup", "plate", "jar", "carton", "tub", "canister", "cube", "pitcher",
    "ball", "basket", "tray", "toy", "bag", "book", "pan", "sponge", "hammer", "scissors", "marker",
)  # fmt: skip


def describe_asset(prompt: PromptText) -> str:
    """Reply to the ``describe_asset`` prompt from its facts alone; the pictures are not looked at."""
    facts = prompt.json("facts")
    told = facts.get("colors")
    colors = [str(one) for one in told] if isinstance(told, list) and told else ["gray"]
    words = str(facts.get("file_name", "")).lower().replace("_", " ").replace("-", " ").split()
    words = [word for word in words if word.isalpha()]
    category = next((word for word in reversed(words) if word in _KINDS), "object")
    size = numbers(facts.get("size_m"), 3)
    extent = " x ".join(f"{100 * edge:.0f}" for edge in size) + " cm" if size else "unknown size"
    called = " ".join(words) or category
    hollow = ", hollow" if facts.get("hollow") is True else ""
    text = f"A {' and '.join(colors[:2])} {called}{hollow}, {extent} (told from its name and measurements, not seen)."
    reply = {"description": text, "color": colors[0], "category": category}
    return f"```json\n{json.dumps(reply)}\n```"
