"""The 3D view of the page: photo, points, twin, robot and gizmos, and the cameras of the browsers."""

import math
from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import quote

import numpy as np

from grs_agents.base import Vec3
from grs_agents.base.geometry.transforms import (
    matrix_to_quaternion,
    quaternion_to_matrix,
    rotation_about_z,
)
from grs_agents.perception.edits import MOST_OFF_PLANE
from grs_agents.perception.settling.settling import PlacedObject, to_instance_objects
from grs_agents.perception.types import FARTHEST, NEAREST, Mask, SceneObject
from grs_agents.sim.rendering.cameras import VisibleScene
from grs_agents.sim.rendering.pictures import render_along_rays
from grs_agents.views.edit_page.editor import Editor
from grs_agents.views.edit_page.photo_plane import Floats, PhotoPlane, Viewer, clean_region, draw_photo
from grs_agents.views.edit_page.twin_meshes import build_asset_glb

_MOST_POINTS = 120_000
_TABLE_BAND = 0.008  # m around the table's height within which pixels are drawn as the table
_REACH_COLOR = (255, 140, 0)
_BESIDE = math.radians(35)  # from the photo's camera, seen from above, the view in 3D stands by this
Moved = Callable[[Floats, float, bool], None]
"""Takes position (m) and yaw (rad) of a dragged gizmo, and True at the end of the drag."""


class SceneView:
    """What the browsers draw: the photo from its camera, or the twin in 3D."""

    def __init__(
        self,
        viser: Any,
        editor: Editor,
        later: Callable[[Callable[[], None]], None],
        drag_object: Moved,
        drag_robot: Moved,
    ) -> None:
        """Draw the photo, the table and the robot; ``later`` queues the work of an event."""
        self._viser, self._editor, self._later = viser, editor, later
        self._drag_object, self._drag_robot = drag_object, drag_robot
        self.shows_photo = True
        self.moves_robot = False
        self._dragged: tuple[Floats, float] | None = None  # latest pose of a gizmo that is not shown yet
        self._nodes: dict[str, tuple[tuple[str, int], Any]] = {}  # of each object: asset with its date, 3D node
        self._meshes: dict[tuple[str, int], bytes] = {}  # those of `_nodes`, which outlive them
        self.draw_place()

    def draw_place(self) -> None:
        """Draw all that depends on the robot frame: photo, cloud, table and robot."""
        scene, photo, frame = self._viser.scene, self._editor.photo, self._editor.scene.frame
        scene.reset()
        scene.set_up_direction("+z")
        self._nodes.clear()
        pose = np.asarray(frame.T_robot_cam, np.float64)
        self.plane = PhotoPlane(photo.camera.intrinsics, pose)
        self._photo = scene.add_image(
            "/photo",
            photo.rgb,
            *self.plane.size,
            wxyz=_wxyz(matrix_to_quaternion(pose[:3, :3])),
            position=self.plane.centre,
            format="jpeg",
            jpeg_quality=90,
            cast_shadow=False,
            receive_shadow=False,
            visible=self.shows_photo,
        )
        points = photo.camera_frame_point_map() @ pose[:3, :3].T + pose[:3, 3]
        seen, height = photo.depth > 0, points[..., 2]
        self._table = clean_region(seen & (np.abs(height - frame.height) < _TABLE_BAND))
        self._planes = {
            f"plane {plane.number}": clean_region(seen & (np.abs(height - plane.height) < MOST_OFF_PLANE))
            for plane in frame.planes
            if not plane.taken
        }
        kept = np.flatnonzero(seen)[:: max(1, int(seen.sum()) // _MOST_POINTS)]
        self._cloud = scene.add_point_cloud(
            "/cloud",
            points.reshape(-1, 3)[kept].astype(np.float32),
            photo.rgb.reshape(-1, 3)[kept],
            point_size=0.002,
            precision="float32",
            visible=not self.shows_photo,
        )
        self._draw_robot(frame.height)
        self._gizmo = self._add_gizmo("/gizmo", 0.15, self._drag_object)
        self._robot_gizmo = self._add_gizmo("/base", 0.3, self._drag_robot)
        if self.shows_photo:  # else it is seen from where it was in the frame before
            self.look()

    def _draw_robot(self, height: float) -> None:
        """Draw the axes of the robot's base, and its reach at a height, m."""
        scene = self._viser.scene
        scene.add_frame("/robot", axes_length=0.15, axes_radius=0.006, position=(0.0, 0.0, 0.0))
        scene.add_label("/robot/base", "robot base: red x forward, green y left", position=(0.0, 0.0, 0.16))
        around = np.linspace(-np.pi, np.pi, 97)
        for name, radius in (("nearest", NEAREST), ("farthest", FARTHEST)):
            ring = np.stack([radius * np.cos(around), radius * np.sin(around), np.full(97, height)], axis=-1)
            segments = np.stack([ring[:-1], ring[1:]], axis=1).astype(np.float32)
            scene.add_line_segments(f"/robot/{name}", segments, _REACH_COLOR, thickness=0.004)
            scene.add_label(f"/robot/{name}/reach", f"{name} reach {radius:g} m", position=(radius, 0.0, height))

    def draw_photo(
        self, masks: Mapping[int, Mask], selected: int | None, preview: Mask | None, offers_planes: bool
    ) -> None:
        """Draw the outlines of objects with their numbers into the photo, of the table, and of the other planes."""
        levels = {"table": self._table, **self._planes} if offers_planes else {"": self._table}
        self._photo.image = draw_photo(self._editor.photo.rgb, masks, selected, levels, preview)

    def draw_objects(self, selected: SceneObject | None) -> None:
        """Draw the twin's objects, and the gizmo of the selected one."""
        library, objects = self._editor.library, self._editor.scene.objects
        for name in self._nodes.keys() - {item.name for item in objects}:
            self._nodes.pop(name)[1].remove()
        meshes, self._meshes = self._meshes, {}
        for item in objects:
            key = (item.asset, library.asset_path(item.asset).stat().st_mtime_ns)
            self._meshes[key] = meshes.get(key) or build_asset_glb(library, item.asset)
            known = self._nodes.get(item.name)
            if known is None or known[0] != key:
                if known is not None:
                    known[1].remove()
                drawn = self._viser.scene.add_glb(f"/objects/{quote(item.name, safe='')}", self._meshes[key])
                known = self._nodes[item.name] = (key, drawn)
            node = known[1]
            position, orientation = pose_at_rest(item)
            node.position, node.wxyz, node.visible = position, _wxyz(orientation), not self.shows_photo
        self._gizmo.visible = selected is not None and not self.shows_photo and not self.moves_robot
        if selected is not None:
            self._gizmo.position, self._gizmo.wxyz = pose_at_rest(selected)[0], (1.0, 0.0, 0.0, 0.0)
        self._robot_gizmo.visible = self.moves_robot and not self.shows_photo
        self._robot_gizmo.position, self._robot_gizmo.wxyz = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)

    def drag_object(self, item: SceneObject, position: Floats, yaw: float) -> None:
        """Draw an object at a position of its centre (m), turned by ``yaw`` rad."""
        start, orientation = pose_at_rest(item)
        turned = matrix_to_quaternion(rotation_about_z(yaw) @ quaternion_to_matrix(orientation))
        node = self._nodes[item.name][1]
        node.position, node.wxyz = (position[0], position[1], start[2]), _wxyz(turned)

    def _add_gizmo(self, name: str, scale: float, moved: Moved) -> Any:
        gizmo = self._viser.scene.add_transform_controls(
            name, scale=scale, active_axes=(True, True, False), depth_test=False, visible=False
        )

        def show_drag() -> None:
            pose, self._dragged = self._dragged, None
            if pose is not None:
                moved(*pose, False)

        async def enqueue(event: Any) -> None:
            if event.client_id is None:  # written by this page
                return
            turn = np.asarray(gizmo.wxyz, np.float64)
            yaw = math.remainder(2 * math.atan2(turn[3], turn[0]), 2 * math.pi)
            position, waiting = np.array(gizmo.position, np.float64), self._dragged is not None
            if event.phase == "end":
                self._dragged = None
                self._later(lambda: moved(position, yaw, True))
                return
            self._dragged = position, yaw
            if not waiting:
                self._later(show_drag)

        gizmo.on_update(enqueue)
        return gizmo

    # Pointer and cameras

    def find_pixel(self, client: Any, screen: tuple[float, float]) -> tuple[float, float] | None:
        """Column and row of the photo under a point of a browser's view (0..1 right and down), None if behind it."""
        camera = client.camera
        turn = np.asarray(camera.wxyz, np.float64)
        rotation = quaternion_to_matrix((turn[1], turn[2], turn[3], turn[0]))
        viewer = Viewer(rotation, np.asarray(camera.position, np.float64), float(camera.fov), float(camera.aspect))
        return self.plane.find_pixel(screen, viewer)

    def find_object_along(self, origin: Vec3, direction: Vec3) -> str | None:
        """The name of the first object on a ray from a point, m.

        The browser could find it, but its objects would take the clicks on parts of the gizmo that lie in them.
        """
        items, library = self._editor.scene.objects, self._editor.library
        placed = [PlacedObject(item.asset, item.settled or (item.position, item.orientation)) for item in items]
        sight = VisibleScene(to_instance_objects(placed, library), library)
        owner = int(render_along_rays(sight, np.array(origin), np.array(direction)[None, None]).owner[0, 0])
        return items[owner].name if owner >= 0 else None

    def show(self, photo: bool) -> None:
        """Show the photo, or the twin in 3D."""
        self.shows_photo = photo
        self._photo.visible, self._cloud.visible = photo, not photo
        self.look()

    def look(self) -> None:
        """Put the cameras of all browsers at the photo's, or aside of it."""
        for client in self._viser.get_clients().values():
            self._look(client)

    def welcome(self, client: Any) -> None:
        """Show a browser the photo, and again whole where its window or panel changes."""
        shown: list[float] = []  # aspects

        async def fit(camera: Any) -> None:
            aspect = float(camera.aspect)
            if self.shows_photo and shown[-1:] != [aspect]:
                shown.append(aspect)
                self._later(lambda: self._look(client))

        client.camera.on_update(fit)
        self._look(client)

    def _look(self, client: Any) -> None:
        pose, camera = self.plane.pose, client.camera
        with client.atomic():
            if self.shows_photo:
                camera.up_direction = -pose[:3, 1]
                camera.position = pose[:3, 3]
                camera.look_at = pose[:3, 3] + pose[:3, 2]
                camera.fov = self.plane.find_field_of_view(float(camera.aspect))
            else:
                centre = self._centre()
                camera.up_direction = (0.0, 0.0, 1.0)
                camera.position = centre + 1.1 * rotation_about_z(_BESIDE) @ (pose[:3, 3] - centre)
                camera.look_at = centre
                camera.fov = math.radians(50)

    def _centre(self) -> Floats:
        """(3,) between the objects, or halfway to the robot that is moved, m."""
        positions = [item.position for item in self._editor.scene.objects] or [(0.5, 0.0, 0.0)]
        centre: Floats = np.mean(positions, axis=0)
        return centre / 2 if self.moves_robot else centre


def pose_at_rest(item: SceneObject) -> tuple[Floats, tuple[float, float, float, float]]:
    """Position (m) and orientation (xyzw) at rest."""
    position, orientation = item.settled or (item.position, item.orientation)
    return np.asarray(position, np.float64), orientation


def _wxyz(xyzw: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    return (xyzw[3], *xyzw[:3])
