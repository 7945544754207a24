"""Pictures and films of a rollout, and the motion and the stage they are made from."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.mujoco_import import mujoco
from grs_agents.base.trace.events import NodeStarted, Rollout
from grs_agents.library.library import Library
from grs_agents.sim import TaskInstance, rollout
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.rendering.stage import Stage, scene_props_from_instance
from grs_agents.views.common.rollout_motion import find_grasps, read_motion, read_task_instance
from grs_agents.views.film import rollout_film
from grs_agents.views.film.recorded_motion import recover_joint_positions, show_recorded_frame
from grs_agents.views.film.rollout_film import (
    RolloutShot,
    draw_caption,
    find_recorded_rollout,
    play_in_mujoco_window,
    render_takes,
    write_film,
    write_moment_captions,
)
from tests.views.conftest import write_rollout


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory, library: Library) -> tuple[Path, Rollout]:
    """A rollout of the real oracle."""
    folder = tmp_path_factory.mktemp("played")
    event = write_rollout(folder, 0)
    instance = TaskInstance.model_validate_json((folder / (event.instance or "")).read_bytes())
    rollout(instance, library, folder / (event.recording or ""))
    return folder, event


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
def test_the_joints_bring_every_link_where_it_was_recorded(tmp_path: Path, library: Library, robot: str) -> None:
    event = write_rollout(tmp_path, 0)
    instance = TaskInstance.model_validate_json((tmp_path / (event.instance or "")).read_bytes())
    stage = Stage(scene_props_from_instance(instance, get_arm(robot)), library)
    arm, rng = get_arm(robot), np.random.default_rng(0)
    wanted = rng.uniform(arm.lower_joint_limits, arm.upper_joint_limits, (5, arm.dof))
    wanted = np.clip(wanted, -3.1, 3.1)
    places: list[npt.NDArray[np.float64]] = []
    turns: list[npt.NDArray[np.float64]] = []
    for joints in wanted:
        stage.data.qpos[:] = joints
        mujoco.mj_kinematics(stage.model, stage.data)
        bodies = [stage.model.body(name).id for name in arm.link_names]
        places.append(stage.data.xpos[bodies].copy())
        turns.append(stage.data.xquat[bodies][:, [1, 2, 3, 0]].copy())
    np.savez(
        tmp_path / "arm.npz",
        times=np.arange(5.0),
        names=np.array(arm.link_names),
        positions=np.array(places),
        quaternions=np.array(turns),
        tool=np.zeros((5, 3)),
    )
    motion = read_motion(tmp_path / "arm.npz")
    found = recover_joint_positions(stage.model, motion)
    assert np.abs(np.sin((found - wanted) / 2)).max() < 1e-3
    show_recorded_frame(stage, motion, 3, found)
    assert np.allclose(stage.data.xpos[stage.model.body("cup").id], places[3][-1], atol=1e-4)


def test_what_the_tool_carried_is_known_with_its_moments(played: tuple[Path, Rollout]) -> None:
    folder, event = played
    motion = read_motion(folder / (event.recording or ""))
    found = find_grasps(motion)
    assert [grasp.body for grasp in found] == ["object_0"]
    index = motion.names.index("object_0")
    carried = np.linalg.norm(motion.positions[found[0].end, index] - motion.positions[found[0].start, index])
    assert carried > 0.2
    assert find_grasps(motion.downsample(0.01)) == []


def test_a_film_shows_what_moves_with_or_without_a_graphics_library(
    played: tuple[Path, Rollout], library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, event = played
    shot = RolloutShot(folder, event, library, width=160, height=120)
    take = (shot, [0.0, shot.recorded_motion.duration_seconds])
    drawn = [image.astype(int) for image in render_takes([take])]
    monkeypatch.setattr(rollout_film, "_BACKENDS", ("nonsense", "rays"))
    cast = [image.astype(int) for image in render_takes([take])]
    for first, last in (drawn, cast):
        assert first.shape == (120, 160, 3)
        assert first.std() > 10
        assert np.abs(first - last).max() > 50


@pytest.mark.parametrize("name", ["film.mp4", "film.gif", "film.webp"])
def test_a_film_is_written_in_real_time(
    played: tuple[Path, Rollout], library: Library, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    folder, event = played
    monkeypatch.setattr(rollout_film, "_BACKENDS", ("rays",))
    shot = RolloutShot(folder, event, library, width=96, height=64)
    frames = write_film(shot, tmp_path / name, rate=2)
    assert frames == int(shot.recorded_motion.duration_seconds * 2) + 1
    if name.endswith("mp4"):
        opened = cv2.VideoCapture(str(tmp_path / name))
        shown = 0
        while opened.read()[0]:
            shown += 1
    else:
        with Image.open(tmp_path / name) as film:
            shown = cast(Any, film).n_frames
    assert shown == frames


def test_a_film_tells_goal_action_and_reward(played: tuple[Path, Rollout], library: Library) -> None:
    folder, event = played
    instance = read_task_instance(folder / (event.instance or ""))
    motion = read_motion(folder / (event.recording or ""))
    (carried,) = find_grasps(motion)
    during = motion.times[(carried.start + carried.end) // 2]
    told = list(write_moment_captions(event, instance, motion, [0.0, during, motion.duration_seconds]))
    assert {goal for goal, _, _ in told} == {"put the milk on the left"}
    actions = ["reaches for milk", "carries milk", "has placed milk"]
    assert [action for _, action, _ in told] == [f"action 1 of 1: {words}" for words in actions]
    assert [outcome for _, _, outcome in told][::2] == ["0.0 s", "success, reward 1.00"]
    image = np.full((120, 160, 3), 200, np.uint8)
    drawn = draw_caption(image, ("x" * 500, "y\x1b", "z"))
    changed = (drawn != image).any(axis=(1, 2))
    assert not changed[:80].any() and changed[-20:].all()


def test_what_cannot_be_played_is_an_input_error(
    played: tuple[Path, Rollout], library: Library, tmp_path: Path
) -> None:
    folder, event = played
    assert find_recorded_rollout([NodeStarted(node="audit"), event], folder) is event
    with pytest.raises(InputError, match="no rollout of seed 3; name one of 0"):
        find_recorded_rollout([event], folder, 3)
    with pytest.raises(InputError, match="no recorded rollout"):
        find_recorded_rollout([event.model_copy(update={"recording": "gone.npz"})], folder)
    shot = RolloutShot(folder, event, library)
    with pytest.raises(InputError, match=r"ends in \.webp or \.mp4 or \.gif"):
        write_film(shot, tmp_path / "film.avi")
    with pytest.raises(InputError, match="does not exist"):
        write_film(shot, tmp_path / "nowhere" / "film.gif")
    (tmp_path / "bad.npz").write_bytes(b"PK")
    with pytest.raises(InputError, match=r"bad\.npz is not a readable"):
        read_motion(tmp_path / "bad.npz")
    broken = RolloutShot(folder, event.model_copy(update={"instance": "gone.json"}), library)
    with pytest.raises(InputError, match=r"cannot read .*gone\.json"):
        list(render_takes([(broken, [0.0])]))


def test_without_a_display_the_remedy_is_a_film(
    played: tuple[Path, Rollout], library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rollout_film, "has_display", lambda: False)
    with pytest.raises(GrsError, match=r"no display.*--out film\.webp"):
        play_in_mujoco_window(RolloutShot(*played, library))


def test_long_captions_are_cut_before_they_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    from PIL import ImageDraw

    measured: list[int] = []
    measure = ImageDraw.ImageDraw.textlength

    def count(draw: ImageDraw.ImageDraw, text: str, *options: Any) -> float:
        measured.append(len(text))
        return measure(draw, text, *options)

    monkeypatch.setattr(ImageDraw.ImageDraw, "textlength", count)
    image, word = np.zeros((240, 320, 3), np.uint8), "word " * 200_000
    drawn = draw_caption(image, (word, word, word))
    assert drawn.any() and max(measured) <= 401 and len(measured) < 40


def test_a_cause_is_cut_and_read_once_for_a_film(played: tuple[Path, Rollout]) -> None:
    folder, event = played
    instance = read_task_instance(folder / (event.instance or ""))
    motion = read_motion(folder / (event.recording or ""))
    long = event.model_copy(update={"cause": f"HOPE/TomatoSauce.urdf fell {'a' * 1_000_000}"})
    moments = [motion.duration_seconds] * 50
    (action,) = {action for _, action, _ in write_moment_captions(long, instance, motion, moments)}
    assert action.startswith("tomato sauce fell aaa") and len(action) <= 400


def test_a_film_reads_its_recording_in_a_worker(
    played: tuple[Path, Rollout], library: Library, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folder, event = played
    readers: list[bool] = []
    workers: list[tuple[Path, ...]] = []
    read_unwatched, decode_unwatched = rollout_film.read_motion, rollout_film.decode_in_worker

    def read(file: Path) -> Any:
        readers.append(bool(workers))
        return read_unwatched(file)

    @contextmanager
    def decode(*folders: Path) -> Generator[None]:
        workers.append(folders)
        with decode_unwatched(*folders):
            yield

    monkeypatch.setattr(rollout_film, "read_motion", read)
    monkeypatch.setattr(rollout_film, "decode_in_worker", decode)
    monkeypatch.setattr(rollout_film, "_BACKENDS", ("rays",))
    shot = RolloutShot(folder, event, library, width=96, height=64)
    write_film(shot, tmp_path / "film.gif", rate=1)
    assert readers and all(readers) and workers == [(folder,)]
