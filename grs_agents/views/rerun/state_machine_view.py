"""The state machine and the lane of nodes in the recording."""

from typing import Any

import rerun as rr

from grs_agents.trace import Event, NodeStarted, RunEnded, RunStarted
from grs_agents.views.rerun import state_machine
from grs_agents.views.rerun.paths import Paths
from grs_agents.views.rerun.recording import Recording

_START, _END = "__start__", "__end__"  # as LangGraph calls them


def _shown(node: str) -> str:
    """The name under which a node of the graph is drawn."""
    return state_machine.END if node == _END else node


class MachineView:
    """Knows the nodes of the run's graph, how often each was visited and which is active."""

    def __init__(self) -> None:
        self.nodes: tuple[str, ...] = state_machine.expected_nodes("")
        self._edges: tuple[state_machine.Edge, ...] = state_machine.edges(self.nodes)
        self._visits: dict[str, int] = {}
        self._active = ""
        self._placed: tuple[str, ...] = ()

    def follow(self, event: Event) -> None:
        """Take in an event without showing it."""
        if isinstance(event, RunStarted):
            nodes = [_shown(node) for node in event.nodes if node != _START] or state_machine.expected_nodes(
                event.graph
            )
            self.nodes = tuple(dict.fromkeys((*nodes, state_machine.END)))
            joined = tuple((_shown(tail), _shown(head)) for tail, head in event.edges if tail != _START)
            self._edges = joined or state_machine.edges(self.nodes)
        elif isinstance(event, NodeStarted):
            self.nodes = tuple(dict.fromkeys((*self.nodes, event.node)))
            self._visits[event.node] = max(event.visit, self._visits.get(event.node, 0))
            self._active = event.node
        elif isinstance(event, RunEnded):
            self._active = state_machine.END

    def prepare(self, recording: Recording) -> None:
        """What holds for the whole run: edges, and the colours of the lane."""
        recording.log(Paths.MACHINE, rr.GraphEdges(self._edges, graph_type="directed"), static=True)
        names = list(self.nodes)
        colors = [state_machine.color(name) for name in names]
        recording.log(Paths.NODE, rr.StateConfiguration(values=names, labels=names, colors=colors), static=True)

    def show(self, recording: Recording) -> None:
        """The machine as it stands, and the active node in the lane."""
        looks: dict[str, Any] = {
            "labels": [self._label(node) for node in self.nodes],
            "colors": [
                state_machine.color(node) if node == self._active else state_machine.QUIET for node in self.nodes
            ],
        }
        if self.nodes != self._placed:
            spots = list(state_machine.places(self.nodes).values())
            recording.log(Paths.MACHINE, rr.GraphNodes(self.nodes, positions=spots, show_labels=True, **looks))
            self._placed = self.nodes
        else:
            recording.row(Paths.MACHINE, rr.GraphNodes, **looks)
        if self._active:
            recording.row(Paths.NODE, rr.StateChange, state=[self._active])

    def _label(self, node: str) -> str:
        visits = self._visits.get(node, 0)
        return f"{'● ' if node == self._active else ''}{node}{f' ×{visits}' if visits else ''}"
