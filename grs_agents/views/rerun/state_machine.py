"""The state machine as a picture: where each node stands, what leads where, and its colour."""

from collections.abc import Iterable
from itertools import pairwise

Color = tuple[int, int, int]
Edge = tuple[str, str]

END = "end"
COLUMN, ROW = 190.0, 110.0
_PERCEPTION = ("read", "find_table", "segment", "describe", "match", "register", "settle")
_ROWS = (
    ("read", "find_table", "segment", "describe"),
    ("generate_task", "settle", "register", "match"),
    ("generate_sim", "generate_tests", "run_tests", "audit"),
    ("", "fix_code", "route", "conclude"),
    ("", "fix_tests", "", END),
)
"""Where the nodes stand: perception goes right in the first row and back in the second."""
_PLACES: dict[str, tuple[float, float]] = {
    **{node: (column, row) for row, names in enumerate(_ROWS) for column, node in enumerate(names) if node},
    "hide_image": (-0.9, 1),
}
_EDGES: tuple[Edge, ...] = (
    *pairwise((*_PERCEPTION, "generate_task", "generate_sim", "generate_tests", "run_tests")),
    ("register", "describe"),
    ("run_tests", "route"),
    ("run_tests", "audit"),
    ("audit", "route"),
    ("audit", END),
    ("audit", "conclude"),
    ("conclude", END),
    ("route", "fix_code"),
    ("route", "fix_tests"),
    ("fix_code", "run_tests"),
    ("fix_tests", "run_tests"),
)
_OPTIONAL = frozenset({"conclude", "hide_image"})
_WITHOUT: dict[str, frozenset[str]] = {
    "router": frozenset({*_PERCEPTION, "generate_task"}),
    "scene": frozenset(_PLACES) - {*_PERCEPTION, END},
}
_COLORS: dict[str, Color] = {
    "read": (91, 120, 239),
    "find_table": (91, 141, 239),
    "segment": (93, 156, 237),
    "describe": (95, 170, 235),
    "match": (80, 190, 215),
    "register": (75, 195, 195),
    "settle": (70, 200, 175),
    "generate_task": (155, 120, 235),
    "generate_sim": (190, 110, 220),
    "generate_tests": (215, 120, 190),
    "run_tests": (241, 196, 15),
    "route": (231, 96, 76),
    "fix_code": (230, 140, 40),
    "fix_tests": (200, 160, 80),
    "audit": (26, 188, 156),
    "conclude": (46, 180, 90),
    END: (46, 204, 113),
}
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
            column, row = 4 + unknown // 4, unknown % 4
            unknown += 1
        found[node] = (column * COLUMN, row * ROW)
    return found


def edges(nodes: Iterable[str]) -> tuple[Edge, ...]:
    """The usual edges between those of ``nodes`` that are there."""
    present = set(nodes)
    return tuple(edge for edge in _EDGES if set(edge) <= present)
