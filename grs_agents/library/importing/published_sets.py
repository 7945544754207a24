"""What is known of published object sets: masses, sizes, licences."""

import re
from typing import Final

from grs_agents.library.asset import Asset

HOPE_LICENSE: Final = "CC-BY-NC-SA-4.0"
OPEN_LICENSE: Final = "CC-BY-4.0"
"""Of the YCB set and of Google Scanned Objects."""
YCB_GRAMS: Final[dict[str, float]] = {
    "002": 414, "003": 411, "004": 514, "005": 349, "006": 603, "007": 171, "008": 187, "009": 97, "010": 370,
    "011": 66, "012": 18, "013": 68, "014": 29, "015": 33, "016": 49, "017": 47, "018": 25, "019": 178, "021": 1131,
    "022": 1022, "024": 147, "025": 118, "026": 6.2, "029": 279, "035": 895, "036": 729, "037": 82, "040": 15.8,
    "048": 665, "051": 125, "052": 202, "055": 148, "056": 56, "061": 28, "077": 252,
}  # fmt: skip
"""Mass by number, as the set's authors weighed it (Calli et al., 2015)."""
_CATEGORIES: Final = (
    "bottle", "can", "box", "bowl", "mug", "cup", "plate", "jar", "carton", "tub", "canister", "cube", "pitcher",
    "spoon", "fork", "knife", "spatula", "hammer", "screwdriver", "wrench", "drill", "scissors", "marker", "clamp",
    "ball", "banana", "apple", "lemon", "peach", "pear", "orange", "plum", "strawberry", "sponge", "block", "pan",
    "basket", "tray", "shoe", "toy", "bag", "glass", "vase", "lid", "basin", "pot", "book",
)  # fmt: skip
_NOT_PLAIN: Final = {
    "mushroom": "can",
    "tin": "can",
    "skillet": "pan",
    "frypan": "pan",
    "ramekin": "bowl",
    "baseball": "ball",
}


def words_of(name: str) -> list[str]:
    """The words of a file name or CamelCase name, lower-case, without numbers that only count."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|[^A-Za-z0-9]+", " ", name)
    return [word.lower() for word in spaced.split() if not word.isdigit()]


def category_of(name: str) -> str:
    """The plain noun that a name tells, the last of several; ``object`` where it tells none."""
    told = [_NOT_PLAIN.get(word, word) for word in words_of(name)]
    return next((word for word in reversed(told) if word in _CATEGORIES), "object")


def ycb_mass(name: str) -> float | None:
    """kg of a YCB object by its name (``006_mustard_bottle``), None where it is not known."""
    grams = YCB_GRAMS.get(name[:3])
    return None if grams is None else grams / 1000


def hope_kind(slug: str) -> str:
    """The HOPE data set's name of a kind: ``alphabet_soup`` is ``AlphabetSoup``."""
    joined = "".join(word.capitalize() for word in words_of(slug))
    return {"BbqSauce": "BBQSauce"}.get(joined, joined)


def known_hope(slug: str, assets: tuple[Asset, ...]) -> Asset | None:
    """The asset that GRS ships of the kind ``slug``: its size is that of the real thing."""
    return next((asset for asset in assets if asset.name == f"HOPE/{hope_kind(slug)}.urdf"), None)
