"""The state machine in the recording: node positions, edges, colours, and the timeline of nodes."""

from collections.abc import Iterable
from typing import Any

import rerun as rr

from grs_agents.base.trace.events import Event, NodeStarted, RunEnded, RunStarted
from grs_agents.views.rerun.recording import Paths, RerunRecording

Color = tuple[int, int, int]
Edge = tuple[str, str]

END = "end"
COLUMN, ROW = 190.0, 110.0
_ROWS = (
    ("read", "find_table", "segment", "describe"),
    ("generate_task", "settle", "register", "match"),
    ("generate_sim", "generate_tests", "run_tests", "audit"),
    ("", "fix_code", "route", "conclude"),
    ("", "fix_tests", "fix_task", END),
)
"""Grid of nodes: perception goes right in the first row and back in the second."""
_GRID: dict[str, tuple[float, float]] = {
    **{node: (column, row) for row, names in enumerate(_ROWS) for column, node in enumerate(names) if node},
    "hide_image": (-0.9, 1),
    "group": (2.5, -0.75),
    "edit": (0.5, 0.5),
    "review": (0.5, 1.5),
}
_COLORS: dict[str, Color] = {
    "read": (91, 120, 239),
    "find_table": (91, 141, 239),
    "segment": (93, 156, 237),
    "group": (94, 163, 236),
    "describe": (95, 170, 235),
    "match": (80, 190, 215),
    "register": (75, 195, 195),
    "settle": (70, 200, 175),
    "review": (100, 190, 160),
    "edit": (110, 175, 185),
    "generate_task": (155, 120, 235),
    "generate_sim": (190, 110, 220),
    "generate_tests": (215, 120, 190),
    "run_tests": (241, 196, 15),
    "route": (231, 96, 76),
    "fix_code": (230, 140, 40),
    "fix_tests": (200, 160, 80),
    "fix_task": (170, 180, 110),
    "audit": (26, 188, 156),
    "conclude": (46, 180, 90),
    END: (46, 204, 113),
}
_OTHER_COLORS: tuple[Color, ...] = ((140, 160, 190), (170, 190, 110), (210, 130, 130), (120, 200, 200))
INACTIVE: Color = (118, 122, 138)
"""Legible on light and dark backgrounds."""
TAKEN: Color = (205, 105, 30)
"""Colour of an edge's count."""


def node_color(node: str) -> Color:
    """Colour of ``node`` in the graph and in the timeline of nodes."""
    return _COLORS.get(node) or _OTHER_COLORS[sum(node.encode()) % len(_OTHER_COLORS)]


def node_positions(nodes: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Positions in the plane, x right and y down; unknown nodes are placed in columns to the right."""
    positions: dict[str, tuple[float, float]] = {}
    unknown = 0
    for node in nodes:
        if node in _GRID:
            column, row = _GRID[node]
        else:
            column, row = 4 + unknown // 4, unknown % 4
            unknown += 1
        positions[node] = (column * COLUMN, row * ROW)
    return positions


_START, _END = "__start__", "__end__"  # as LangGraph calls them


def _node_name(node: str) -> str:
    """The displayed name of a node."""
    return END if node == _END else node


class MachineView:
    """Nodes of the run's graph with their visits, and the active node."""

    def __init__(self) -> None:
        self.nodes: tuple[str, ...] = (END,)
        self._edges: tuple[Edge, ...] = ()
        self._visits: dict[str, int] = {}
        self._taken: dict[Edge, int] = {}
        self._active = ""
        self._placed: tuple[str, ...] = ()

    def track_event(self, event: Event) -> None:
        """Update the state without logging."""
        if isinstance(event, RunStarted):
            nodes = (_node_name(node) for node in event.nodes if node != _START)
            self.nodes = tuple(dict.fromkeys((*nodes, END)))
            self._edges = tuple((_node_name(tail), _node_name(head)) for tail, head in event.edges if tail != _START)
        elif isinstance(event, NodeStarted):
            self.nodes = tuple(dict.fromkeys((*self.nodes, event.node)))
            self._visits[event.node] = max(event.visit, self._visits.get(event.node, 0))
            self._move_to_node(event.node)
        elif isinstance(event, RunEnded):
            self._move_to_node(END)

    def _move_to_node(self, node: str) -> None:
        edge = (self._active, node)
        if edge in self._edges:
            self._taken[edge] = self._taken.get(edge, 0) + 1
        self._active = node

    def log_static_graph(self, recording: RerunRecording) -> None:
        """Log the edges, and the colours of the timeline."""
        recording.log(Paths.MACHINE, rr.GraphEdges(self._edges, graph_type="directed"), static=True)
        names = list(self.nodes)
        colors = [node_color(name) for name in names]
        recording.log(Paths.NODE, rr.StateConfiguration(values=names, labels=names, colors=colors), static=True)

    def log_current_state(self, recording: RerunRecording) -> None:
        """Log the nodes with visit counts, edge counts, and the active node."""
        counts = {f"{tail} to {head}": f"{count}×" for (tail, head), count in self._taken.items()}
        names = (*self.nodes, *counts)
        colors = [node_color(node) if node == self._active else INACTIVE for node in self.nodes]
        labels = [
            f"{'● ' if node == self._active else ''}{node}{f' ×{self._visits[node]}' if self._visits.get(node) else ''}"
            for node in self.nodes
        ]
        looks: dict[str, Any] = {
            "labels": [*labels, *counts.values()],
            "colors": [*colors, *[TAKEN] * len(counts)],
        }
        if names != self._placed:
            spots = node_positions(self.nodes)
            ends = ((spots[tail], spots[head]) for tail, head in self._taken)
            # a count is drawn nearer to the tail of its edge, since an opposite edge may exist
            middles = ((0.58 * x + 0.42 * u, 0.58 * y + 0.42 * v) for (x, y), (u, v) in ends)
            places = [*spots.values(), *middles]
            recording.log(Paths.MACHINE, rr.GraphNodes(names, positions=places, show_labels=True, **looks))
            self._placed = names
        else:
            recording.log_row(Paths.MACHINE, rr.GraphNodes, **looks)
        if self._active:
            recording.log_row(Paths.NODE, rr.StateChange, state=[self._active])
