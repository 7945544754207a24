"""What a call may simulate is bounded, whatever its program does about the errors."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from grs_agents import sim
from grs_agents.base.config.schema import Limits
from grs_agents.library.library import Library
from grs_agents.sim import Environment, ObjectLimitError, SimulationBudgetError, SimulationError, VertexLimitError
from grs_agents.sim.world import budget

CUBE = "block/red_block.urdf"
MUG = "mug/mug.urdf"


@pytest.fixture(autouse=True)
def _afterwards_as_before(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with monkeypatch.context() as patch:
        patch.setattr(budget, "_call", type(budget._call)())
        yield
    sim.set_environment_defaults()


def spot(number: int) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    return (0.3 + 0.05 * (number % 8), -0.3 + 0.05 * (number // 8), 0.02), (0, 0, 0, 1)


def test_steps_of_all_environments_count_together_and_stay_used_up() -> None:
    sim.set_environment_defaults(limits=Limits(simulated_steps=100))
    first, second = Environment(), Environment()
    first.step_simulation(60)
    for env in (second, first, Environment()):
        with pytest.raises(SimulationBudgetError, match="100 simulated steps"):
            env.step_simulation(60)
    with pytest.raises(SimulationBudgetError):
        first.step_simulation(1)
    sim.reset_before_test()
    assert sim.describe_reached_limit() is None
    with pytest.raises(SimulationBudgetError):
        Environment().step_simulation(1)
    assert (sim.describe_reached_limit() or "").startswith("simulated_step_limit: the call used up")


def test_without_limits_each_environment_has_a_budget_of_its_own() -> None:
    for _ in range(2):
        Environment(budget=50).step_simulation(50)
    with pytest.raises(SimulationBudgetError, match="50"):
        Environment(budget=50).step_simulation(51)
    assert sim.describe_reached_limit()


def test_a_new_call_begins_anew() -> None:
    for _ in range(2):
        sim.set_environment_defaults(limits=Limits(simulated_steps=10))
        Environment().step_simulation(10)
    sim.set_environment_defaults()  # says nothing about limits
    with pytest.raises(SimulationBudgetError):
        Environment().step_simulation(1)


def test_objects_are_those_on_the_table_at_once() -> None:
    sim.set_environment_defaults(limits=Limits(objects=3))
    env = Environment()
    for _ in range(2):
        env.remove_all_objects()
        for number in range(3):
            env.add_object(CUBE, spot(number))
    for _ in range(2):
        with pytest.raises(ObjectLimitError, match=r"4 objects.*3 are the most"):
            env.add_object(CUBE, spot(4))
    assert len(env.objects) == 3
    assert isinstance(sim.latest_limit_error(), ObjectLimitError)


def test_two_hundred_objects_are_enough_without_limits() -> None:
    env = Environment()
    for number in range(200):
        env.add_object(CUBE, spot(number))
    with pytest.raises(ObjectLimitError):
        env.add_object(CUBE, spot(0))


def test_vertices_are_those_of_all_meshes_on_the_table() -> None:
    shapes, library = Library().load_object_model(MUG), Library()
    each = budget.add_to_vertex_count(0, shapes, library)
    assert each > 100
    sim.set_environment_defaults(limits=Limits(mesh_vertices=2 * each))
    env = Environment()
    env.add_object(MUG, spot(0))
    env.add_object(CUBE, spot(9))
    env.add_object(MUG, spot(20))
    with pytest.raises(VertexLimitError, match=f"{3 * each} vertices, {2 * each} are the most"):
        env.add_object(MUG, spot(40))
    assert len(env.objects) == 3
    env.remove_all_objects()
    env.add_object(MUG, spot(0))


def test_a_mesh_of_ones_own_is_counted(tmp_path: Path) -> None:
    vertices = "".join(f"v {i % 7} {i % 5} {i % 3}\n" for i in range(500))
    (tmp_path / "own.obj").write_text(vertices + "f 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    (tmp_path / "own.urdf").write_text(
        '<robot name="x"><link name="a"><inertial><mass value="0.1"/></inertial><visual><geometry>'
        '<mesh filename="own.obj" scale="0.01 0.01 0.01"/></geometry></visual><collision><geometry>'
        '<box size="0.05 0.05 0.05"/></geometry></collision></link></robot>'
    )
    sim.set_environment_defaults(limits=Limits(mesh_vertices=999))
    env = Environment(tmp_path)
    env.add_object("own.urdf", spot(0))
    with pytest.raises(VertexLimitError, match="1000"):
        env.add_object("own.urdf", spot(1))


@pytest.mark.parametrize(
    ("kind", "outcome"),
    [
        (SimulationBudgetError, "simulated_step_limit"),
        (ObjectLimitError, "object_limit"),
        (VertexLimitError, "vertex_limit"),
    ],
)
def test_each_has_an_outcome_of_its_own(kind: type[SimulationError], outcome: str) -> None:
    assert kind("x").outcome == outcome
