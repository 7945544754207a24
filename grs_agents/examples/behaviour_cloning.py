"""Behaviour cloning with numpy alone: which object goes where next, learned from the expert of an accepted task.

    python -m grs_agents.examples.behaviour_cloning runs/boxes --demonstrations 60 --episodes 50

A decision is a whole pick and place. The policy first classifies (object, slot), since the expert may take any of
several objects to any of several slots and a regression would aim between them; then it regresses the place within the
slot, in the frame of the object's goal, which moves from episode to episode.
"""

import argparse
import math
import time
from pathlib import Path

import numpy as np

from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.variation.types import Variation
from grs_agents.sim.variation.vary import vary_instance
from grs_agents.tasks.grading.primitive_policy import PrimitivePolicy
from grs_agents.tasks.grading.primitive_task import PrimitiveTask, decide, demonstrate, evaluate_policy, random_decision
from grs_agents.tasks.task_folder import open_task_folder

VARIATION = Variation(jitter=0.03, yaw=math.radians(30))
FIRST_TRAINING_SEED = 1000


def main() -> None:
    """Collect demonstrations, learn from them, and evaluate the policy in unseen episodes."""
    parser = argparse.ArgumentParser(description="Behaviour cloning at the level of primitives.")
    parser.add_argument("run", type=Path, help="an accepted run")
    parser.add_argument("--demonstrations", type=int, default=60)
    parser.add_argument("--episodes", type=int, default=50, help="to evaluate in, of seeds 0, 1, ...")
    arguments = parser.parse_args()

    folder = open_task_folder(arguments.run)
    bases = [folder.read_instance(seed) for seed in folder.seeds]

    def draw(seed: int) -> TaskInstance:
        return vary_instance(bases[seed % len(bases)], VARIATION, np.random.default_rng(seed), folder.library)

    start = time.process_time()
    task = PrimitiveTask(bases[0], folder.library)
    seeds = range(FIRST_TRAINING_SEED, FIRST_TRAINING_SEED + arguments.demonstrations)
    shown = [episode for seed in seeds if (episode := demonstrate(task, draw(seed))) is not None]
    collected = time.process_time()
    policy = PrimitivePolicy(shown, seed=0)
    trained = time.process_time()
    print(f"{len(shown)} demonstrations in {collected - start:.1f} CPU s, {policy.slots} pairs of object and slot")
    print(f"trained in {trained - collected:.1f} CPU s")

    rng = np.random.default_rng(0)
    unseen = [draw(seed) for seed in range(arguments.episodes)]
    learned = sum(evaluate_policy(task, instance, lambda now: decide(policy, now)) for instance in unseen)
    chance = sum(evaluate_policy(task, instance, lambda now: random_decision(now, rng)) for instance in unseen)
    print(f"solved of {len(unseen)}: {learned} by the policy, {chance} by random decisions")


if __name__ == "__main__":
    main()
