"""A policy of LeRobot, trained on `grs demos` and judged by LeRobot's own evaluation in the task's environment.

grs demos runs/boxes --episodes 200 --replays 3 --camera none
python -m grs_agents.examples.lerobot_evaluation runs/boxes              # trains a small ACT on states first
python -m grs_agents.examples.lerobot_evaluation runs/boxes --policy outputs/train/checkpoints/last/pretrained_model
"""

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.policies import make_pre_post_processors
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.processor import PolicyProcessorPipeline
from lerobot.scripts.lerobot_eval import eval_policy
from lerobot.utils.feature_utils import dataset_to_policy_features

from grs_agents.tasks.envs.lerobot import make_env

VARIATION = {"jitter": 0.03, "yaw": 0.5}  # m, rad: what `grs demos` does to instances unless told otherwise
SIZES: dict[str, Any] = {"dim_model": 128, "dim_feedforward": 256, "n_heads": 4, "n_encoder_layers": 2}
CHUNKS: dict[str, Any] = {"chunk_size": 20, "n_action_steps": 10, "use_vae": False, "device": "cpu"}


def train(data: Path, steps: int, out: Path) -> None:
    """Train a small ACT on states alone, and save it with its processors."""
    dataset = LeRobotDataset(f"grs/{data.name}", root=data)
    features = dataset_to_policy_features(dataset.meta.features)
    inputs = {key: features[key] for key in ("observation.state", "observation.environment_state")}
    config = ACTConfig(input_features=inputs, output_features={"action": features["action"]}, **SIZES, **CHUNKS)
    policy, (before, after) = ACTPolicy(config), make_pre_post_processors(config, dataset_stats=dataset.meta.stats)
    rows: Any = dataset.hf_dataset.with_format("numpy")[:]  # states fit into memory; LeRobot loads frame by frame
    last = np.searchsorted(rows["episode_index"], rows["episode_index"], side="right") - 1
    ahead = np.minimum(np.arange(len(last))[:, None] + np.arange(config.chunk_size), last[:, None])
    frames = {key: torch.tensor(rows[key]) for key in inputs}
    frames |= {"action": torch.tensor(rows["action"][ahead]), "action_is_pad": torch.zeros(ahead.shape).bool()}
    optimizer = torch.optim.AdamW(policy.parameters())
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 1e-3, total_steps=steps)
    for index in torch.randint(len(last), (steps, 64)):
        optimizer.zero_grad()
        policy.forward(before({key: values[index] for key, values in frames.items()}))[0].backward()
        optimizer.step()
        schedule.step()
    for part in (policy, before, after):
        part.save_pretrained(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Evaluate a LeRobot policy in a task of GRS.")
    parser.add_argument("run", type=Path, help="an accepted run; its demonstrations lie in RUN-demos")
    parser.add_argument("--policy", type=Path, help="a checkpoint of an ACT; without, one is trained into RUN-act")
    parser.add_argument("--steps", type=int, default=5000, help="of training, without --policy")
    parser.add_argument("--episodes", type=int, default=20)
    arguments = parser.parse_args()
    run, folder = arguments.run, arguments.policy
    if not folder:
        train(Path(f"{run}-demos"), arguments.steps, folder := Path(f"{run}-act"))
        print(f"trained {arguments.steps} steps in {time.process_time():.0f} CPU s", flush=True)
    policy = ACTPolicy.from_pretrained(folder)
    before, after = make_pre_post_processors(policy.config, pretrained_path=str(folder))
    env = make_env(run, n_envs=2, variation=VARIATION).popitem()[1][0]
    same: Any = PolicyProcessorPipeline(steps=[])  # observations and actions are in LeRobot's keys and units already
    judged = eval_policy(env, policy, same, same, before, after, arguments.episodes, start_seed=10_000)
    print(judged["aggregated"])
