"""Typical mistakes as edits of a right program or of right tests; each says where it does not apply with ``None``."""

import random
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Edit = Callable[[str, random.Random], str | None]


@dataclass(frozen=True)
class PlantedMistake:
    """A kind of mistake."""

    name: str
    program: Literal["simulation", "tests"]  # where it is made, and so which of the two is at fault
    apply: Edit
    right_tests: bool = False  # the oracle does what the program asks, and tests of the task's words fail


_ADDED = re.compile(r"^ +(?P<name>\w+) = env\.add_object\(\"(?P<asset>[\w/]+\.urdf)\", \(\((?P<xyz>[^)]*)\).*\n", re.M)
_GOAL_CALL = re.compile(r"^        self\.add_goal\((?:.*\)\n|\n(?:            .*\n)+        \)\n)", re.M)
_LISTS = re.compile(r"\[(\w+(?:, \w+)+)\]")


def _swap(pattern: str, replacement: str, count: int = 1) -> Edit:
    """Replace a pattern, if it is there."""

    def apply(source: str, rng: random.Random) -> str | None:
        del rng
        text, replaced = re.subn(pattern, replacement, source, count=count, flags=re.M)
        return text if replaced and text != source else None

    return apply


def _other_asset(source: str, rng: random.Random) -> str | None:
    movable = [match["asset"] for match in _ADDED.finditer(source) if not match["asset"].startswith("container/")]
    if not movable:
        return None
    chosen = rng.choice(movable)
    return source.replace(chosen, rng.choice(["HOPE/Corn.urdf", "HOPE/Yogurt.urdf", "block/green_block.urdf"]))


def _misspelt_asset(source: str, rng: random.Random) -> str | None:
    name = rng.choice(re.findall(r"\"([\w/-]+)\.urdf\"", source))
    return source.replace(f"{name}.urdf", f"{name}{rng.choice(['Box', '_1', 's'])}.urdf")


def _overlap(source: str, rng: random.Random) -> str | None:
    added = [match for match in _ADDED.finditer(source) if '"fixed"' not in match[0]]
    if len(added) < 2:
        return None
    first, second = rng.sample(added, 2)
    x, y, z = first["xyz"].split(",")
    beside = f"{float(x) + 0.008:.3f}, {float(y) + 0.005:.3f},{z}"
    return source.replace(second["xyz"], beside)


def _left_out_of_goal(source: str, rng: random.Random) -> str | None:
    lists = [match for match in _LISTS.finditer(source) if match.start() > source.find("def reset")]
    if not lists:
        return None
    match = rng.choice(lists)
    names = match[1].split(", ")
    if "stacked" in source[match.start() - 10 : match.start()]:
        return None
    names.remove(rng.choice(names))
    return source[: match.start()] + f"[{', '.join(names)}]" + source[match.end() :]


def _left_out_whole(source: str, rng: random.Random) -> str | None:
    added = [match for match in _ADDED.finditer(source) if '"fixed"' not in match[0]]
    if len(added) < 3:
        return None
    match = rng.choice(added)
    name, text = match["name"], source.replace(match[0], "")
    text = re.sub(rf"^ +\({name}, .*\n", "", text, flags=re.M)
    text = re.sub(rf"\({name}, \"[^\"]*\"\), |, \({name}, \"[^\"]*\"\)", "", text)
    text = re.sub(rf"\[{name}, |, {name}\b(?=[,\]])", lambda part: "[" if part[0].startswith("[") else "", text)
    return None if re.search(rf"\b{name}\b", text) else text


def _last_goal_missing(source: str, rng: random.Random) -> str | None:
    del rng
    goals = list(_GOAL_CALL.finditer(source))
    if len(goals) < 2:
        rows = re.findall(r"^            \(\w+, \".*\),\n", source, re.M)
        return source.replace(rows[-1], "") if len(rows) > 2 else None
    text = source[: goals[-1].start()] + source[goals[-1].end() :]
    return re.sub(r"step_max_reward=0\.5", "step_max_reward=1.0", text)


def _reversed_stack(source: str, rng: random.Random) -> str | None:
    stacks = list(re.finditer(r"stacked\(\[(\w+), (\w+)\]\)", source))
    if not stacks:
        return None
    match = rng.choice(stacks)
    return source[: match.start()] + f"stacked([{match[2]}, {match[1]}])" + source[match.end() :]


def _swapped_goals(source: str, rng: random.Random) -> str | None:
    """Two objects take each other's part in the goals."""
    rows = list(re.finditer(r"^            \((\w+), \"[^\n]*\),\n", source, re.M))
    if len(rows) > 1:
        first, second = rng.sample([row[1] for row in rows], 2)
    else:
        begin = source.find("add_goal")
        lists = [match[1].split(", ") for match in _LISTS.finditer(source, begin)]
        names = sorted({name for row in lists for name in row})
        if len(lists) < 2 or len(names) < 3:
            return None
        first, second = rng.choice(lists[0]), rng.choice(lists[1])
        if first == second:
            return None
    begin = source.find("add_goal") if len(rows) < 2 else rows[0].start()
    swap = {first: second, second: first}
    goals = re.sub(rf"\b({first}|{second})\b(?=[,\]])", lambda match: swap[match[1]], source[begin:])
    return source[:begin] + goals if goals != source[begin:] else None


def _other_place(source: str, rng: random.Random) -> str | None:
    """A goal has the place of another goal."""
    places = sorted(set(re.findall(r"params=\[\((\w+_pose), \w+\)\]", source)))
    if len(places) < 2:
        return None
    first, second = rng.sample(places, 2)
    return source.replace(f"targ_poses=[{first}]", f"targ_poses=[{second}]").replace(
        f"params=[({first},", f"params=[({second},"
    )


def _moved_container(source: str, rng: random.Random) -> str | None:
    """The container does not stand where the photo shows it."""
    match = re.search(r"(?:container|bowl)/\w+\.urdf\", \(\((\d\.\d+), (-?\d\.\d+),", source)
    if not match:
        return None
    x, y = float(match[1]), float(match[2])
    moved = f"{x - 0.13:.3f}, {y:.3f}," if rng.random() < 0.5 else f"{x:.3f}, {y - 0.06:.3f},"
    return source.replace(match[0], match[0].replace(f"{match[1]}, {match[2]},", moved))


def _twice(source: str, rng: random.Random) -> str | None:
    added = [match for match in _ADDED.finditer(source) if '"fixed"' not in match[0]]
    if not added:
        return None
    match = rng.choice(added)
    z = match["xyz"].rpartition(",")[2]
    again = match[0].replace(f"{match['name']} = ", "", 1).replace(match["xyz"], f"0.45, -0.45,{z}")
    return source.replace(match[0], match[0] + again)


def _two_goals(source: str, rng: random.Random) -> str | None:
    """An object of a later goal is asked into the container first."""
    quoted = re.search(r"inside\(\[([^\]]+)\], ", source)
    names = [match["name"] for match in _ADDED.finditer(source) if '"fixed"' not in match[0]]
    others = [name for name in names if quoted and name not in quoted[1].split(", ")]
    if not quoted or not others or "for item" in source:
        return None
    return source.replace(quoted[0], f"inside([{quoted[1]}, {others[-1]}], ")


def _made_fixed(source: str, rng: random.Random) -> str | None:
    del rng
    added = [match for match in _ADDED.finditer(source) if '"fixed"' not in match[0]]
    if not added:
        return None
    match = added[-1]  # others may be stacked on the first objects
    return source.replace(match[0], match[0].rstrip("\n")[:-1] + ', "fixed")\n')


def _shifted_expectation(source: str, rng: random.Random) -> str | None:
    """A place that the tests expect is elsewhere."""
    asserted = source[source.find("def test") :]
    numbers = [number for number in re.findall(r"(?<![\w.])0\.[1-9]\d*(?![\w])", asserted) if float(number) >= 0.3]
    numbers += re.findall(r"(?<=BOX = \()0\.\d+", source)
    if not numbers:
        return None
    chosen = rng.choice([number for number in numbers if number != "0.99"] or numbers)
    return re.sub(rf"(?<![\w.]){re.escape(chosen)}(?!\w)", f"{float(chosen) - 0.14:.3f}", source)


def _wrong_count(source: str, rng: random.Random) -> str | None:
    match = re.search(r"assertEqual\((?:self\.)?(?:steps|len\(rewards\)), (\d)", source)
    if not match:
        return None
    return source.replace(match[0], match[0][:-1] + str(int(match[1]) + rng.choice([-1, 1])))


def _no_assertions(source: str, rng: random.Random) -> str | None:
    del rng
    return re.sub(r"self\.assert\w+\(", "print(", source)


_RESET = "        super().reset(env)\n"
_FIRST_TEST = r"(    def test_\w+\(self\):\n)"

MISTAKES: tuple[PlantedMistake, ...] = (
    PlantedMistake("misspelt_asset", "simulation", _misspelt_asset),
    PlantedMistake("other_asset", "simulation", _other_asset, right_tests=True),
    PlantedMistake("unknown_argument", "simulation", _swap(r"metric=\"zone\"", 'metric="area"')),
    PlantedMistake("unknown_method", "simulation", _swap(r"self\.add_goal\(", "self.append_goal(")),
    PlantedMistake("import_left_out", "simulation", _swap(r"import Task, \w+", "import Task")),
    PlantedMistake("unknown_import", "simulation", _swap(r"import Task,", "import Task, Pose,")),
    PlantedMistake("syntax", "simulation", _swap(r"def reset\(self, env\):", "def reset(self, env)")),
    PlantedMistake("overlap", "simulation", _overlap),
    PlantedMistake("few_steps", "simulation", _swap(r"self\.max_steps = \d+", "self.max_steps = 1")),
    PlantedMistake(
        "endless_loop",
        "simulation",
        _swap(
            _RESET.replace("(", r"\(").replace(")", r"\)"), _RESET + "        while not self.goals:\n            pass\n"
        ),
    ),
    PlantedMistake("rewards_too_small", "simulation", _swap(r"step_max_reward=0\.5", "step_max_reward=0.25")),
    PlantedMistake("class_name", "simulation", _swap(r"^class (\w+)\(Task\)", r"class \1Task(Task)")),
    PlantedMistake("out_of_goal", "simulation", _left_out_of_goal, right_tests=True),
    PlantedMistake("object_left_out", "simulation", _left_out_whole, right_tests=True),
    PlantedMistake("goal_missing", "simulation", _last_goal_missing, right_tests=True),
    PlantedMistake("reversed_stack", "simulation", _reversed_stack, right_tests=True),
    PlantedMistake("swapped_objects", "simulation", _swapped_goals, right_tests=True),
    PlantedMistake("other_place", "simulation", _other_place, right_tests=True),
    PlantedMistake("moved_container", "simulation", _moved_container, right_tests=True),
    PlantedMistake("near_not_inside", "simulation", _swap(r"\binside\b", "near", 9), right_tests=True),
    PlantedMistake("object_twice", "simulation", _twice, right_tests=True),
    PlantedMistake("two_goals", "simulation", _two_goals, right_tests=True),
    PlantedMistake("made_fixed", "simulation", _made_fixed),
    PlantedMistake("small_place", "simulation", _swap(r"size = \(0\.\d+, 0\.\d+,", "size = (0.05, 0.05,")),
    PlantedMistake("out_of_reach", "simulation", _swap(r"_pose = \(\(0\.\d+, 0?\.?\d*", "_pose = ((0.95, 0.3")),
    PlantedMistake(
        "no_free_place",
        "simulation",
        _swap(
            _RESET.strip().replace("(", r"\(").replace(")", r"\)"),
            "super().reset(env)\n        x = self.get_random_pose(env, (2.0, 2.0, 0.1))[0][0]",
        ),
    ),
    PlantedMistake("wrong_count", "tests", _wrong_count),
    PlantedMistake("other_place_expected", "tests", _shifted_expectation),
    PlantedMistake("asserts_nothing", "tests", _no_assertions),
    PlantedMistake(
        "flaky",
        "tests",
        _swap(r"^( +)return (.*)$", r"\1import os\n\1self.assertEqual(os.urandom(1)[0], 7)\n\1return \2"),
    ),
    PlantedMistake("reward_not_summed", "tests", _swap(r"total \+= reward", "total = reward")),
    PlantedMistake("info_as_list", "tests", _swap(r"info = (.*)env\.info$", r"info = \1env.info[0]")),
    PlantedMistake(
        "info_success",
        "tests",
        _swap(
            r"^( +)obs, reward, done, info = (.*)$",
            r"\1obs, reward, done, info = \2\n\1assert info['success'] is not None",
        ),
    ),
    PlantedMistake(
        "reward_scale", "tests", _swap(r"(assertAlmostEqual\([^,\n]*(?:total|rewards\))), 1\.0", r"\1, 3.0")
    ),
    PlantedMistake(
        "counts_goals",
        "tests",
        _swap(
            r"^( +)(self\.assert\w+\(.*(?:done|total|rewards))",
            r"\1self.assertEqual(len(self.task.goals), 9, 'goals')\n\1\2",
        ),
    ),
    PlantedMistake("tight", "tests", _swap(r"assertLess\((.*), 0\.\d+, f", r"assertLess(\1, 0.0001, f")),
    PlantedMistake(
        "oracle_before_reset",
        "tests",
        _swap(
            r"^( +)self\.env\.set_task\(self\.task\)$",
            r"\1self.env.set_task(self.task)\n\1self.agent = self.task.oracle(self.env)\n\1self.agent.act(None, None)",
        ),
    ),
    PlantedMistake("unknown_import", "tests", _swap(r"import Environment", "import Environment, TestTask")),
    PlantedMistake("class_name", "tests", _swap(r"(from task_code import \w+)", r"\1Task as Wrong")),
    PlantedMistake("unknown_attribute", "tests", _swap(r"env\.obj_ids\[\"rigid\"\]", "env.rigid_objects")),
    PlantedMistake("skipped", "tests", _swap(_FIRST_TEST, r"    @unittest.skip('later')\n\1")),
    PlantedMistake("one_step_only", "tests", _swap(r"range\((self\.)?task\.max_steps\)", "range(1)")),
    PlantedMistake(
        "one_step_allowed", "tests", _swap(r"^( +)agent = (.*)$", r"\1self.task.max_steps = 1\n\1agent = \2")
    ),
    PlantedMistake("undefined_name", "tests", _swap(_FIRST_TEST, r"\1        self.assertGreater(tolerance, 0)\n")),
    PlantedMistake("syntax", "tests", _swap(_FIRST_TEST, r"\1        self.assertTrue(True\n")),
    PlantedMistake("no_reset", "tests", _swap(r"self\.env\.reset\(\)|env\.reset\(\)", "None")),
    PlantedMistake(
        "unpacks_too_many",
        "tests",
        _swap(r"^( +)([a-z_, ]+) = (self\.env|env)\.obj_ids\[\"rigid\"\]", r'\1\2, extra = \3.obj_ids["rigid"]'),
    ),
    PlantedMistake(
        "order_of_ids",
        "tests",
        _swap(
            r"^( +)(\w+), (\w+)((?:, \w+)*) = (self\.env|env)\.obj_ids\[\"rigid\"\]",
            r'\1\3, \2\4 = \5.obj_ids["rigid"]',
        ),
    ),
    PlantedMistake(
        "words_compared",
        "tests",
        _swap(_FIRST_TEST, r"\1        self.assertEqual(self.task.lang_template, 'do the task')\n"),
    ),
    PlantedMistake(
        "object_added",
        "tests",
        _swap(
            r"^( +)agent = (.*)$",
            r"\1self.env.add_object('block/green_block.urdf', ((0.45, 0.0, 0.02), (0, 0, 0, 1)))\n\1agent = \2",
        ),
    ),
    PlantedMistake(
        "act_without_arguments",
        "tests",
        _swap(r"agent\.act\(obs, info\)|agent\.act\(self\.obs, info\)", "agent.act(obs['camera'], info)"),
    ),
    PlantedMistake(
        "height_zero", "tests", _swap(r"assertAlmostEqual\((\w+z|can\[2\]), 0\.\d+", r"assertAlmostEqual(\1, 0.0")
    ),
    PlantedMistake(
        "start_as_end",
        "tests",
        _swap(
            _FIRST_TEST,
            r"\1        self.env.reset()\n        self.assertTrue(self.task.done(), 'the task is not done')\n",
        ),
    ),
)
"""The kinds of mistakes, those of the program first."""
