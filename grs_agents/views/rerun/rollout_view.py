"""Rollouts in the recording: asset meshes, poses as columns, the robot's links, the tool's path."""

from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import rerun as rr

from grs_agents.base import Pose
from grs_agents.base.errors import InputError
from grs_agents.base.foreign.pictures import read_picture
from grs_agents.base.foreign.run_folder import find_member_file, resolve_member_file
from grs_agents.base.trace.events import Rollout
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import read_surface
from grs_agents.library.shapes import Shape, matrix_from_quaternion
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.rendering.robot_meshes import build_robot_meshes
from grs_agents.sim.world.spec import load_object_model
from grs_agents.views.common.rollout_motion import (
    Motion,
    find_grasps,
    read_motion,
    read_motion_duration,
    read_task_instance,
)
from grs_agents.views.common.safe_text import replace_undrawable_chars
from grs_agents.views.common.scene_objects import library_with_run_assets
from grs_agents.views.rerun.recording import Paths, RerunRecording
from grs_agents.views.rerun.waiting import clear_placeholder, log_table_top

TEXTURE_EDGE = 256
"""Largest texture size, px; larger textures are shrunk to keep recordings small."""
TABLE_TEXTURE_EDGE = 1024
"""Size of the table texture, px; an eighth of its area is visible."""
_GREY = (0.7, 0.7, 0.72, 1.0)
Rgba = tuple[float, float, float, float]
Array = npt.NDArray[np.float64]


def log_asset_shapes(recording: RerunRecording, path: str, name: str, library: Library) -> None:
    """Log the library's asset ``name`` in its own frame below ``path``."""
    model = library.load_object_model(name)
    for number, shape in enumerate(model.visuals or model.colliders):
        recording.log(f"{path}/{number}", shape_to_rerun(shape, library, None))


def shape_to_rerun(shape: Shape, library: Library, color: Rgba | None) -> rr.AsComponents:
    """``shape`` in the frame of its object; ``color`` (rgba 0..1) overrides its own colour and texture."""
    rgba = [round(255 * channel) for channel in color or shape.color or _GREY]
    placed: dict[str, Any] = {"centers": [shape.position], "quaternions": [shape.quaternion], "colors": [rgba]}
    if shape.kind == "box":
        return rr.Boxes3D(sizes=[shape.size], fill_mode="solid", **placed)
    if shape.kind == "sphere":
        return rr.Ellipsoids3D(half_sizes=[shape.size * 3], fill_mode="solid", **placed)
    if shape.kind == "cylinder":
        radius, length = shape.size
        return rr.Cylinders3D(radii=[radius], lengths=[length], fill_mode="solid", **placed)
    texture = library.mesh_or_texture_path(shape.texture) if shape.texture and color is None else None
    pose = (shape.position, shape.quaternion)
    return _build_mesh(library.mesh_or_texture_path(shape.mesh or ""), texture, shape.size, pose, color or shape.color)


@lru_cache(maxsize=64)
def _build_mesh(
    path: Path, texture_path: Path | None, scale: tuple[float, ...], pose: Pose, color: Rgba | None
) -> rr.Mesh3D:
    """Cached, since an object's mesh is shown in the twin and in the rollouts. ``color`` applies without a texture."""
    (vertices, uv), faces, normals = _load_mesh(path)
    rotation = matrix_from_quaternion(pose[1])
    vertices = vertices * scale @ rotation.T + pose[0]
    texture = texcoords = None
    if texture_path and uv.any():
        texture = _load_texture(texture_path)
        texcoords = np.column_stack([uv[:, 0], 1 - uv[:, 1]])  # rerun's origin is the top left corner
    rgba = [round(255 * channel) for channel in (color if texture is None else None) or (1,) * 4]
    return rr.Mesh3D(
        vertex_positions=vertices,
        triangle_indices=faces,
        vertex_normals=normals @ rotation.T,
        vertex_texcoords=texcoords if texture is not None else None,
        albedo_texture=texture,
        albedo_factor=rgba,
    )


@lru_cache(maxsize=128)
def _load_mesh(path: Path) -> tuple[tuple[Array, Array], npt.NDArray[np.int64], Array]:
    """Read a mesh file. Returns: vertices (V, 3) and texture coordinates (V, 2), faces (F, 3), area-weighted vertex
    normals (V, 3)."""
    surface = read_surface(path)
    corners = np.concatenate([surface.corners, surface.uvs], axis=2).reshape(-1, 5)
    vertices, index = np.unique(corners, axis=0, return_inverse=True)
    faces = index.reshape(-1, 3)
    first, second, third = surface.corners.swapaxes(0, 1)
    face_normals = np.cross(second - first, third - first)  # their length is twice the area
    normals = np.zeros((len(vertices), 3))
    for corner in range(3):
        np.add.at(normals, faces[:, corner], face_normals)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return (vertices[:, :3], vertices[:, 3:]), faces, normals


@lru_cache(maxsize=128)
def _load_texture(path: Path, edge: int = TEXTURE_EDGE) -> Any:
    """Texture (H, W, 3) uint8 RGB; None if the file is unreadable, the mesh is then plain."""
    try:
        image = read_picture(path, cv2.IMREAD_COLOR)
    except InputError:
        return None
    scale = edge / max(image.shape[:2])
    if scale < 1:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


FRAMES_PER_SECOND = 25.0
_ORANGE, _MUTED, _YELLOW, _GREEN = (208, 104, 28), (125, 125, 132), (255, 210, 60), (70, 215, 120)
_BLUE, _PINK = (90, 170, 255), (255, 120, 200)


def rollout_duration(folder: Path, event: Rollout) -> float:
    """Simulated seconds of the rollout's recording; 0 without a recording."""
    file = None if event.recording is None else find_member_file(folder, event.recording)
    return 0.0 if file is None else read_motion_duration(file)


class RolloutView:
    """Shows rollouts in turn in a common world; shapes are logged again only where they differ."""

    def __init__(self, folder: Path, library: Library) -> None:
        self._folder, self._library = folder, library
        self._shown: set[str] = set()
        self._table_shown = self._background_shown = False
        self._robot: str | None = None  # name of the robot shown, with its tool

    def show_rollout(self, recording: RerunRecording, event: Rollout) -> float:
        """Show ``event``; without a recording, objects at their initial poses. Returns: simulated seconds."""
        file = event.instance
        instance = None if file is None else read_task_instance(resolve_member_file(self._folder, file))
        motion = None
        if event.recording is not None:
            motion = read_motion(resolve_member_file(self._folder, event.recording)).downsample(FRAMES_PER_SECOND)
        if instance:
            self._show_objects(recording, instance, set(motion.names) if motion else set())
            if motion is not None:
                self._show_robot(recording, instance)
            _show_goals(recording, instance)
        if motion is None or not motion.times.size:
            return 0.0
        _show_motion(recording, motion)
        _show_grasps(recording, motion, {f"object_{item.id}": item for item in instance.objects} if instance else {})
        return motion.duration_seconds

    def _show_objects(self, recording: RerunRecording, instance: TaskInstance, moving: set[str]) -> None:
        """The table and the objects on it. Objects in ``moving`` get no pose here, since their motion is logged."""
        library = library_with_run_assets(self._folder, self._library)
        if not self._table_shown:
            self._table_shown = True
            clear_placeholder(recording, Paths.WORLD)
            name = instance.table.texture
            texture = None if name is None else _load_texture(library.mesh_or_texture_path(name), TABLE_TEXTURE_EDGE)
            log_table_top(recording, instance.table, texture)
            recording.log(f"{Paths.WORLD}/tool", rr.Points3D.from_fields(radii=[0.012], colors=[_YELLOW]), static=True)
        present: set[str] = set()
        for item in instance.objects:
            body = f"object_{item.id}"
            if body not in moving:
                position, quaternion = item.pose
                pose = rr.Transform3D(translation=position, quaternion=rr.Quaternion(xyzw=quaternion))
                recording.log(f"{Paths.WORLD}/{body}", pose)
            path = _object_shapes_path(item)
            present.add(path)
            if path not in self._shown:
                _show_object_shapes(recording, path, item, library)
        if instance.background and not self._background_shown:
            self._background_shown = True
            log_asset_shapes(recording, f"{Paths.WORLD}/background", instance.background, library)
        for path in self._shown - present:
            recording.log(path, rr.Clear(recursive=True))
        self._shown = present

    def _show_robot(self, recording: RerunRecording, instance: TaskInstance) -> None:
        """The solids of the robot's links, each below the pose of its body, unless shown already."""
        push = instance.primitive == "push"
        if self._robot != (name := f"{instance.robot} {instance.mounted_hand} {push}"):
            self._robot = name
            for body, solid in build_robot_meshes(get_arm(instance.robot, instance.mounted_hand), push).items():
                mesh = rr.Mesh3D(
                    vertex_positions=solid.vertices,
                    vertex_normals=solid.normals,
                    vertex_colors=solid.colors,
                    triangle_indices=solid.triangles,
                )
                recording.log(f"{_robot_body_path(body)}/solid", mesh)


def _object_name(item: InstanceObject) -> str:
    """Display name of an object."""
    name = Path(item.asset).stem.removesuffix("-template").replace("_", " ")
    return replace_undrawable_chars(f"{name} (bystander)" if item.role == "bystander" else name)


def _show_object_shapes(recording: RerunRecording, path: str, item: InstanceObject, library: Library) -> None:
    """The object's shapes and its name: below a movable object, above a bystander."""
    model = load_object_model(item, library)
    for number, shape in enumerate(model.visuals or model.colliders):
        recording.log(f"{path}/{number}", shape_to_rerun(shape, library, item.color))
    mover = item.role != "bystander"
    # Above a mover, the suction cup would cover the name.
    position = [[0.0, 0.0, model.bounds[0][2] - 0.02 if mover else model.bounds[1][2] + 0.02]]
    # All names at once would overlap: they show under the pointer, and while the object is held.
    name = rr.Points3D(
        position,
        labels=[_object_name(item)],
        colors=[_ORANGE if mover else _MUTED],
        radii=[0.0005 if mover else 0.004],
        show_labels=False,
    )
    recording.log(f"{path}/name", name)


def _object_shapes_path(item: InstanceObject) -> str:
    """Path of the shapes of ``item``: below its pose, with a hash of its appearance.
    A path is thus never cleared and logged at the same moment, which the viewer would show without its pose."""
    looks = item.model_dump_json(include={"asset", "fill", "color", "role"})
    return f"{Paths.WORLD}/object_{item.id}/looks_{sha256(looks.encode()).hexdigest()[:8]}"


def _show_goals(recording: RerunRecording, instance: TaskInstance) -> None:
    targets = [pose[0] for goal in instance.goals for pose in goal.targets]
    recording.log(f"{Paths.WORLD}/targets", rr.Points3D(targets, radii=[0.012], colors=[_GREEN]))
    zones = [zone for goal in instance.goals for zone in goal.zones]
    boxes = rr.Boxes3D(
        centers=[zone.pose[0] for zone in zones],
        quaternions=[zone.pose[1] for zone in zones],
        sizes=[zone.size for zone in zones],
        colors=[_GREEN] * len(zones),
    )
    recording.log(f"{Paths.WORLD}/zones", boxes)
    words = instance.instruction or "\n".join(goal.language for goal in instance.goals)
    recording.log(f"{Paths.WORLD}/task", rr.TextDocument(words))


def _robot_body_path(body: str) -> str:
    """Path of a robot body's pose; a user's model may use any name."""
    return f"{Paths.WORLD}/robot/{rr.escape_entity_path_part(body)}"


def _show_motion(recording: RerunRecording, motion: Motion) -> None:
    """The poses of each body, with rows only where it moves, and the tool's path."""
    for index, name in enumerate(motion.names):
        path = f"{Paths.WORLD}/{name}" if name.startswith("object_") else _robot_body_path(name)
        positions, quaternions = motion.positions[:, index], motion.quaternions[:, index]
        step = np.abs(np.diff(positions, axis=0)).max(axis=1) + np.abs(np.diff(quaternions, axis=0)).max(axis=1)
        moves = step > 1e-5
        kept = np.concatenate([[True], moves]) | np.concatenate([moves, [False]])
        transforms = rr.Transform3D.columns(translation=positions[kept], quaternion=quaternions[kept])
        recording.log_columns(path, motion.times[kept], transforms)
    recording.log_columns(f"{Paths.WORLD}/tool", motion.times, rr.Points3D.columns(positions=motion.tool))
    recording.log(f"{Paths.WORLD}/tool_path", rr.LineStrips3D([motion.tool], colors=[_YELLOW], radii=[0.0015]))


def _show_grasps(recording: RerunRecording, motion: Motion, objects: dict[str, InstanceObject]) -> None:
    """Position, time and log line of each grasp and release; the name of an object while it is held."""
    grasps = find_grasps(motion)
    moments: list[tuple[int, str, tuple[int, int, int]]] = []
    for number, grasp in enumerate(grasps, start=1):
        name = _object_name(objects[grasp.body]) if grasp.body in objects else grasp.body
        moments += [(grasp.start, f"{number} takes {name}", _BLUE), (grasp.end, f"{number} lets {name} go", _PINK)]
    labels = [text for _, text, _ in moments]
    colors = [color for _, _, color in moments]
    spots = rr.Points3D(
        [motion.tool[frame] for frame, _, _ in moments], labels=labels, colors=colors, radii=[0.009], show_labels=False
    )
    recording.log(f"{Paths.WORLD}/grasps", spots)
    if moments:
        moments.sort(key=lambda moment: moment[0])
        lines = rr.TextLog.columns(text=[f"• {text}" for _, text, _ in moments], level=["INFO"] * len(moments))
        recording.log_columns(Paths.GRASPS, np.array([motion.times[frame] for frame, _, _ in moments]), lines)
    for grasp in grasps:
        if grasp.body in objects:
            seconds = np.array([motion.times[grasp.start], motion.times[grasp.end]])
            columns = rr.Points3D.columns(show_labels=[True, False])
            recording.log_columns(f"{_object_shapes_path(objects[grasp.body])}/name", seconds, columns)
