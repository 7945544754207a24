"""Minari data sets: HDF5 with the spaces of gymnasium, found by ``minari.load_dataset``."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np

from grs_agents.tasks.demos.types import ENVIRONMENT, DatasetCard, Demonstration


def minari_id(card: DatasetCard) -> str:
    """Minari's id of the data set."""
    return f"grs/{re.sub('[^-_a-zA-Z0-9]+', '-', card.name).strip('-') or 'task'}-v0"


def write_minari(demonstrations: Iterable[Demonstration], card: DatasetCard, folder: Path) -> None:
    """Write the data set ``minari_id(card)`` into a folder, which ``MINARI_DATASETS_PATH`` is to name.

    Observations are those of the environment, with the pictures of each camera by its name, which Minari keeps as JPEG.
    """
    from gymnasium.envs import registration

    minari: Any = import_module("minari")
    kind: Any = import_module("minari.dataset.minari_storage").MinariStorage
    path = folder.resolve() / minari_id(card) / "data"
    path.mkdir(parents=True)
    from gymnasium import spaces

    def make_unbounded_box(*shape: int) -> spaces.Box:
        return spaces.Box(-np.inf, np.inf, shape, np.float32)

    dof = len(card.joint_names)
    parts: dict[str, Any] = {
        "joint_positions": make_unbounded_box(dof),
        "joint_velocities": make_unbounded_box(dof),
        "tip": make_unbounded_box(7),
        "commanded_tip": make_unbounded_box(7),
        "suction": spaces.Box(0, 1, (1,), np.float32),
        "objects": make_unbounded_box(len(card.object_names), 7),
        "targets": make_unbounded_box(len(card.object_names), 7),
        "held": spaces.Box(0, 1, (len(card.object_names),), np.float32),
        "open": spaces.Box(0, 1, (len(card.object_names),), np.float32),
    }
    if card.gripper:
        parts["gripper"] = make_unbounded_box(1)
    for camera in card.cameras:
        parts[camera.name] = spaces.Box(0, 255, (camera.height, camera.width, 3), np.uint8)
    observations, actions = spaces.Dict(parts), make_unbounded_box(len(card.action_names))
    storage = kind.new(path, observation_space=observations, action_space=actions)
    metadata: list[dict[str, Any]] = []
    storage.update_episodes(_make_episode_buffers(demonstrations, metadata))
    storage.update_episode_metadata(metadata)
    module, _, name = ENVIRONMENT.partition(":")
    moves = ", ".join(card.action_names)
    import_module(module)  # registers the environment
    registered: Any = cast(Any, registration).spec(name)  # its observations have the data set's names
    storage.update_metadata(
        {
            "dataset_id": minari_id(card),
            "minari_version": minari.__version__,
            "env_spec": replace(registered, kwargs=card.environment_arguments).to_json(),
            "algorithm_name": "the expert of GRS",
            "requirements": [f"grs-agents=={card.versions['grs-agents']}"],
            "description": f"Demonstrations of {card.name} at {card.rate:g} Hz; action: {moves}.",
        }
    )


def _make_episode_buffers(demonstrations: Iterable[Demonstration], metadata: list[dict[str, Any]]) -> Iterator[Any]:
    """Episodes as Minari takes them; appends the metadata of each to ``metadata``."""
    buffer: Any = import_module("minari.data_collector").EpisodeBuffer
    for number, demonstration in enumerate(demonstrations):
        ends = [False] * (demonstration.steps - 1) + [True]
        metadata.append(
            {
                "grs_attempt": demonstration.attempt,
                "grs_base_seed": demonstration.base_seed,
                "grs_instance_hash": demonstration.instance_hash,
                "grs_language": demonstration.language,
                "grs_strict_score": demonstration.strict,
            }
        )
        yield buffer(
            id=number,
            seed=demonstration.attempt,
            observations={
                "joint_positions": demonstration.joint_positions,
                "joint_velocities": demonstration.joint_velocities,
                "tip": demonstration.tip,
                "commanded_tip": demonstration.commanded_tip,
                "suction": demonstration.suction[:, None].astype(np.float32),
                "objects": demonstration.objects,
                "targets": demonstration.targets,
                "held": demonstration.held,
                "open": demonstration.open,
                **({"gripper": demonstration.gripper} if demonstration.gripper is not None else {}),
                **demonstration.images,
            },
            actions=demonstration.actions,
            rewards=demonstration.rewards.tolist(),
            terminations=ends,
            truncations=[False] * demonstration.steps,
            infos={"executed_actions": np.append(demonstration.executed_actions, demonstration.actions[-1:], axis=0)},
        )
