"""A policy of LeRobot, trained on `grs demos` and judged by LeRobot's own evaluation in the task's environment.

grs demos runs/boxes --episodes 100 --camera none
python -m grs_agents.examples.lerobot_evaluation runs/boxes              # trains a small ACT on states first
python -m grs_agents.examples.lerobot_evaluation runs/boxes --policy outputs/train/checkpoints/last/pretrained_model
"""

import argparse
import time
from pathlib import Path
from typing import Any

import torch
from lerobot.configs import FeatureType
from lerobot.datasets.lerobot_dataset import LeRobotDataset, LeRobotDatasetMetadata
from lerobot.policies import make_pre_post_processors
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.processor import PolicyProcessorPipeline
from lerobot.scripts.lerobot_eval import eval_policy
from lerobot.utils.feature_utils import dataset_to_policy_features
from torch.utils.data import DataLoader, RandomSampler

from grs_agents.tasks.envs.lerobot import make_env

VARIATION = {"jitter": 0.03, "yaw": 0.5}  # m, rad: what `grs demos` does to instances unless told otherwise
SIZES: dict[str, Any] = {"dim_model": 128, "dim_feedforward": 256, "n_heads": 4, "n_encoder_layers": 2}
BATCH = 64


def train(name: str, data: Path, steps: int) -> tuple[ACTPolicy, Any, Any]:
    """A small ACT trained on states alone, with its pre- and postprocessor."""
    meta = LeRobotDatasetMetadata(name, root=data)
    features = dataset_to_policy_features(meta.features)
    outputs = {key: feature for key, feature in features.items() if feature.type is FeatureType.ACTION}
    inputs = {key: features[key] for key in ("observation.state", "observation.environment_state")}
    config = ACTConfig(
        input_features=inputs, output_features=outputs, device="cpu", chunk_size=50, n_action_steps=25, **SIZES
    )
    policy, (before, after) = ACTPolicy(config), make_pre_post_processors(config, dataset_stats=meta.stats)
    ahead = {"action": [step / meta.fps for step in range(config.chunk_size)]}
    frames: Any = LeRobotDataset(name, root=data, delta_timestamps=ahead)
    optimizer = torch.optim.AdamW(policy.parameters(), 1e-3)
    for batch in DataLoader(frames, BATCH, sampler=RandomSampler(frames, num_samples=BATCH * steps)):
        optimizer.zero_grad()
        policy.forward(before(batch))[0].backward()
        optimizer.step()
    return policy, before, after


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Evaluate a LeRobot policy in a task of GRS.")
    parser.add_argument("run", type=Path, help="an accepted run; its demonstrations lie in RUN-demos")
    parser.add_argument("--policy", type=Path, help="a checkpoint of `lerobot-train`, an ACT")
    parser.add_argument("--steps", type=int, default=2000, help="of training, without --policy")
    parser.add_argument("--episodes", type=int, default=20)
    arguments = parser.parse_args()
    if arguments.policy:
        policy = ACTPolicy.from_pretrained(arguments.policy)
        before, after = make_pre_post_processors(policy.config, pretrained_path=str(arguments.policy))
    else:
        start, data = time.process_time(), arguments.run.with_name(f"{arguments.run.name}-demos")
        policy, before, after = train(f"grs/{arguments.run.name}", data, arguments.steps)
        print(f"trained {arguments.steps} steps in {time.process_time() - start:.0f} CPU s", flush=True)
    ((_, environments),) = make_env(arguments.run, n_envs=2, variation=VARIATION).items()
    same: Any = PolicyProcessorPipeline(steps=[])  # observations and actions are in LeRobot's keys and units already
    judged = eval_policy(environments[0], policy, same, same, before, after, arguments.episodes, start_seed=10_000)
    print(judged["aggregated"])
