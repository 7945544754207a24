"""Programs become data, one instance for each seed; what does not is a typed failure."""

from typing import Any

import pytest

from grs_agents.sim import TaskInstance, rollout
from grs_agents.toolkit import ToolContext, load_tool


def draw(context: ToolContext, simulation: str, seeds: tuple[int, ...] = (0, 1, 2), **limits: float) -> Any:
    tool = load_tool("instantiate")
    bounded = ToolContext(context.sandbox, context.library, context.limits.model_copy(update=limits))
    return tool.run(tool.Request(simulation=simulation, seeds=seeds), bounded)


def test_instances_are_valid_repeatable_and_solvable(context: ToolContext, simulation: str) -> None:
    result = draw(context, simulation)
    instances = [TaskInstance.model_validate(one) for one in result.instances]
    assert [one.seed for one in instances] == [0, 1, 2]
    assert not result.failures
    assert len({str(one.objects) for one in instances}) == 3
    assert draw(context, simulation).instances == result.instances
    assert rollout(instances[0], context.library).episode.reward == pytest.approx(1.0)


TASK = "\nfrom grs_agents.sim import Task\nclass T(Task): pass"
FAILURES = {
    "does not parse": ("def", "error"),
    "no task": ("x = 1", "error"),
    "raises": ("raise ValueError('no')" + TASK, "error"),
    "exits": ("import os; os._exit(0)" + TASK, "crashed"),
    "hangs": ("while True: pass" + TASK, "timeout"),
    "eats memory": ("x = []\nwhile True: x.append(bytearray(1 << 20))" + TASK, "memory"),
}


@pytest.mark.parametrize("name", FAILURES)
def test_program_that_does_not_load_fails_for_every_seed(name: str, context: ToolContext) -> None:
    simulation, outcome = FAILURES[name]
    result = draw(context, simulation, (0, 1), wall_seconds=2.0, memory_mib=256)
    assert not result.instances
    assert [failure.seed for failure in result.failures] == [0, 1]
    assert result.failures[0].outcome == outcome, result
    assert all(failure.message for failure in result.failures)


def test_each_seed_fails_for_its_own_reason(context: ToolContext, simulation: str) -> None:
    faults = (
        "        import os\n"
        "        if env.seed_used == 1: raise ValueError('seed one')\n"
        "        if env.seed_used == 2: env.add_object('block/red_block.urdf', (None, None))\n"
        "        if env.seed_used == 3: os._exit(0)\n"
        "        if env.seed_used == 4: env.add_object('block/red_block.urdf', ((9, 0, 0), (0, 0, 0, 1)))\n"
        "        while env.seed_used == 6: pass\n"
    )
    result = draw(context, simulation + faults, (0, 1, 2, 3, 4, 5, 6, 7), wall_seconds=3)
    assert [one["seed"] for one in result.instances] == [0, 5]
    assert {failure.seed: failure.outcome for failure in result.failures} == {
        1: "error",
        2: "no_free_space",
        3: "crashed",
        4: "invalid",
        6: "timeout",
        7: "not_run",
    }
    assert "raise ValueError('seed one')" in result.failures[0].traceback
    assert "while env.seed_used == 6" in result.failures[4].traceback


WITHOUT_TASK = """
import json
from grs_agents.sandbox.harness.channel import report_progress
INSTANCE = {instance!r}
for seed in ("0", "1", "2"):
    report_progress({{"item": seed, "phase": "start"}})
    text = json.dumps({{**INSTANCE, "seed": int(seed)}})
    report_progress({{"item": seed, "phase": "end", "instance": text}})
"""


def test_a_program_without_a_task_gives_no_instance_whatever_it_writes(context: ToolContext, simulation: str) -> None:
    (instance,) = draw(context, simulation, (0,)).instances
    result = draw(context, WITHOUT_TASK.format(instance=instance))
    assert not result.instances
    assert {failure.outcome for failure in result.failures} == {"error"}
    assert all("class Name(Task)" in failure.message for failure in result.failures)


TASKS = {
    "named by its module": "from grs_agents import sim\nclass T(sim.Task):",
    "under another name": "from cliport.tasks.task import Task as Base\nclass T(Base):",
    "through another class": "from grs_agents.sim import Task\nclass A(Task): pass\nclass T(A):",
    "where an import fails": "try:\n    import missing\nexcept ImportError:\n    from cliport.tasks import Task\n"
    "if True:\n    class T(Task):",
    "named Task itself": "from grs_agents.sim import Task\nclass Task(Task):",
}


@pytest.mark.parametrize("name", TASKS)
def test_a_task_is_found_however_it_is_written(name: str, context: ToolContext) -> None:
    result = draw(context, TASKS[name] + "\n        def reset(self, env): raise ValueError('it ran')\n", (0,))
    assert [failure.message for failure in result.failures] == ["ValueError: it ran"]


UNSTEADY = {
    "the time": "import time; now = time.time()",
    "the system's chance": "import os; now = int.from_bytes(os.urandom(4), 'big')",
    "how often it was asked": "T = type(self); T.asked = getattr(T, 'asked', 0) + 1; now = 997 * T.asked",
    "an address": "now = id(self) // 16",
    "a generator of its own": "from numpy.random import default_rng; now = default_rng().uniform(0, 1e6)",
}


@pytest.mark.parametrize("name", UNSTEADY)
def test_an_instance_that_differs_when_it_is_drawn_again_does_not_count(
    name: str, context: ToolContext, simulation: str
) -> None:
    unsteady = f"        {UNSTEADY[name]}\n"
    moved = (
        "        env.add_object('block/green_block.urdf', ((0.4, -0.3 + now % 99991 / 999910, 0.02), (0, 0, 0, 1)))\n"
    )
    result = draw(context, simulation + unsteady + moved, (0, 1))
    assert not result.instances
    assert [failure.outcome for failure in result.failures] == ["not_repeatable"] * 2
    assert all("differs in: objects" in failure.message for failure in result.failures)


CAUGHT = {
    "steps": ("env.step_simulation(10**9)", "simulated_step_limit"),
    "objects": ("for _ in range(300): env.add_object('block/red_block.urdf', base)", "object_limit"),
}


@pytest.mark.parametrize("name", CAUGHT)
def test_a_limit_that_was_reached_fails_the_seed_though_the_program_caught_it(
    name: str, context: ToolContext, simulation: str
) -> None:
    greed, outcome = CAUGHT[name]
    faults = (
        "        if env.seed_used == 1:\n"
        f"            try:\n                {greed}\n            except Exception: pass\n"
    )
    result = draw(context, simulation + faults, (0, 1))
    assert [one["seed"] for one in result.instances] == [0]
    assert [(failure.seed, failure.outcome) for failure in result.failures] == [(1, outcome)]


@pytest.mark.parametrize(("objects", "count"), [(2, 1), (1, 0)])
def test_the_host_counts_the_objects(objects: int, count: int, context: ToolContext, simulation: str) -> None:
    cheat = "\nfrom grs_agents.sim import tabletop\ntabletop.check_object_count = print\n"
    result = draw(context, simulation + cheat, (0,), objects=objects)
    assert len(result.instances) == count
    assert [failure.outcome for failure in result.failures] == ["invalid"] * (1 - count)
    assert all("2, 1 are the most" in failure.message for failure in result.failures)


FORGED = {
    "key twice": '"max_steps": 3, "max_steps": 2',
    "unknown key": '"x": 1',
    "another seed": '"seed": 99',
    "far away": '"objects": [{"id": 1, "asset": "block/red_block.urdf", "pose": [[9, 0, 0], [0, 0, 0, 1]]}]',
    "text for a number": '"max_steps": "3"',
    "giant number": '"max_steps": 1' + "0" * 400,
    "not a number": '"timestep": NaN',
    "infinity": '"pos_eps": Infinity',
    "nested": '"task": ' + "[" * 50_000,
    "goal of nothing": '"goals": [{"objects": [77]}]',
}


@pytest.mark.parametrize("name", FORGED)
def test_forged_instances_are_refused_by_the_host(name: str, context: ToolContext, simulation: str) -> None:
    forged = (
        "\nimport json\nfrom grs_agents import sim\n"
        "class Forged:\n"
        "    def model_dump_json(self):\n"
        "        base = {'task': 'T', 'seed': 0, 'max_steps': 3, 'timestep': 0.002, 'objects': [], 'goals': []}\n"
        f"        base = {{key: base[key] for key in base if repr(key)[1:-1] not in {FORGED[name]!r}}}\n"
        f"        return json.dumps(base)[:-1] + {', ' + FORGED[name] + '}'!r}\n"
        "sim.instantiate = lambda task, seed, library: Forged()\n"
    )
    result = draw(context, simulation + forged, (0,))
    assert not result.instances
    assert result.failures[0].outcome == "invalid", result


@pytest.mark.parametrize(
    ("made", "told"), [("'x' * (5 << 20)", "5242880 bytes"), ("7", "int, not JSON"), ("''", "JSON")]
)
def test_what_is_no_text_of_an_instance_is_refused(made: str, told: str, context: ToolContext, simulation: str) -> None:
    forged = f"\nfrom grs_agents import sim\nclass Forged:\n    def model_dump_json(self): return {made}\n"
    result = draw(context, simulation + forged + "sim.instantiate = lambda *given: Forged()\n", (0,))
    assert not result.instances
    assert result.failures[0].outcome == "invalid" and told in result.failures[0].message


def test_nothing_is_placed_in_the_background(
    context: ToolContext, simulation: str, wall: tuple[tuple[str, ...], str]
) -> None:
    tool = load_tool("instantiate")
    (roots, background), seeds = wall, tuple(range(8))

    def places(behind: str | None) -> list[tuple[float, float]]:
        request = tool.Request(simulation=simulation, seeds=seeds, library_roots=roots, background=behind)
        instances = [TaskInstance.model_validate(one) for one in tool.run(request, context).instances]
        assert len(instances) == len(seeds) and {one.background for one in instances} == {None}
        return [one.objects[1].pose[0][:2] for one in instances]

    assert all(x < 0.55 and y < 0.3 for x, y in places(background))
    assert any(x > 0.55 or y > 0.3 for x, y in places(None))
