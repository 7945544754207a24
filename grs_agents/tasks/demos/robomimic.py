"""robomimic data sets: an HDF5 file with a group for each episode."""

import json
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.tasks.demos.types import ENVIRONMENT, DatasetCard, Demonstration

FILE: Final = "demos.hdf5"
_GYM: Final = 2
"""robomimic's type of a gymnasium environment."""
_HELD_OUT: Final = 10
"""Every tenth episode is for validation."""


def write_robomimic(demonstrations: Iterable[Demonstration], card: DatasetCard, folder: Path) -> None:
    """Write ``demos.hdf5`` into a folder.

    Observations: ``robot0_joint_pos``, ``robot0_joint_vel``, ``robot0_eef_pos``, ``robot0_eef_quat``,
    ``commanded_tip``, ``suction``, of fingers ``robot0_gripper_qpos`` (their width), ``object`` (objects' poses),
    ``target`` (their places'), ``held``, ``open`` and ``<camera>_image``. Pictures are kept without loss.
    """
    h5py: Any = import_module("h5py")
    with h5py.File(folder / FILE, "w") as file:
        data = file.create_group("data")
        names: list[str] = []
        steps = 0
        for number, demonstration in enumerate(demonstrations):
            names.append(f"demo_{number}")
            _write_episode(data.create_group(names[-1]), demonstration)
            steps += demonstration.steps
        arguments: dict[str, Any] = {
            "env_name": ENVIRONMENT,
            "type": _GYM,
            "env_version": card.versions["grs-agents"],
            "env_kwargs": card.environment_arguments,
        }
        data.attrs["total"], data.attrs["env_args"] = steps, json.dumps(arguments)
        data.attrs["grs"] = card.model_dump_json()
        held_out = set(names[_HELD_OUT - 1 :: _HELD_OUT] or names[-1:])
        mask = file.create_group("mask")
        mask["train"] = np.array([name for name in names if name not in held_out] or names, dtype="S")
        mask["valid"] = np.array(sorted(held_out, key=names.index), dtype="S")


def _write_episode(group: Any, demonstration: Demonstration) -> None:
    done = np.zeros(demonstration.steps, dtype=np.int64)
    done[-1:] = 1
    low_dimensional: dict[str, npt.NDArray[np.float32]] = {  # observations besides pictures, (T + 1, D) each
        "robot0_joint_pos": demonstration.joint_positions,
        "robot0_joint_vel": demonstration.joint_velocities,
        "robot0_eef_pos": demonstration.tip[:, :3],
        "robot0_eef_quat": demonstration.tip[:, 3:],
        "commanded_tip": demonstration.commanded_tip,
        "suction": demonstration.suction[:, None].astype(np.float32),
        "object": demonstration.objects.reshape(len(demonstration.objects), -1),
        "target": demonstration.targets.reshape(len(demonstration.targets), -1),
        "held": demonstration.held,
        "open": demonstration.open,
    }
    if demonstration.gripper is not None:
        low_dimensional["robot0_gripper_qpos"] = demonstration.gripper
    group.attrs["num_samples"], group.attrs["model_file"] = demonstration.steps, ""
    for name in ("attempt", "base_seed", "instance_hash", "instance", "language", "strict"):
        group.attrs[name] = getattr(demonstration, name)
    group["actions"], group["rewards"], group["dones"] = demonstration.actions, demonstration.rewards, done
    group["executed_actions"] = demonstration.executed_actions
    group["states"] = np.concatenate([rows.reshape(len(rows), -1) for rows in low_dimensional.values()], axis=1)[:-1]
    for name, rows in (("obs", slice(None, -1)), ("next_obs", slice(1, None))):
        part = group.create_group(name)
        for key, values in low_dimensional.items():
            part[key] = values[rows]
        for camera, images in demonstration.images.items():
            shown = images[rows]
            part.create_dataset(
                f"{camera}_image", data=shown, chunks=(1, *shown.shape[1:]), compression="gzip", compression_opts=1
            )
