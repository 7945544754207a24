"""Limits of a sandbox call: simulated time steps in all, objects and mesh vertices on the table at once.

A process serves one call, whose limits ``set_call_limits`` sets once. A program gains nothing by catching these errors:
spent steps stay spent, and ``describe_reached_limit`` reports the limit afterwards. These limits keep programs from
asking for too much; the limits of the sandbox keep the host safe from hostile code.
"""

from dataclasses import dataclass, field
from typing import Final

from grs_agents.base.config.schema import Limits
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import read_vertices
from grs_agents.library.shapes import ObjectModel
from grs_agents.sim.instance.episode import (
    ObjectLimitError,
    SimulationBudgetError,
    SimulationError,
    VertexLimitError,
    clear_last_episode,
)
from grs_agents.sim.world.footprints import cached_per_model

DEFAULT_BUDGET: Final = Limits().simulated_steps


@dataclass
class _CallBudget:
    limits: Limits = field(default_factory=Limits)
    steps_left: int | None = None
    reached: SimulationError | None = None


_call = _CallBudget()


def set_call_limits(limits: Limits) -> None:
    """Begin a call with these limits. Without it, steps are limited for each environment alone."""
    _call.limits, _call.steps_left, _call.reached = limits, limits.simulated_steps, None


def reset_before_test() -> None:
    """Forget the last episode and the limit it reached; spent steps stay spent."""
    clear_last_episode()
    _call.reached = None


def latest_limit_error() -> SimulationError | None:
    """The latest error of a limit since ``reset_before_test``."""
    return _call.reached


def describe_reached_limit() -> str | None:
    """``latest_limit_error`` in words, the outcome first; None without any."""
    error = _call.reached
    return None if error is None else f"{error.outcome}: {error}"


class Budget:
    """Simulated steps left to an environment; they count against the call's as well."""

    def __init__(self, steps: int = DEFAULT_BUDGET) -> None:
        self.limit = self.left = steps

    def spend_steps(self, steps: int) -> None:
        """Spend ``steps``; raises ``SimulationBudgetError`` if fewer are left, and on every later call."""
        if _call.steps_left is not None:
            _call.steps_left -= steps
            if _call.steps_left < 0:
                found = f"the call used up its {_call.limits.simulated_steps} simulated steps"
                remedy = "simulate less in all tests or seeds together, or raise limits.simulated_steps"
                raise _record_limit_error(SimulationBudgetError(found, remedy))
        self.left -= steps
        if self.left < 0:
            found = f"the environment used up its {self.limit} simulated steps"
            raise _record_limit_error(SimulationBudgetError(found, "reset less often or do less in a step"))


def check_object_count(count: int) -> None:
    """Raise ``ObjectLimitError`` for a count of objects beyond the limit."""
    most = _call.limits.objects
    if count > most:
        remedy = "add fewer objects"
        raise _record_limit_error(ObjectLimitError(f"{count} objects are on the table, {most} are the most", remedy))


def add_to_vertex_count(count: int, shapes: ObjectModel, library: Library) -> int:
    """Mesh vertices on the table with another object added; raises ``VertexLimitError`` for too many."""
    count += _count_mesh_vertices(shapes, library)
    most = _call.limits.mesh_vertices
    if count > most:
        found = f"the meshes on the table have {count} vertices, {most} are the most"
        raise _record_limit_error(VertexLimitError(found, "use simpler or fewer meshes"))
    return count


@cached_per_model
def _count_mesh_vertices(shapes: ObjectModel, library: Library) -> int:
    meshes = [shape.mesh or "" for shape in (*shapes.colliders, *shapes.visuals) if shape.kind == "mesh"]
    return sum(len(read_vertices(library.mesh_or_texture_path(mesh))) for mesh in meshes)


def _record_limit_error(error: SimulationError) -> SimulationError:
    _call.reached = error
    return error
