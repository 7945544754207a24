"""What one call may simulate: time steps in all, objects and mesh vertices on the table at once.

A process serves one call, and ``set_call_limits`` says once what that may cost. Catching an error of these gains
nothing: steps that are used up stay used up, and ``describe_reached_limit`` says afterwards which limit was met. The
limits keep programs from asking for too much; the limits of the sandbox keep the host safe from hostile code.
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
    """Begin a call that may simulate so much. Without this, steps are limited for each environment alone."""
    _call.limits, _call.steps_left, _call.reached = limits, limits.simulated_steps, None


def reset_before_test() -> None:
    """Forget the last episode, and which limit was reached; what is used up stays so."""
    clear_last_episode()
    _call.reached = None


def latest_limit_error() -> SimulationError | None:
    """The latest error of a limit since ``reset_before_test``."""
    return _call.reached


def describe_reached_limit() -> str | None:
    """The same in words, the outcome first."""
    error = _call.reached
    return None if error is None else f"{error.outcome}: {error}"


class Budget:
    """Simulated steps left to one environment, which come off those of the call as well."""

    def __init__(self, steps: int = DEFAULT_BUDGET) -> None:
        self.limit = self.left = steps

    def spend_steps(self, steps: int) -> None:
        """Take ``steps``; raises ``SimulationBudgetError`` if not so many are left, and from then on always."""
        _spend_call_steps(steps)
        self.left -= steps
        if self.left < 0:
            found = f"the environment used up its {self.limit} simulated steps"
            raise _record_limit_error(SimulationBudgetError(found, "reset less often or do less in a step"))


def _spend_call_steps(steps: int) -> None:
    if _call.steps_left is None:
        return
    _call.steps_left -= steps
    if _call.steps_left < 0:
        found = f"the call used up its {_call.limits.simulated_steps} simulated steps"
        remedy = "simulate less in all tests or seeds together, or raise limits.simulated_steps"
        raise _record_limit_error(SimulationBudgetError(found, remedy))


def check_object_count(count: int) -> None:
    """Raise ``ObjectLimitError`` if so many objects may not be on the table."""
    most = _call.limits.objects
    if count > most:
        remedy = "add fewer objects"
        raise _record_limit_error(ObjectLimitError(f"{count} objects are on the table, {most} are the most", remedy))


def add_to_vertex_count(count: int, shapes: ObjectModel, library: Library) -> int:
    """Vertices of the meshes on the table with one more object; raises ``VertexLimitError`` for too many."""
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
