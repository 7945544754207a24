"""The test author and the test fixer."""

import ast
import math
from dataclasses import astuple, dataclass
from typing import Any

from grs_agents.models.offline import program_edits
from grs_agents.models.offline.prompt_text import Json, PromptText
from grs_agents.models.offline.task_reading import find_assets_said_to_move

_TEMPLATE = '''import unittest

import numpy as np

from grs_agents.sim import Environment, utils
from task_code import {title}

MOVES = {moves}
"""Of each object that the robot moves: its asset, which one of that asset, which of the fixed things it goes to (None:
the table), where in x and y of that (None: anywhere), how far around that will do (None: just there), in metres, and by
how much the fixed thing is turned against these x and y, in radians."""


class Test{title}(unittest.TestCase):
    """Does the oracle do this: {description}"""

    def setUp(self):
        self.env = Environment()
        self.task = {title}()
        self.env.set_task(self.task)
        self.obs = self.env.reset()

    def run_oracle(self):
        """Run the episode; gives the total reward, whether it is done, and the actions."""
        obs, info = self.obs, self.env.info
        agent = self.task.oracle(self.env)
        total, done, actions = 0.0, False, []
        for _ in range(self.task.max_steps):
            act = agent.act(obs, info)
            if act is None:
                break
            obs, reward, done, info = self.env.step(act)
            actions.append(act)
            total += reward
            if done:
                break
        return total, done, actions

    def test_the_objects_of_the_task_end_in_their_places(self):
        rigid = self.env.obj_ids["rigid"]
        start = {{item: np.array(self.env.get_object_pose(item)[0]) for item in rigid}}
        for asset, number, *_ in MOVES:
            items = self.env.find(asset)[number : number + 1]
            self.assertTrue(set(items) & set(rigid), f"{{asset}} is not on the table, or cannot be moved")
        total, _, _ = self.run_oracle()
        for asset, number, support, place, extent, turned in MOVES:
            item = self.env.find(asset)[number]
            end = np.array(self.env.get_object_pose(item)[0])
            far = float(np.linalg.norm(end - start[item]))
            self.assertGreater(far, 0.01, f"{{asset}} was not moved, reward {{total:.2f}}")
            if place is not None:
                off, allowed = self.measure_distance_to_place(item, end, support, place, extent, turned)
                told = f"{{asset}} ends {{off}} m off its place, {{allowed}} is allowed"
                self.assertTrue((off < allowed).all(), told)
        for below, above in zip(MOVES, MOVES[1:]):
            if below[2:5] == above[2:5] and above[3] is not None and above[4] is None:  # a stack
                low, high = (self.measure_bottom(self.env.find(asset)[number]) for asset, number, *_ in (below, above))
                self.assertGreater(high, low, f"{{above[0]}} does not end above {{below[0]}}")

    def measure_bottom(self, item):
        """The height of the bottom of an object whose origin is in its middle."""
        position, turn = self.env.get_object_pose(item)
        return position[2] - float(np.dot(self.measure_rises(turn), self.env.get_object_size(item))) / 2

    def measure_rises(self, turn):
        """How far each axis of an object points up or down."""
        return [abs(utils.multiply(((0, 0, 0), turn), (axis, (0, 0, 0, 1)))[0][2]) for axis in np.eye(3).tolist()]

    def measure_distance_to_place(self, item, end, support, place, extent, turned):
        """How far off an object ends, and how far it may, in x and y of what it goes to (None: of the robot)."""
        middle, turn = np.zeros(3), (0, 0, 0, 1)
        if support is not None:
            middle, turn = self.env.get_object_pose(self.env.obj_ids["fixed"][support])
        yaw = utils.quatXYZW_to_eulerXYZ(turn)[2] - turned
        x, y = (end - np.array(middle))[:2]
        here = np.array([np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x])
        if extent is None:
            return np.abs(here - place), np.full(2, 0.03)
        middle = (0, 0) if support is not None else place
        rises = self.measure_rises(self.env.get_object_pose(item)[1])
        width = min(np.delete(self.env.get_object_size(item), int(np.argmax(rises))))
        return np.abs(here - middle), (np.array(extent) - width) / 2 + 0.01

    def test_oracle_succeeds(self):
        total, done, actions = self.run_oracle()
        used = f"{{len(actions)}} of {{self.task.max_steps}} steps used, reward {{total:.2f}}"
        self.assertTrue(done, f"the oracle did not finish: {{used}}")
        self.assertAlmostEqual(total, 1.0, delta=0.01, msg=f"the oracle missed part of the reward: {{used}}")
        for goal in self.task.goals_met(self.env):
            self.assertTrue(goal.met, f"{{goal.goal}}: {{'; '.join(goal.shortfalls)}}")
        moves = [act for act in actions if "pose0" in act and "pose1" in act]
        self.assertEqual(len(moves), len(actions), "an action is not a pick and a place")
        self.assertGreater(len(moves), 0, f"the oracle moved nothing, reward {{total:.2f}}")
        place = np.asarray(moves[-1]["pose1"][0])[:2]
        ends = [np.asarray(self.env.get_object_pose(item)[0])[:2] for item in self.env.obj_ids["rigid"]]
        nearest = min(float(np.linalg.norm(end - place)) for end in ends)
        self.assertLess(nearest, 0.06, f"nothing rests within {{nearest:.3f}} m of {{place}}")


if __name__ == "__main__":
    unittest.main()
'''


@dataclass(frozen=True)
class StatedMove:
    """A row of the program's ``moves``."""

    asset: str
    number: int  # index among the objects of the asset, in the order of their addition
    support: int | None  # index of the fixed object that receives it; None for a place on the table
    place: tuple[float, float] | None  # x, y in the frame of the support or of the robot, m; None if drawn at random
    extent: tuple[float, float] | None  # extents of the zone around the support, m; None for an exact place
    turned: float  # yaw of the support against the frame of place and extents, rad


def author_tests(prompt: PromptText) -> str:
    """Reply to the ``tests`` prompt: two tests of the oracle's behaviour."""
    return f"```python\n{fill_test_template(prompt.section_body('program'), prompt.section_json('task'))}```"


fix_tests = author_tests
"""Reply to the ``fix_tests`` prompt: the tests, rewritten."""


def fill_test_template(program: str, task: Json) -> str:
    """The tests of a program and its task, for the moves in the program's rows and in the task's words."""
    title = program_edits.find_task_class_name(program)
    description = str(task.get("task-description", "")).replace("\\", "").replace('"', "'")
    rows = [astuple(move) for move in _parse_stated_moves(program)]
    stated = {row[0] for row in rows}
    rows += [(asset, 0, None, None, None, 0.0) for asset in find_assets_said_to_move(task) if asset not in stated]
    moves = "".join(f"\n    {row}," for row in rows)
    return _TEMPLATE.format(
        title=title,
        description=" ".join(description.split()),
        moves=f"[{moves}\n]" if rows else "[]",
    )


def _parse_stated_moves(source: str) -> list[StatedMove]:
    """The moves in their order; empty for a program without a list ``moves``."""
    tree = program_edits.parse_syntax_tree(source) or ast.Module([], [])
    values = {ast.unparse(node.targets[0]): node.value for node in ast.walk(tree) if isinstance(node, ast.Assign)}
    rows = values.get("moves")
    if not isinstance(rows, ast.List):
        return []
    calls = sorted(
        (
            node
            for node in ast.walk(tree)
            if isinstance(node, ast.Assign | ast.Expr)
            and isinstance(node.value, ast.Call)
            and ast.unparse(node.value.func) == "env.add_object"
            and len(node.value.args) > 1
        ),
        key=lambda node: node.lineno,
    )
    added: list[tuple[str, str, str]] = []  # variable (none for a fixed object), asset and pose of each, as source
    for node in calls:
        call: Any = node.value
        variable = ast.unparse(node.targets[0]) if isinstance(node, ast.Assign) else ""
        added.append((variable, ast.unparse(call.args[0]).strip("'"), ast.unparse(call.args[1])))
    is_zone = "metric='zone'" in [ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.keyword)]
    moves = [_parse_move_row(row, values, added, is_zone) for row in rows.elts if isinstance(row, ast.Tuple)]
    return [move for move in moves if move is not None]


def _parse_move_row(
    row: ast.Tuple, values: dict[str, ast.expr], added: list[tuple[str, str, str]], is_zone: bool
) -> StatedMove | None:
    """Parse a row ``(variable, label, place, pose, size, offset, rotation)``; None for any other row."""
    if len(row.elts) != 7:
        return None
    item, _, _, pose, size, offset, _ = row.elts
    variable = ast.unparse(item)
    asset = next((asset for name, asset, _ in added if name == variable), None)
    if asset is None:
        return None
    alike = [name for name, added_asset, _ in added if added_asset == asset]
    fixed = [placed for name, _, placed in added if not name]
    at_pose = [placed.lstrip("(").startswith(ast.unparse(pose)) for placed in fixed]
    support = at_pose.index(True) if any(at_pose) else None
    # A named size is the whole zone's; a literal size is the object's spot's.
    extents = _parse_literal(values.get(size.id)) if is_zone and isinstance(size, ast.Name) else None
    origin, shift = _parse_literal(values.get(ast.unparse(pose))), _parse_literal(offset)
    place = None  # drawn at random
    if shift is not None and (support is not None or origin is not None):
        x, y = (0.0, 0.0) if support is not None else origin[0][:2]
        place = x + shift[0], y + shift[1]
    extent = (extents[0], extents[1]) if extents else None
    yaw = 0.0  # of a fixed object whose pose has a rotation
    if support is not None:
        fixed_pose = ast.parse(fixed[support], mode="eval").body
        if isinstance(fixed_pose, ast.Tuple) and len(fixed_pose.elts) == 2:
            rotation = _parse_literal(fixed_pose.elts[1])
            if rotation is not None:
                x, y, z, w = rotation
                yaw = round(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)), 4)
    return StatedMove(asset, alike.index(variable), support, place, extent, yaw)


def _parse_literal(node: ast.expr | None) -> Any:
    """The numbers of a literal; None for an expression."""
    try:
        return None if node is None else ast.literal_eval(node)
    except ValueError:
        return None
