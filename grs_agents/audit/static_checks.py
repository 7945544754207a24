"""Faults of the two generated programs that show without a run: their source is read, nothing of it is executed."""

import ast
import re
from collections.abc import Iterator
from difflib import get_close_matches
from pathlib import PurePosixPath

from grs_agents.agents.types import TaskDefinition
from grs_agents.audit.source_checks import ProgramSource, check_source, read_source
from grs_agents.audit.types import StaticFinding
from grs_agents.library.library import Library
from grs_agents.sandbox.host.suite_discovery import discover_tests
from grs_agents.sim import defines_task_class

_ASSET_NAME = re.compile(r"[\w.\-]+(?:/[\w.\-]+)+\.(?:urdf|xml)")


def check_programs(simulation: str, tests: str, task: TaskDefinition, library: Library) -> tuple[StaticFinding, ...]:
    """Faults of the two programs that their source shows, the simulation program's first.

    Args:
        simulation: source of the simulation program.
        tests: source of its tests; empty if they are not written yet.
        task: the definition that the program must keep to.
        library: the assets, including the run's.
    """
    program = read_source("simulation", simulation)
    suite = read_source("tests", tests) if tests.strip() else None
    findings = [source for source in (program, suite) if isinstance(source, StaticFinding)]
    if isinstance(program, ProgramSource):
        findings += [
            *check_source(program),
            *check_task_class_and_base_calls(program),
            *check_asset_literals_match_task(program, task, library),
        ]
        findings += [*_find_objects_without_goal(program), *check_rewards_sum_to_one(program)]
    if isinstance(suite, ProgramSource):
        findings += [*check_source(suite), *check_tests_exist_and_assert(suite)]
        if isinstance(program, ProgramSource):
            findings += _find_names_missing_in_program(program, suite, task)
    return tuple(sorted(dict.fromkeys(findings), key=lambda finding: (finding.program, finding.line)))


def check_task_class_and_base_calls(source: ProgramSource) -> Iterator[StaticFinding]:
    """Check that a class derives from Task, and that its methods call the base's."""
    if not defines_task_class(source.tree):
        yield source.finding(1, "class_missing", "no class derives from Task")
    tasks = [node for node in source.nodes_of_type(ast.ClassDef) if "Task" in map(ast.unparse, node.bases)]
    for node in (statement for task in tasks for statement in task.body):
        name = node.name if isinstance(node, ast.FunctionDef) else ""
        if name in ("__init__", "reset") and f".{name}(" not in ast.unparse(node):
            yield source.finding(node.lineno, "base_call_missing", f"{name} has to call super().{name}")


def check_asset_literals_match_task(
    source: ProgramSource, task: TaskDefinition, library: Library
) -> Iterator[StaticFinding]:
    """Check that asset names in the program are in the library and the task, and that all assets of the task occur."""
    pieces = {part for node in source.nodes_of_type(ast.JoinedStr) for part in node.values}
    texts = [node for node in source.nodes_of_type(ast.Constant) if re.search(r"\.(urdf|xml)", str(node.value))]
    whole = [node for node in texts if node not in pieces and _ASSET_NAME.fullmatch(str(node.value))]
    literals, complete = {str(node.value): node.lineno for node in whole}, len(whole) == len(texts)
    used: dict[str, str | None] = {}  # the library's name, without folders in front
    for literal in literals:
        parts = PurePosixPath(literal).parts
        tails = ["/".join(parts[start:]) for start in range(len(parts))]
        used[literal] = next((tail for tail in tails if tail in library), None)
    for literal, name in used.items():
        if name is None:
            near = get_close_matches(literal, library.asset_names(), n=3, cutoff=0.0)
            text = f"the library has no asset {literal}; the nearest are {', '.join(near)}"
            yield source.finding(literals[literal], "unknown_asset", text)
        elif name not in task.assets:
            near = get_close_matches(name, task.assets, n=1, cutoff=0.0)
            text = f"{name} is not among the assets of the task, the nearest of which is {near[0]}"
            yield source.finding(literals[literal], "asset_not_in_task", text)
    for name in sorted(set(task.assets) - set(used.values())) if complete else ():
        yield source.finding(1, "asset_unused", f"the task names {name}, which the program does not add")


def _find_objects_without_goal(source: ProgramSource) -> Iterator[StaticFinding]:
    """Find movable objects whose variable nothing reads."""
    read = {node.id for node in source.nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
    for node in source.nodes:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id not in read:
            text = ast.unparse(node.value)
            if re.match(r"[\w.]+\.add_object\(", text) and "fixed" not in text:
                text = f"{node.targets[0].id} is added but no goal speaks of it"
                yield source.finding(node.lineno, "object_without_goal", text)


def check_rewards_sum_to_one(source: ProgramSource) -> Iterator[StaticFinding]:
    """Check that goals add up to 1, if ``reset`` states them in sequence with rewards in plain numbers."""
    goals = [call for call in source.nodes_of_type(ast.Call) if getattr(call.func, "attr", "") == "add_goal"]
    rewards: list[float | None] = []  # a number, or a quotient of two; None if it has to be computed
    for goal in goals:
        stated = [ast.unparse(word.value) for word in goal.keywords if word.arg == "step_max_reward"]
        number = re.fullmatch(r"(\d*\.?\d+)(?: / (\d*\.?\d*[1-9]))?", stated[0] if stated else "1")
        rewards.append(float(number[1]) / float(number[2] or 1) if number and len(goal.args) < 8 else None)
    resets = [node for node in source.nodes_of_type(ast.FunctionDef) if node.name == "reset"]
    plain = {getattr(statement, "value", None) for reset in resets for statement in reset.body}
    if not goals or None in rewards or not plain.issuperset(goals):
        return
    total = sum(filter(None, rewards))
    if abs(total - 1) > 0.01:
        text = f"the goals' step_max_reward add up to {total:.2f}, not 1"
        yield source.finding(goals[-1].lineno, "reward_sum", text)


def check_tests_exist_and_assert(source: ProgramSource) -> Iterator[StaticFinding]:
    """Check that there are test methods, each with an assertion."""
    suite = discover_tests(source.tree)
    if not suite.ids:
        yield source.finding(1, "no_tests", "there is no method test... of a class that derives from TestCase")
    for name in sorted(suite.without_assertion):
        yield source.finding(suite.lines.get(name, 1), "no_assertion", f"{name} asserts nothing")


def _find_names_missing_in_program(
    program: ProgramSource, suite: ProgramSource, task: TaskDefinition
) -> Iterator[StaticFinding]:
    """Find names that the tests import and the program lacks; the program is to blame if the name is the task's."""
    proper = task.name.replace("-", "")
    classes = {node.name: node.lineno for node in program.tree.body if isinstance(node, ast.ClassDef)}
    for node in suite.nodes:
        if isinstance(node, ast.ImportFrom) and node.module == "task_code" and "*" not in program.bound_names:
            for name in sorted({alias.name for alias in node.names} - program.bound_names - {"*"}):
                text = f"the tests import {name} from the program, which defines {', '.join(classes) or 'no class'}"
                at_fault, line = (
                    (program, min(classes.values(), default=1)) if name.lower() == proper else (suite, node.lineno)
                )
                yield at_fault.finding(line, "class_missing", text)
