"""Rollouts in the recording: meshes once, poses as columns, the robot as links, the tool's path."""

from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr

from grs_agents.errors import InputError
from grs_agents.library import Library
from grs_agents.sim.instance import InstanceGoal, InstanceObject, TaskInstance
from grs_agents.sim.world import model_of
from grs_agents.trace import Rollout
from grs_agents.views.glyphs import drawable
from grs_agents.views.paths import Paths
from grs_agents.views.recording import Recording
from grs_agents.views.shape_view import geometry

Array = npt.NDArray[np.float64]
FRAMES_PER_SECOND = 25.0
_TABLE = ((0.5, 0.0, -0.011), (0.62, 1.1, 0.02), (152, 128, 98))  # centre, size, colour
_WHITE, _ORANGE, _YELLOW, _GREEN = (240, 240, 240), (235, 130, 35), (255, 210, 60), (70, 215, 120)


def _read(folder: Path, event: Rollout) -> dict[str, npt.NDArray[Any]] | None:
    """The arrays of the recording at a bounded frame rate, or None where the rollout left none."""
    if event.recording is None:
        return None
    try:
        with np.load(folder / event.recording, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in file.files}
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read rollout {event.recording}: {error}", "run again") from error
    times = arrays["times"]
    if times.size < 2:
        return arrays
    wanted = np.arange(times[0], times[-1], 1 / FRAMES_PER_SECOND)
    kept = np.unique(np.append(np.searchsorted(times, wanted), times.size - 1))
    return {name: value if name == "names" else value[kept] for name, value in arrays.items()}


def duration(folder: Path, event: Rollout) -> float:
    """Simulated seconds of the rollout's recording; 0 where it has none."""
    if event.recording is None or not (folder / event.recording).exists():
        return 0.0
    with np.load(folder / event.recording, allow_pickle=False) as file:
        times = file["times"]
    return float(times[-1] - times[0]) if times.size else 0.0


class RolloutView:
    """Shows rollouts one after the other in one world; shapes are logged again only where they differ."""

    def __init__(self, folder: Path, library: Library) -> None:
        self._folder, self._library = folder, library
        self._shown: set[str] = set()

    def show(self, recording: Recording, event: Rollout) -> float:
        """Show ``event`` and return its simulated seconds; without a recording, objects where they start."""
        instance = self._instance(event)
        arrays = _read(self._folder, event)
        if instance:
            self._show_objects(recording, instance)
            _show_goals(recording, instance)
        if arrays is None or not arrays["times"].size:
            return 0.0
        seconds = np.asarray(arrays["times"] - arrays["times"][0], dtype=np.float64)
        _show_motion(recording, seconds, arrays)
        return float(seconds[-1])

    def _instance(self, event: Rollout) -> TaskInstance | None:
        if event.instance is None:
            return None
        return TaskInstance.model_validate_json((self._folder / event.instance).read_bytes())

    def _show_objects(self, recording: Recording, instance: TaskInstance) -> None:
        recording.log(Paths.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        center, size, color = _TABLE
        table = rr.Boxes3D(centers=[center], sizes=[size], colors=[color], fill_mode="solid")
        recording.log(f"{Paths.WORLD}/table", table)
        library = self._with_proxies()
        present: set[str] = set()
        for item in instance.objects:
            position, quaternion = item.pose
            pose = rr.Transform3D(translation=position, quaternion=rr.Quaternion(xyzw=quaternion))
            recording.log(f"{Paths.WORLD}/object_{item.id}", pose)
            path = _shapes_path(item)
            present.add(path)
            if path not in self._shown:
                _show_shapes(recording, path, item, library)
        for path in self._shown - present:
            recording.log(path, rr.Clear(recursive=True))
        self._shown = present

    def _with_proxies(self) -> Library:
        """The library with the proxies that this run has made so far."""
        proxies = self._folder / "assets"
        return self._library.overlay(proxies) if (proxies / "manifest.json").is_file() else self._library


def _show_shapes(recording: Recording, path: str, item: InstanceObject, library: Library) -> None:
    """What the object looks like, and its name above it."""
    model = model_of(item, library)
    for number, shape in enumerate(model.visuals or model.colliders):
        recording.log(f"{path}/{number}", geometry(shape, library, item.color))
    top = [[0.0, 0.0, model.bounds[1][2] + 0.02]]
    label = drawable(Path(item.asset).stem.replace("_", " "))
    recording.log(f"{path}/name", rr.Points3D(top, labels=[label], colors=[_WHITE], radii=[0.0005]))


def _shapes_path(item: InstanceObject) -> str:
    """Where the shapes of ``item`` lie: below its pose, under a name that differs where its looks differ.

    So nothing is ever cleared and shown at one path in one instant, which the viewer shows without its pose.
    """
    looks = item.model_dump_json(include={"asset", "fill", "color"})
    return f"{Paths.WORLD}/object_{item.id}/looks_{sha256(looks.encode()).hexdigest()[:8]}"


def _show_goals(recording: Recording, instance: TaskInstance) -> None:
    targets = [pose[0] for goal in instance.goals for pose in goal.targets]
    points = rr.Points3D(targets, radii=[0.012], colors=[_GREEN])
    recording.log(f"{Paths.WORLD}/targets", points)
    zones = [zone for goal in instance.goals for zone in goal.zones]
    boxes = rr.Boxes3D(
        centers=[zone.pose[0] for zone in zones],
        quaternions=[zone.pose[1] for zone in zones],
        sizes=[zone.size for zone in zones],
        colors=[_GREEN] * len(zones),
    )
    recording.log(f"{Paths.WORLD}/zones", boxes)
    recording.log(f"{Paths.WORLD}/task", rr.TextDocument(_languages(instance.goals)))


def _languages(goals: tuple[InstanceGoal, ...]) -> str:
    return "\n".join(goal.language for goal in goals)


def _show_motion(recording: Recording, seconds: Array, arrays: dict[str, npt.NDArray[Any]]) -> None:
    names = [str(name) for name in arrays["names"]]
    positions = np.asarray(arrays["positions"], dtype=np.float32)
    quaternions = np.asarray(arrays["quaternions"], dtype=np.float32)
    links: list[int] = []
    for index, name in enumerate(names):
        if name.startswith("object_"):
            _show_object(recording, name, seconds, positions[:, index], quaternions[:, index])
        else:
            links.append(index)
    if len(links) > 1:
        strips = rr.LineStrips3D.columns(
            strips=positions[:, links], radii=np.full(len(seconds), 0.028), colors=[_ORANGE] * len(seconds)
        )
        recording.columns(f"{Paths.WORLD}/robot", seconds, strips)
    tool = np.asarray(arrays["tool"], dtype=np.float32)
    points = rr.Points3D.columns(positions=tool, radii=np.full(len(seconds), 0.012), colors=[_YELLOW] * len(seconds))
    recording.columns(f"{Paths.WORLD}/tool", seconds, points)
    recording.log(f"{Paths.WORLD}/tool_path", rr.LineStrips3D([tool], colors=[_YELLOW], radii=[0.0015]))


def _show_object(
    recording: Recording,
    name: str,
    seconds: Array,
    positions: npt.NDArray[np.float32],
    quaternions: npt.NDArray[np.float32],
) -> None:
    """The poses of one body, (N, 3) and (N, 4) xyzw; a row only where it moves."""
    step = np.abs(np.diff(positions, axis=0)).max(axis=1) + np.abs(np.diff(quaternions, axis=0)).max(axis=1)
    moves = step > 1e-5
    kept = np.concatenate([[True], moves]) | np.concatenate([moves, [False]])
    transforms = rr.Transform3D.columns(translation=positions[kept], quaternion=quaternions[kept])
    recording.columns(f"{Paths.WORLD}/{name}", seconds[kept], transforms)
