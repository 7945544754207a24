"""Rollouts one after the other in one world."""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from rerun.chunk import RrdReader

from grs_agents.base.errors import InputError
from grs_agents.base.trace.events import Rollout
from grs_agents.library.library import Library
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.views.rerun.recording import Paths, RerunRecording
from grs_agents.views.rerun.rollout_view import RolloutView, rollout_duration


def rollout(
    folder: Path, color: tuple[float, float, float, float] | None, role: Literal["task", "bystander"] = "task"
) -> Rollout:
    """One block without a recording."""
    pose = ((0.5, 0.0, 0.02), (0.0, 0.0, 0.0, 1.0))
    block = InstanceObject(id=3, asset="block/red_block.urdf", pose=pose, color=color, role=role)
    instance = TaskInstance(task="T", seed=0, max_steps=1, timestep=0.002, objects=(block,), goals=())
    (folder / "instance.json").write_text(instance.model_dump_json())
    return Rollout(seed=0, reward=0.0, outcome="nothing_to_do", instance="instance.json")


def test_shapes_are_logged_again_only_where_they_differ(
    recording: RerunRecording, tmp_path: Path, library: Library
) -> None:
    view = RolloutView(tmp_path, library)
    for color in (None, None, (0.0, 1.0, 0.0, 1.0)):
        assert view.show_rollout(recording, rollout(tmp_path, color)) == 0.0
    recording.close()
    chunks = [chunk.to_record_batch() for chunk in RrdReader(tmp_path / "a.rrd").stream().to_chunks()]
    paths = [batch.schema.metadata[b"rerun:entity_path"].decode() for batch in chunks]
    shapes = [path for path in paths if path.startswith(f"{Paths.WORLD}/object_3/looks_") and path.endswith("/0")]
    assert len(shapes) == len(set(shapes)) == 2
    cleared = [path for path, batch in zip(paths, chunks, strict=True) if "Clear:is_recursive" in batch.schema.names]
    assert cleared.pop(0) == f"{Paths.WORLD}/not_yet"  # what stood there before the first rollout
    assert cleared == [shapes[0].removesuffix("/0")] or cleared == [shapes[1].removesuffix("/0")]


def test_a_bystander_is_called_one(recording: RerunRecording, tmp_path: Path, library: Library) -> None:
    RolloutView(tmp_path, library).show_rollout(recording, rollout(tmp_path, None, "bystander"))
    recording.close()
    chunks = [chunk.to_record_batch() for chunk in RrdReader(tmp_path / "a.rrd").stream().to_chunks()]
    assert "red block (bystander)" in str([batch.to_pydict() for batch in chunks])


def test_a_broken_recording_is_an_input_error_and_a_missing_one_lasts_no_time(
    recording: RerunRecording, tmp_path: Path, library: Library
) -> None:
    event = Rollout(seed=0, reward=0.0, outcome="error", recording="r.npz")
    assert rollout_duration(tmp_path, event) == 0.0
    with pytest.raises(InputError, match=r"cannot read .*r\.npz"):
        RolloutView(tmp_path, library).show_rollout(recording, event)


def test_a_rollout_lasts_as_long_as_its_recording(tmp_path: Path) -> None:
    np.savez(tmp_path / "r.npz", times=np.array([1.0, 1.5, 3.25]))
    assert rollout_duration(tmp_path, Rollout(seed=0, reward=0.0, outcome="success", recording="r.npz")) == 2.25
