"""The state machine as a picture: where each node stands, what leads where, and its colour."""

from collections.abc import Iterable

Color = tuple[int, int, int]
Edge = tuple[str, str]

END = "end"
COLUMN, ROW = 190.0, 110.0
_PLACES: dict[str, tuple[float, float]] = {
    "describe": (1, -0.8), "comprehend": (0, 0), "match": (1, 0), "generate_task": (2, 0),
    "run_tests": (0, 1), "generate_tests": (1, 1), "generate_sim": (2, 1),
    "audit": (0, 2), "route": (1, 2), "fix_code": (2, 2),
    "conclude": (-0.9, 2), "fix_tests": (1, 3), END: (-0.9, 3), "hide_image": (2, -0.8),
}  # fmt: skip
_EDGES: tuple[Edge, ...] = (
    ("comprehend", "describe"), ("describe", "match"), ("comprehend", "match"), ("match", "generate_task"),
    ("generate_task", "generate_sim"), ("generate_sim", "generate_tests"), ("generate_tests", "run_tests"),
    ("run_tests", "route"), ("run_tests", "audit"), ("audit", "route"), ("audit", END),
    ("audit", "conclude"), ("conclude", END),
    ("route", "fix_code"), ("route", "fix_tests"), ("fix_code", "run_tests"), ("fix_tests", "run_tests"),
)  # fmt: skip
_OPTIONAL = frozenset({"describe", "conclude", "hide_image"})
_WITHOUT: dict[str, frozenset[str]] = {
    "router": frozenset({"comprehend", "match", "generate_task"}),
    "scene": frozenset(_PLACES) - {"comprehend", "describe", "match", END},
}
_COLORS: dict[str, Color] = {
    "comprehend": (91, 141, 239), "describe": (95, 170, 235), "match": (80, 190, 215),
    "generate_task": (155, 120, 235), "generate_sim": (190, 110, 220), "generate_tests": (215, 120, 190),
    "run_tests": (241, 196, 15), "route": (231, 96, 76), "fix_code": (230, 140, 40), "fix_tests": (200, 160, 80),
    "audit": (26, 188, 156), "conclude": (46, 180, 90), END: (46, 204, 113),
}  # fmt: skip
_SPARE: tuple[Color, ...] = ((140, 160, 190), (170, 190, 110), (210, 130, 130), (120, 200, 200))
QUIET: Color = (150, 150, 160)


def color(node: str) -> Color:
    """The colour of ``node`` in the graph and in the lane of nodes."""
    return _COLORS.get(node) or _SPARE[sum(node.encode()) % len(_SPARE)]


def expected_nodes(graph: str) -> tuple[str, ...]:
    """The nodes to show before any has run, for a graph of which only the name is known."""
    without = _WITHOUT.get(graph, frozenset()) | _OPTIONAL
    return tuple(node for node in _PLACES if node not in without)


def places(nodes: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Positions in the plane, x right and y down; unknown nodes stand in columns to the right."""
    found: dict[str, tuple[float, float]] = {}
    unknown = 0
    for node in nodes:
        if node in _PLACES:
            column, row = _PLACES[node]
        else:
            column, row = 3 + unknown // 4, unknown % 4
            unknown += 1
        found[node] = (column * COLUMN, row * ROW)
    return found


def edges(nodes: Iterable[str]) -> tuple[Edge, ...]:
    """The usual edges between those of ``nodes`` that are there."""
    present = set(nodes)
    skip = {("comprehend", "match")} if "describe" in present else set[Edge]()
    return tuple(edge for edge in _EDGES if set(edge) <= present and edge not in skip)
