"""The test author and the test fixer."""

from grs_agents.models.offline import program_edits
from grs_agents.models.offline.prompt_text import PromptText
from grs_agents.models.offline.task_reading import find_assets_said_to_move

_TEMPLATE = '''import unittest

import numpy as np

from grs_agents.sim import Environment
from task_code import {title}


class Test{title}(unittest.TestCase):
    """Does the oracle do this: {description}"""

    def setUp(self):
        self.env = Environment()
        self.task = {title}()
        self.env.set_task(self.task)

    def run_oracle(self):
        """Run one episode; gives the total reward, whether it is done, the actions, and where each object began."""
        obs = self.env.reset()
        info = self.env.info
        start = {{item: np.array(info[item][0]) for item in self.env.obj_ids["rigid"]}}
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
        return total, done, actions, start

    def test_oracle_succeeds(self):
        total, done, actions, _ = self.run_oracle()
        used = f"{{len(actions)}} of {{self.task.max_steps}} steps used, reward {{total:.2f}}"
        self.assertTrue(done, f"the oracle did not finish: {{used}}")
        self.assertAlmostEqual(total, 1.0, delta=0.01, msg=f"the oracle missed part of the reward: {{used}}")
        for goal in self.task.goals_met(self.env):
            self.assertTrue(goal.met, f"{{goal.goal}}: {{'; '.join(goal.shortfalls)}}")

    def test_oracle_picks_and_places_objects(self):
        total, _, actions, _ = self.run_oracle()
        moves = [act for act in actions if "pose0" in act and "pose1" in act]
        self.assertEqual(len(moves), len(actions), "an action is not a pick and a place")
        self.assertGreater(len(moves), 0, f"the oracle moved nothing, reward {{total:.2f}}")
        place = np.asarray(moves[-1]["pose1"][0])[:2]
        ends = [np.asarray(self.env.get_object_pose(item)[0])[:2] for item in self.env.obj_ids["rigid"]]
        nearest = min(float(np.linalg.norm(end - place)) for end in ends)
        self.assertLess(nearest, {tolerance}, f"nothing rests within {{nearest:.3f}} m of {{place}}")

    def test_the_objects_that_the_task_names_are_moved(self):
        total, _, _, start = self.run_oracle()
        self.assertTrue(start, "nothing on the table can be moved")
        for asset in {moved}:
            items = [item for item in self.env.find(asset) if item in start]
            self.assertTrue(items, f"{{asset}} is not on the table, or cannot be moved")
            far = max(float(np.linalg.norm(self.env.get_object_pose(item)[0] - start[item])) for item in items)
            self.assertGreater(far, 0.01, f"{{asset}} was not moved, reward {{total:.2f}}")


if __name__ == "__main__":
    unittest.main()
'''
_TOLERANCE = 0.06
"""How far from where it was put an object may come to rest, metres."""


def author_tests(prompt: PromptText) -> str:
    """Reply to the ``tests`` prompt: three tests of what the oracle does's behaviour."""
    return f"```python\n{_fill_test_template(prompt, _TOLERANCE)}```"


def fix_tests(prompt: PromptText) -> str:
    """Reply to the ``fix_tests`` prompt: the tests written anew; with more tolerance where they are that already."""
    fresh = _fill_test_template(prompt, _TOLERANCE)
    if fresh.strip() == prompt.section_body("tests").strip():
        fresh = _fill_test_template(prompt, 2 * _TOLERANCE)
    return f"```python\n{fresh}```"


def _fill_test_template(prompt: PromptText, tolerance: float) -> str:
    title, task = program_edits.find_task_class_name(prompt.section_body("program")), prompt.section_json("task")
    description = str(task.get("task-description", "")).replace("\\", "").replace('"', "'")
    moved = find_assets_said_to_move(task)
    return _TEMPLATE.format(title=title, description=" ".join(description.split()), tolerance=tolerance, moved=moved)
