"""Hanoi: many goals in sequence, one for each move; the program solves the puzzle and keeps count of the heights."""

import numpy as np

from grs_agents.sim import Task, utils


class TowersOfHanoi(Task):
    """Move the tower of three disks to the last peg; never put a disk on a smaller one."""

    def __init__(self):
        super().__init__()
        self.max_steps = 14
        self.lang_template = "move the {} disk to the {} peg"
        self.task_completed_desc = "solved the towers of hanoi."
        self.additional_reset()

    def moves(self, count, start, spare, end):
        """The moves (disk, from, to) that bring the smallest ``count`` disks to ``end``."""
        if count == 0:
            return []
        before, after = self.moves(count - 1, start, end, spare), self.moves(count - 1, spare, start, end)
        return [*before, (count - 1, start, end), *after]

    def reset(self, env):
        super().reset(env)
        (position, rotation) = self.get_random_pose(env, (0.12, 0.36, 0.06))
        stand_pose = ((*position[:2], 0.005), rotation)
        env.add_object("hanoi/stand.urdf", stand_pose, "fixed")

        # Pegs 12 cm apart along the stand's y; its plates and the disks are 1 cm thick.
        def place(peg, level):
            return utils.multiply(stand_pose, ((0, (peg - 1) * 0.12, 0.01 + 0.01 * level), (0, 0, 0, 1)))

        words = [("red", "first"), ("orange", "middle"), ("green", "last")]
        disks = [env.add_object(f"hanoi/disk{disk}.urdf", place(0, 2 - disk)) for disk in (0, 1, 2)]

        heights = [3, 0, 0]
        moves = self.moves(3, 0, 1, 2)
        for disk, start, end in moves:
            heights[start] -= 1
            self.add_goal(
                objs=[disks[disk]],
                matches=np.ones((1, 1)),
                targ_poses=[place(end, heights[end])],
                replace=False,
                rotations=False,
                metric="pose",
                params=None,
                step_max_reward=1 / len(moves),
                symmetries=[0],
                language_goal=self.lang_template.format(words[disk][0], words[end][1]),
            )
            heights[end] += 1
