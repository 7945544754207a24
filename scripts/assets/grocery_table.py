"""Sizes (m; depth x, width y, height z, upright), densities and print of the 28 grocery kinds."""

from evals.synthesis.label import Label
from evals.synthesis.packages import Package
from grs_agents.base import Vec3


def _grocery(kind: str, form: str, size: Vec3, density: float, color: str, look: str, label: Label) -> Package:
    return Package("HOPE", kind, form, size, density, color, look, label)


def _can(kind: str, size: Vec3, color: str, look: str, label: Label) -> Package:
    return _grocery(kind, "can", size, 1000.0, color, look, label)


def _box(kind: str, size: Vec3, density: float, color: str, look: str, label: Label) -> Package:
    return _grocery(kind, "box", size, density, color, look, label)


_PAPER = (0.03, 0.97)
_FLASK = (0.08, 0.60)
_TALL, _HALF, _FLAT = (0.071, 0.066, 0.084), (0.071, 0.066, 0.058), (0.071, 0.066, 0.033)

GROCERIES: tuple[Package, ...] = (
    _can("AlphabetSoup", _TALL, "red", "a red and white can of alphabet soup",
         Label(("ALPHABET", "SOUP"), "c62828", "f5f0e6", "ffffff", "squares", "f2c14e", span=_PAPER)),
    _grocery("BBQSauce", "bottle", (0.043, 0.065, 0.148), 950.0, "brown", "a dark brown bottle of barbecue sauce",
            Label(("BBQ", "SAUCE"), "7a2e12", "e08a1e", "ffe3b0", "waves", "d9541e", "3c1a10", "241510",
                  _FLASK, 0.80)),
    _box("Butter", (0.024, 0.103, 0.053), 900.0, "yellow", "a yellow box of butter",
         Label(("BUTTER",), "f7dc6f", "1f5fa8", "1f4f90", "disc", "fff3b0")),
    _can("Cherries", _HALF, "red", "a dark red can of cherries",
         Label(("CHERRIES",), "f7e7e4", "8e1230", "8e1230", "dots", "b3123f", span=_PAPER)),
    _box("ChocolatePudding", (0.030, 0.083, 0.050), 600.0, "brown", "a brown box of chocolate pudding",
         Label(("CHOCOLATE", "PUDDING"), "5b3320", "e8cfa6", "fff2dc", "waves", "8a5533")),
    _box("Cookies", (0.040, 0.123, 0.167), 350.0, "blue", "a blue box of cookies",
         Label(("COOKIES",), "2c5fb3", "f3d9a4", "ffffff", "dots", "b9814a")),
    _can("Corn", _HALF, "yellow", "a yellow and green can of corn",
         Label(("SWEET", "CORN"), "f6d13a", "2f8f3e", "1f6b2c", "dots", "fbe98a", span=_PAPER)),
    _box("CreamCheese", (0.024, 0.104, 0.053), 900.0, "white", "a white and blue box of cream cheese",
         Label(("CREAM", "CHEESE"), "f4f6f8", "7aa6d8", "2a4f8f", "waves", "c5daf0")),
    _box("GranolaBars", (0.039, 0.165, 0.124), 300.0, "green", "a green box of granola bars",
         Label(("GRANOLA", "BARS"), "4f9d45", "f0e2b8", "ffffff", "squares", "c58b4b")),
    _can("GreenBeans", _HALF, "green", "a green can of green beans",
         Label(("GREEN", "BEANS"), "e6efd2", "2e7d32", "1f5f26", "leaves", "4fa14a", span=_PAPER)),
    _grocery("Ketchup", "bottle", (0.043, 0.065, 0.149), 950.0, "red", "a red bottle of tomato ketchup",
            Label(("TOMATO", "KETCHUP"), "fbf3e6", "a31515", "b01818", "disc", "d32424", "c01d1d", "f2f2f2",
                  _FLASK, 0.80)),
    _box("MacaroniAndCheese", (0.040, 0.124, 0.166), 350.0, "blue", "a blue and orange box of macaroni and cheese",
         Label(("MACARONI", "& CHEESE"), "23408e", "f59a23", "ffd23f", "disc", "f7a928")),
    _grocery("Mayo", "jar", (0.041, 0.065, 0.148), 900.0, "white", "a white jar of mayonnaise with a blue lid",
            Label(("MAYO",), "e9eef6", "1d4fa3", "1d4fa3", "waves", "a8c4ec", "f3f0e4", "1d4fa3",
                  (0.08, 0.64), 0.77)),
    _grocery("Milk", "carton", (0.073, 0.072, 0.190), 950.0, "white", "a white and blue carton of milk",
            Label(("MILK",), "f6f8fb", "2468c4", "1b4fa0", "waves", "7fb2ee", "f6f8fb", "e8eef6",
                  (0.0, 0.76))),
    _can("Mushrooms", _FLAT, "white", "a flat cream and brown can of mushrooms",
         Label(("MUSHROOMS",), "efe3cf", "7d5a3c", "5f4027", "disc", "c9ae8c", span=_PAPER)),
    _grocery("Mustard", "bottle", (0.049, 0.065, 0.160), 950.0, "yellow", "a yellow bottle of mustard",
            Label(("YELLOW", "MUSTARD"), "f9e27a", "c8281e", "a8201a", "leaves", "e8b923", "f2c318", "c8281e",
                  _FLASK, 0.80)),
    _grocery("OrangeJuice", "carton", (0.071, 0.066, 0.192), 950.0, "orange", "an orange carton of orange juice",
            Label(("ORANGE", "JUICE"), "f28c1e", "2f7d36", "ffffff", "dots", "ffb84d", "f28c1e", "f7e7d0",
                  (0.0, 0.76))),
    _grocery("Parmesan", "canister", (0.066, 0.071, 0.103), 500.0, "green",
            "a green canister of grated parmesan with a white lid",
            Label(("GRATED", "PARMESAN"), "2f7a3e", "f0d878", "ffffff", "squares", "f3e3a0", "2f7a3e", "f4f4f4",
                  (0.0, 0.84), 0.84)),
    _can("Peaches", _HALF, "orange", "a peach-coloured can of sliced peaches",
         Label(("PEACHES",), "fbd9a8", "d9652b", "b04a18", "disc", "f49a4c", span=_PAPER)),
    _can("PeasAndCarrots", _HALF, "green", "a green and orange can of peas and carrots",
         Label(("PEAS &", "CARROTS"), "d9ead0", "e07a1f", "22682f", "dots", "5fae3f", span=_PAPER)),
    _can("Pineapple", (0.070, 0.066, 0.058), "yellow", "a yellow and blue can of pineapple",
         Label(("PINE-", "APPLE"), "fbe36b", "1f6fae", "1b5a92", "stripes", "f2b705", span=_PAPER)),
    _box("Popcorn", (0.038, 0.126, 0.085), 350.0, "red", "a red and white striped box of popcorn",
         Label(("POPCORN",), "f7f3ea", "c4202b", "c4202b", "stripes", "d8323c")),
    _box("Raisins", (0.040, 0.086, 0.123), 650.0, "purple", "a purple box of raisins",
         Label(("RAISINS",), "6b2f86", "f2c14e", "ffe9a8", "dots", "3b1a4d")),
    _grocery("SaladDressing", "bottle", (0.044, 0.064, 0.147), 950.0, "green",
            "a pale green bottle of salad dressing",
            Label(("SALAD", "DRESSING"), "f3f1df", "3d7f34", "2f6a2a", "leaves", "6fae4f", "b9c98a", "3d7f34",
                  _FLASK, 0.80)),
    _box("Spaghetti", (0.029, 0.250, 0.050), 900.0, "blue", "a long blue box of spaghetti",
         Label(("SPAGHETTI",), "17509e", "e8c65a", "ffffff", "waves", "e5c874")),
    _can("TomatoSauce", (0.070, 0.066, 0.083), "red", "a red and green can of tomato sauce",
         Label(("TOMATO", "SAUCE"), "d63a2a", "2f7a36", "fff4d6", "dots", "ef6a4a", span=_PAPER)),
    _can("Tuna", _FLAT, "blue", "a flat light blue can of tuna",
         Label(("TUNA",), "58b4dc", "0f3f78", "ffffff", "waves", "1d6fb0", span=_PAPER)),
    _grocery("Yogurt", "tub", (0.068, 0.068, 0.054), 900.0, "pink", "a pink and white tub of yogurt",
            Label(("YOGURT",), "fbf4f6", "e0628f", "c43d70", "dots", "ee7fa4", "fbf4f6", "f6dbe4",
                  (0.0, 0.9), 0.9)),
)  # fmt: skip
