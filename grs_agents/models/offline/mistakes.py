"""Typical mistakes of programs and their tests, as edits of the text; ``offline:faulty`` plants them."""

import ast
import random
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from grs_agents.models.offline import program_edits

Program = Literal["simulation", "tests"]
Edit = Callable[[str, random.Random], str | None]


@dataclass(frozen=True)
class Mistake:
    """A kind of mistake."""

    name: str  # words joined by dashes
    program: Program  # the program that has it
    apply: Edit  # makes the source with the mistake; None if the source does not allow it
    repeatable: bool = True  # the source with it is deterministic


def introduce_suitable_mistake(source: str, program: Program, generator: random.Random) -> tuple[str, str]:
    """Plant a suitable repeatable mistake in ``source``.

    Returns: the source and the mistake's name; unchanged and "" if none suits.
    """
    order = [mistake for mistake in MISTAKES if mistake.program == program and mistake.repeatable]
    generator.shuffle(order)
    for mistake in order:
        changed = mistake.apply(source, generator)
        if changed is not None:
            return changed, mistake.name
    return source, ""


def _make_replace_one(pattern: str, *replacements: str) -> Edit:
    """Replace a random match of ``pattern`` by a random member of ``replacements``."""

    def apply(source: str, generator: random.Random) -> str | None:
        matches = list(re.finditer(pattern, source, re.MULTILINE))
        if not matches:
            return None
        place = generator.choice(matches)
        return source[: place.start()] + place.expand(generator.choice(replacements)) + source[place.end() :]

    return apply


def _make_replace_all(*pairs: tuple[str, str]) -> Edit:
    """Replace all matches of a random pattern of ``pairs`` that occurs."""

    def apply(source: str, generator: random.Random) -> str | None:
        changed = [re.sub(pattern, text, source, flags=re.MULTILINE) for pattern, text in pairs]
        changed = [text for text in changed if text != source]
        return generator.choice(changed) if changed else None

    return apply


def _rename_task_class(source: str, generator: random.Random) -> str | None:
    """Another class name than the tests import, or than the program defines."""
    imported = re.search(r"from task_code import (\w+)", source)
    name = imported[1] if imported else program_edits.find_task_class_name(source)
    parts = re.findall(r"[A-Z][a-z0-9]*", name)
    wrong = generator.choice([f"{name}Task", "".join(parts[:-1] if len(parts) > 2 else reversed(parts)) + "s"])
    return program_edits.replace_identifier(source, name, wrong)


def _place_object_onto_another(source: str, generator: random.Random) -> str | None:
    """An object that starts at the place of another object."""
    poses = [call.args[1] for call in _find_object_additions(source).values() if len(call.args) > 1]
    places = [pose.elts[0] for pose in poses if isinstance(pose, ast.Tuple)]
    if len(places) < 2:
        return None
    moved, target = generator.sample(places, 2)
    return program_edits.replace_nodes(source, [(moved, _source_text_of(source, target))])


def _remove_one_object(source: str, generator: random.Random) -> str | None:
    """Remove an object and its goal, if others are left."""
    additions = _find_object_additions(source)
    names = generator.sample(list(additions), len(additions))
    for name in names if len(names) > 1 else ():
        changed = program_edits.remove_variable(source, name)
        if changed is not None:
            return changed
    return None


def _remove_last_goal(source: str, generator: random.Random) -> str | None:
    """Remove the last goal; the others make up the whole reward."""
    rows = _find_rows_of_moves_list(source)
    if len(rows) > 1:
        return program_edits.replace_nodes(source, [(node, "") for node in rows[-1:]])
    goals = [node for node in _find_call_statements(source) if _name_of_called_method(node.value) == "add_goal"]
    if len(goals) < 2:
        return None
    changed = program_edits.replace_nodes(source, [(node, "") for node in goals[-1:]])
    return re.sub(r"(step_max_reward=)[\d./]+", rf"\g<1>1 / {len(goals) - 1}", changed)


def _add_contradicting_goal(source: str, generator: random.Random) -> str | None:
    """An object that has to be in two places in the end."""
    rows = [row for row in _find_rows_of_moves_list(source) if len(row.elts) > 3]
    if not rows:
        goals = [
            node.value for node in _find_call_statements(source) if _name_of_called_method(node.value) == "add_goal"
        ]
        lists = [part for goal in goals for part in ast.walk(goal) if isinstance(part, ast.List) and part.elts]
        if len(goals) < 2 or len(lists) < 2:
            return None
        texts = [_source_text_of(source, part) for part in [*lists[0].elts, lists[-1].elts[-1]]]
        return program_edits.replace_nodes(source, [(lists[0], f"[{', '.join(texts)}]")])
    row = generator.choice(rows)
    elsewhere = [_source_text_of(source, part) for part in row.elts]
    elsewhere[3] = "((0.45, -0.42, 0.05), (0, 0, 0, 1))"
    return program_edits.replace_nodes(source, [(row, f"{_source_text_of(source, row)}, ({', '.join(elsewhere)})")])


def _shrink_container(source: str, generator: random.Random) -> str | None:
    """A container or zone too small for its objects."""
    if changed := program_edits.scale_target_sizes(source, 0.3):
        return changed
    small = r'\g<1>self.fill_template("container/container-template.urdf", {"DIM": (0.08, 0.08, 0.04)})'
    changed = re.sub(r'(add_object\()"(?:container|bowl)/\w+\.urdf"', small, source, count=1)
    return changed if changed != source else None


def _change_expected_position(source: str, generator: random.Random) -> str | None:
    """An expected position that the task does not name."""
    numbers = list(re.finditer(r"(?<=abs\([a-z] - )0\.\d+|(?<=\[\"pose1\"\]\[0\]\)\[:2\])", source))
    if not numbers:
        return None
    number = generator.choice(numbers)
    wrong = f"{float(number[0]) - 0.13:.3f}" if number[0] else " + 0.15"
    return source[: number.start()] + wrong + source[number.end() :]


def _change_expected_step_count(source: str, generator: random.Random) -> str | None:
    """A number of actions that the task does not need."""
    count = re.search(r"(?<=assertEqual\()(steps|len\(\w+\)), ([^,]+)", source)
    if count is None:
        return None
    wrong = str(int(count[2]) + 1) if count[2].isdigit() else f"{count[2]} + 1"
    return f"{source[: count.start(2)]}{wrong}{source[count.end(2) :]}"


def _remove_assertions(source: str, generator: random.Random) -> str | None:
    """Tests that print instead of asserting."""
    checks = [node for node in _find_call_statements(source) if _name_of_called_method(node.value).startswith("assert")]
    return program_edits.replace_nodes(source, [(node, 'print("checked")') for node in checks]) if checks else None


def _add_goal_count_assertion(source: str, generator: random.Random) -> str | None:
    """A test of how the program is built."""
    wanted = generator.choice((1, 7))
    claim = rf'\1self.assertEqual(len(self.task.goals), {wanted}, "number of goals")\n\g<0>'
    changed = re.sub(r"^( +)self\.assert", claim, source, count=1, flags=re.MULTILINE)
    return changed if changed != source else None


def _move_oracle_before_reset(source: str, generator: random.Random) -> str | None:
    """Create the oracle before the scene is reset."""
    agent = re.search(r"^ +agent = self\.task\.oracle\(self\.env\)\n", source, re.MULTILINE)
    reset = re.search(r"^( +)(?:self\.)?obs = self\.env\.reset\(\)\n", source, re.MULTILINE)
    if agent is None or reset is None or agent.start() < reset.start():
        return None
    without = (
        source[: agent.start()] + agent[0].replace("self.task.oracle(self.env)", "self.agent") + source[agent.end() :]
    )
    early = f"{reset[1]}self.agent = self.task.oracle(self.env)\n"
    return without[: reset.start()] + early + without[reset.start() :]


def _find_object_additions(source: str) -> dict[str, ast.Call]:
    """The calls that add a movable object, by its variable."""
    additions: dict[str, ast.Call] = {}
    for node in ast.walk(program_edits.parse_syntax_tree(source) or ast.Module([], [])):
        if (
            isinstance(node, ast.Assign)
            and isinstance(node.value, ast.Call)
            and _name_of_called_method(node.value) == "add_object"
        ):
            target, fixed = node.targets[0], len(node.value.args) > 2
            if isinstance(target, ast.Name) and not fixed:
                additions[target.id] = node.value
    return additions


def _find_rows_of_moves_list(source: str) -> list[ast.Tuple]:
    """The rows of the list ``moves`` of a program by the offline author; empty for other programs."""
    for node in ast.walk(program_edits.parse_syntax_tree(source) or ast.Module([], [])):
        if (
            isinstance(node, ast.Assign)
            and isinstance(node.value, ast.List)
            and _source_text_of(source, node.targets[0]) == "moves"
        ):
            return [row for row in node.value.elts if isinstance(row, ast.Tuple)]
    return []


def _find_call_statements(source: str) -> list[ast.Expr]:
    """The statements that consist of a call."""
    nodes = ast.walk(program_edits.parse_syntax_tree(source) or ast.Module([], []))
    return [node for node in nodes if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)]


def _name_of_called_method(node: ast.expr) -> str:
    """The name of a called method; empty for any other expression."""
    return node.func.attr if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) else ""


def _source_text_of(source: str, node: ast.AST) -> str:
    return ast.get_source_segment(source, node) or ""


_ENDLESS = r"\g<0>\1pose = (None, None)\n\1while pose[0] is None:\n\1    pose = (None, None)\n"
_PROGRAM_MISTAKES: dict[str, Edit] = {
    "wrong-asset-name": _make_replace_one(r'(?<=add_object\(")([\w/-]+)\.urdf', r"\1Can.urdf", r"\1_1.urdf"),
    "ignored-argument": _make_replace_all((r"\bstep_max_reward=", "max_reward=")),
    "wrong-argument": _make_replace_all((r"\btarg_poses=", "target_poses="), (r', "fixed"\)', ", fixed=True)")),
    "wrong-method": _make_replace_all(
        (r"env\.add_object\b", "env.add_objects"),
        (r"utils\.multiply\b", "utils.compose"),
        (r"\.add_goal\b", ".add_goals"),
    ),
    "missing-import": _make_replace_all(
        (r"^import numpy as np\n", ""), (r"^(from grs_agents\.sim import \w+), .*$", r"\1")
    ),
    "syntax": _make_replace_one(r"^(class \w+\(Task\)|    def reset\(self, env\)):", r"\1"),
    "no-base-call": _make_replace_one(r"^ +super\(\)\.__init__\(\)\n", ""),
    "wrong-class-name": _rename_task_class,
    "endless-loop": _make_replace_one(r"^( +)super\(\)\.reset\(env\)\n", _ENDLESS),
    "too-few-steps": _make_replace_one(r"(?<=max_steps = )\d+", "1", "2"),
    "overlap-at-start": _place_object_onto_another,
    "target-out-of-reach": _make_replace_one(
        r"self\.find_place\(env, (\w+_size).*\)$", r"((0.95, 0.45, \1[2] / 2), (0, 0, 0, 1))"
    ),
    "container-too-small": _shrink_container,
    "object-left-out": _remove_one_object,
    "goal-missing": _remove_last_goal,
    "goals-contradict": _add_contradicting_goal,
    "rewards-below-one": _make_replace_all((r"(step_max_reward=)", r"\g<1>0.75 * ")),
}
_TEST_MISTAKES: dict[str, Edit] = {
    "wrong-class-name": _rename_task_class,
    "missing-import": _make_replace_all((r"^import numpy as np\n", ""), (r"^from grs_agents\.sim import .*\n", "")),
    "wrong-method": _make_replace_all((r"env\.get_object_pose\b", "env.get_pose"), (r"agent\.act\b", "agent.action")),
    "info-misused": _make_replace_all((r"(self\.env\.info)\b(?!\[)", r"\1[0]")),
    "wrong-count": _change_expected_step_count,
    "wrong-place": _change_expected_position,
    "asserts-nothing": _remove_assertions,
    "reward-not-summed": _make_replace_all((r"total \+= reward", "total = reward")),
    "reward-scale": _make_replace_all(
        (r"(assertAlmostEqual\(total, )1(?:\.0)?", r"\g<1>3.0"), (r"(assertAlmostEqual\(total, )1(?:\.0)?", r"\g<1>100")
    ),
    "counts-goals": _add_goal_count_assertion,
    "too-tight-tolerance": _make_replace_one(r"(?<=delta=)0\.0[2-9]\d*|(?<=\(nearest, )0\.\d+", "0.00001"),
    "stops-early": _make_replace_all((r"range\(self\.task\.max_steps\)", "range(1)")),
    "oracle-before-reset": _move_oracle_before_reset,
    "flaky": _make_replace_one(r"^( +)return total,", r"\1import os\n\n\1total += os.urandom(1)[0] % 2\n\g<0>"),
}
MISTAKES: tuple[Mistake, ...] = (
    *(Mistake(name, "simulation", edit) for name, edit in _PROGRAM_MISTAKES.items()),
    *(Mistake(name, "tests", edit, name != "flaky") for name, edit in _TEST_MISTAKES.items()),
)
