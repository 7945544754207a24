"""Every example program: its form, and that the audit accepts it."""

import ast
import random
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from grs_agents.agents.examples import Example, read_examples
from grs_agents.audit.checks import audit_task
from grs_agents.base.config.schema import AuditConfig
from grs_agents.base.content import content_root
from grs_agents.library.library import Library
from grs_agents.sim import (
    HAND_NOISE,
    Environment,
    InstanceTask,
    Task,
    TaskInstance,
    find_task_class,
    instantiate,
    rollout,
    run_oracle,
)
from tests.slow import slow_where

FOLDER = content_root() / "prompts" / "examples"
EXAMPLES = read_examples(FOLDER)
EVERY = pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
IMPORTED = {"grs_agents.sim", "math", "numpy"}
FAMILIES = {example.family: example for example in reversed(EXAMPLES)}
ONE_OF_A_FAMILY = pytest.mark.parametrize(
    "example",
    slow_where(lambda example: example is not FAMILIES[example.family], EXAMPLES),
    ids=[example.name for example in EXAMPLES],
)
"""Every example; those after the first of its family are slow."""
SEED = 1
Instances = Callable[[Example], TaskInstance]
FASTEST = 1.3
"""Metres a second: what is held moves with the tool, which is to carry at 0.8."""


@pytest.fixture(scope="module")
def library() -> Library:
    return Library()


def load(example: Example) -> ModuleType:
    module = ModuleType("task_code")
    exec(compile(example.source, example.name, "exec"), module.__dict__)
    return module


def instance_of(example: Example, seed: int, library: Library) -> TaskInstance:
    random.seed(seed)
    np.random.seed(seed)
    return instantiate(find_task_class(load(example))(), seed, library)


@pytest.fixture(scope="module")
def instances(library: Library) -> Instances:
    """The instance of an example for ``SEED``, made when it is first asked for."""
    made: dict[str, TaskInstance] = {}

    def instance(example: Example) -> TaskInstance:
        if example.name not in made:
            made[example.name] = instance_of(example, SEED, library)
        return made[example.name]

    return instance


def test_there_are_enough_programs_of_enough_families() -> None:
    assert len(EXAMPLES) >= 36
    assert len({example.family for example in EXAMPLES}) >= 12
    assert [example.name for example in EXAMPLES if not (example.family.isalpha() and example.shows)] == []


@EVERY
def test_it_is_one_short_documented_task_that_keeps_to_the_prompts_rules(example: Example) -> None:
    tree = ast.parse(example.source)
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    assert len(classes) == 1
    assert ast.get_docstring(classes[0])
    assert {node.module for node in tree.body if isinstance(node, ast.ImportFrom)} == {"grs_agents.sim"}
    assert {name.name for node in tree.body if isinstance(node, ast.Import) for name in node.names} <= IMPORTED
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.While)], "a loop without a bound"
    assert len(example.source.splitlines()) <= 72
    task = find_task_class(load(example))()
    assert isinstance(task, Task)
    assert task.lang_template
    assert task.task_completed_desc != Task().task_completed_desc


@ONE_OF_A_FAMILY
def test_the_audit_accepts_it(
    example: Example, library: Library, instances: Instances, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grs_agents.sim.rollouts.HAND_NOISE", HAND_NOISE[:1])  # the audit judges by no other
    instance = instances(example)
    copied = TaskInstance.model_validate_json(instance.model_dump_json())
    done = rollout(copied, library, trials=3)
    if any(trial.score < AuditConfig().reward for trial in done.trials):  # then more decide, as in a run
        done = rollout(copied, library, trials=5)
    report = audit_task([instance], [], [done], AuditConfig(seeds=1), library)
    assert report.accepted, [finding.detail for finding in report.findings if not finding.passed]
    assert len(done.moved) >= 2
    assert done.warnings + instance.warnings == ()


@ONE_OF_A_FAMILY
def test_nothing_moves_further_between_two_looks_than_its_speed_allows(
    example: Example, library: Library, instances: Instances
) -> None:
    instance = instances(example)
    task = InstanceTask(instance)
    env = Environment(task=task, library=library, seed=SEED)
    env.timestep = instance.timestep
    env.reset()
    physics = env.physics
    bodies = [physics.world.bodies[number] for number in physics.world.addresses]
    starts = [int(physics.model.body_dofadr[body]) for body in bodies]
    excess: list[float] = []
    time, places, speeds = float(physics.data.time), np.array(physics.data.xpos[bodies]), np.zeros(len(bodies))

    def look() -> None:
        nonlocal time, places, speeds
        before, earlier, slower = time, places, speeds
        time, places = float(physics.data.time), np.array(physics.data.xpos[bodies])
        speeds = np.linalg.norm([physics.data.qvel[start : start + 3] for start in starts], axis=1)
        held = np.array([number == physics.held_object_id for number in physics.world.addresses])
        allowed = np.where(held, FASTEST, np.maximum(speeds, slower)) * (time - before)
        excess.append(float((np.linalg.norm(places - earlier, axis=1) - allowed).max(initial=0.0)))

    physics.observer = look
    run_oracle(env, task)
    assert env.physics is physics
    assert len(excess) > 100
    assert max(excess) < 5e-5


@EVERY
def test_its_goals_are_in_words_and_it_leaves_steps_to_spare(example: Example, instances: Instances) -> None:
    instance = instances(example)
    assert all(goal.language and "{" not in goal.language for goal in instance.goals)
    wanted = {number for goal in instance.goals for number in goal.objects}
    one_by_one = instance.primitive == "pick_place" and not instance.ties
    assert not one_by_one or instance.max_steps >= 1.5 * len(wanted)


@EVERY
def test_a_seed_gives_one_instance_whatever_was_drawn_elsewhere(
    example: Example, library: Library, instances: Instances
) -> None:
    assert instance_of(example, SEED, library) == instances(example)


def test_most_programs_differ_from_seed_to_seed(library: Library) -> None:
    same = [
        example.name
        for example in EXAMPLES
        if instance_of(example, 2, library).objects == instance_of(example, 3, library).objects
    ]
    assert len(same) < len(EXAMPLES) / 4, same


def test_no_file_of_the_folder_is_left_out() -> None:
    assert {example.name for example in EXAMPLES} == {file.stem for file in Path(FOLDER).iterdir() if file.is_file()}
