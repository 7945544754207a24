"""Tasks of two blocks, as folders of task instances."""

from pathlib import Path

from grs_agents.sim import Goal, InstanceObject, TaskInstance
from grs_agents.tasks.demos.production import DemoOrder

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
ORDER = DemoOrder(episodes=3, cameras=("front", "wrist"), size=(16, 24), renderer="rays")


def two_blocks(seed: int, target_x: float = 0.5) -> TaskInstance:
    """Two blocks that are to be put to the left; they begin elsewhere for each seed."""
    blocks = [
        InstanceObject(
            id=number, asset="block/block.urdf", pose=((0.4 + 0.12 * number, -0.1 - 0.03 * seed, 0.02), UPRIGHT)
        )
        for number in (1, 2)
    ]
    goals = [
        Goal(
            objects=(number,),
            matches=((1,),),
            targets=(((target_x, 0.05 + 0.1 * number, 0.02), UPRIGHT),),
            replace=False,
            rotations=False,
            metric="pose",
            max_reward=0.5,
            symmetries=(0.0,),
            language=f"put block {number} to the left",
        )
        for number in (1, 2)
    ]
    return TaskInstance(
        task="PutBlocksLeft", seed=seed, max_steps=4, timestep=0.004, objects=tuple(blocks), goals=tuple(goals)
    )


def write_instances(folder: Path, *instances: TaskInstance) -> Path:
    """A folder as ``grs instances`` writes it."""
    (folder / "instances").mkdir(parents=True)
    for instance in instances:
        file = folder / "instances" / f"seed_{instance.seed}.json"
        file.write_text(instance.model_dump_json(), encoding="utf-8")
    return folder
