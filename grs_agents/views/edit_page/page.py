"""The page: photo, twin, list of objects, and an edit for each act of a person.

Handlers of the browser's events only queue them: the thread that calls `EditPage.serve` does all work, in their order.
"""

import math
import queue
import re
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal, Protocol
from urllib.parse import quote

import numpy as np
from pydantic import ValidationError

from grs_agents.base import Vec3
from grs_agents.base.errors import GrsError
from grs_agents.base.geometry.transforms import matrix_to_quaternion, quaternion_to_matrix
from grs_agents.library.asset_rendering import render_asset_views
from grs_agents.library.library import Library
from grs_agents.perception.edits import (
    AS_SEEN,
    MOST_OFF_PLANE,
    Add,
    ChooseAsset,
    ChooseShape,
    ChooseTable,
    Delete,
    Edit,
    Mark,
    Merge,
    Move,
    Pixel,
    PlaceRobot,
    Rectangle,
    Rename,
    SetFriction,
    SetMass,
    Split,
    describe_edit,
)
from grs_agents.perception.settling.settling import PlacedObject, to_instance_objects
from grs_agents.perception.types import FARTHEST, NEAREST, Mask, RGBDFrame, SceneDescription, SceneObject
from grs_agents.sim.rendering.cameras import VisibleScene
from grs_agents.sim.rendering.pictures import render_along_rays
from grs_agents.views.edit_page.guard import GuardedServer
from grs_agents.views.edit_page.photo_plane import (
    THUMBNAIL,
    Floats,
    Image,
    PhotoPlane,
    Viewer,
    clean_region,
    crop_thumbnail,
    draw_photo,
    escape_lines,
    inline_picture,
)
from grs_agents.views.edit_page.twin_meshes import build_asset_glb

_MOST_POINTS = 120_000
_TABLE_BAND = 0.008  # m around the table's height within which pixels are drawn as the table
_STILL = (0.001, 0.5)  # m, degrees: a gizmo moved by less is not moved
_REACH_COLOR = (255, 140, 0)
_ASIDE = (1.0, -0.7, 0.8)  # direction from which an asset is shown: front, side and top are seen
REPORT: Final = "/report"
_FILM: Final = re.compile(rb"data:image/webp;base64,[A-Za-z0-9+/=]+")  # in a report, of its film alone
SELECT_HELP = "Click an object in the photo, in 3D or in the list."


class Editor(Protocol):
    """A scene that is corrected: `grs_agents.runs.scene_editor.SceneEditor`."""

    @property
    def folder(self) -> Path: ...
    @property
    def photo(self) -> RGBDFrame: ...
    @property
    def scene(self) -> SceneDescription: ...
    @property
    def masks(self) -> Mapping[str, Mask]: ...
    @property
    def library(self) -> Library: ...
    @property
    def edits(self) -> tuple[Edit, ...]: ...
    @property
    def undone(self) -> tuple[Edit, ...]: ...
    def apply(self, edit: Edit) -> None: ...
    def undo(self) -> None: ...
    def redo(self) -> None: ...
    def place_of(self, name: str) -> Pixel: ...
    def preview_mask(self, rectangle: Rectangle) -> Mask | None: ...
    def ranked_assets(self, place: Pixel) -> tuple[str, ...]: ...
    def overlaps(self, place: Pixel, position: tuple[float, float], yaw: float) -> tuple[str, ...]: ...
    def save(self) -> Path: ...


@dataclass(frozen=True)
class EndedRun:
    """A run from the corrected scene."""

    folder: Path
    status: str
    reason: str
    report: bytes  # an HTML page


GoOn = Callable[[Callable[[str], None]], EndedRun]
"""Runs the graph from the saved scene; the given function shows a step, a line of text."""
Mode = Literal["select", "add", "split", "merge", "table"]
_ASKS: dict[Mode, str] = {
    "select": SELECT_HELP,
    "add": "Drag a rectangle round the object, with a margin of the table.",
    "split": "Drag a rectangle round a part of the selected object.",
    "merge": "Click the object that belongs to the selected one.",
    "table": "Click the table in the photo. Perception begins anew.",
}


class EditPage:
    """A page for an editor on a guarded server."""

    def __init__(self, editor: Editor, server: GuardedServer, go_on: GoOn) -> None:
        """Build the page; it reacts while `serve` runs."""
        self._editor, self._server, self._go_on = editor, server, go_on
        self._viser = server.viser
        self._work: queue.Queue[Callable[[], None] | None] = queue.Queue()
        self._place: Pixel | None = None  # of the selected object
        self._mode: Mode = "select"
        self._offer: tuple[Edit, Mask] | None = None  # an edit to confirm, with its mask
        self._dragged: tuple[Floats, float] | None = None  # latest pose of the gizmo that is not shown yet
        self._nodes: dict[str, tuple[tuple[str, int], Any]] = {}  # of each object: asset with its date, 3D node
        self._rows: list[tuple[Any, Any]] = []
        self._filled: dict[str, tuple[int, str | float]] = {}  # of each field: object and value of the last filling
        self._photo_shown = True
        self._photo_node: Any = None
        self._build_panel()
        self._draw_place()
        self._set_mode("select")
        self._viser.on_client_connect(self._later(self._welcome))
        self._viser.scene.on_click()(self._later(self._click))

    def serve(self) -> None:
        """React to the person until "Finish" is pressed or the process is interrupted; then save."""
        try:
            while (work := self._work.get()) is not None:
                self._try(work)
        finally:
            self._editor.save()

    # Events

    def _later(self, work: Callable[[Any], None]) -> Callable[[Any], Coroutine[Any, Any, None]]:
        async def enqueue(event: Any) -> None:  # on the server's event loop, hence in the order of the events
            self._work.put(partial(work, event))

        return enqueue

    def _try(self, work: Callable[[], None]) -> None:
        try:
            work()
        except GrsError as error:
            self._say(str(error), failed=True)
        except ValidationError as error:
            fault = error.errors(include_url=False)[0]
            self._say(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}", failed=True)

    def _say(self, *lines: str, failed: bool = False) -> None:
        color = "#c92a2a" if failed else "inherit"
        self._status.content = f'<div role="status" style="color:{color}">{escape_lines(*lines, size=0.9)}</div>'

    def _apply(self, edit: Edit, place: Pixel | None = None) -> None:
        """Apply an edit; the object at ``place`` is selected then."""
        self._say(f"{describe_edit(edit)} …")
        try:
            self._editor.apply(edit)
        except GrsError:
            self._set_mode("select")  # and a dragged object goes back
            raise
        if isinstance(edit, ChooseTable | PlaceRobot):
            self._draw_place()
        self._place = place or self._place
        self._set_mode("select")
        self._say(describe_edit(edit))

    def _set_mode(self, mode: Mode, offer: tuple[Edit, Mask] | None = None) -> None:
        scene = self._viser.scene
        if self._mode in ("add", "split"):
            scene.remove_rect_select_callback("all")
        self._mode, self._offer = mode, offer
        if mode in ("add", "split"):
            self._show_photo(True)
            scene.on_rect_select()(self._later(self._take_rectangle))
        self._redraw()
        self._say(_ASKS[mode])

    # Selection

    def _selected(self) -> SceneObject | None:
        return None if self._place is None else self._find_object(*self._place)

    def _find_object(self, column: float, row: float) -> SceneObject | None:
        """The smallest object at a pixel."""
        at = (math.floor(row + 0.5), math.floor(column + 0.5))
        height, width = self._editor.photo.depth.shape
        if not (0 <= at[0] < height and 0 <= at[1] < width):
            return None
        masks = self._editor.masks
        there = [item for item in self._editor.scene.objects if item.name in masks and masks[item.name][at]]
        return min(there, key=lambda item: int(masks[item.name].sum()), default=None)

    def _find_object_along(self, origin: Vec3, direction: Vec3) -> str | None:
        """The name of the first object on a ray from a point, m.

        The browser could find it, but its objects would take the clicks on parts of the gizmo that lie in them.
        """
        items, library = self._editor.scene.objects, self._editor.library
        placed = [PlacedObject(item.asset, item.settled or (item.position, item.orientation)) for item in items]
        sight = VisibleScene(to_instance_objects(placed, library), library)
        owner = int(render_along_rays(sight, np.array(origin), np.array(direction)[None, None]).owner[0, 0])
        return items[owner].name if owner >= 0 else None

    def _require_selected(self) -> SceneObject:
        item = self._selected()
        if item is None:
            raise GrsError("no object is selected", "click one in the photo or in the list")
        return item

    def _select(self, name: str) -> None:
        place = self._editor.place_of(name)
        selected = self._selected()
        if self._mode == "merge" and selected is not None and self._place is not None and selected.name != name:
            self._apply(Merge(places=(self._editor.place_of(selected.name), place)), place)
            return
        self._place = place
        self._redraw()
        self._say(
            f"{name} is selected. Drag it by its arrows and ring in 3D."
            if self._mode == "select"
            else _ASKS[self._mode]
        )

    def _pixel(self, client: Any, screen: tuple[float, float]) -> tuple[float, float] | None:
        camera = client.camera
        turn = np.asarray(camera.wxyz, np.float64)
        rotation = quaternion_to_matrix((turn[1], turn[2], turn[3], turn[0]))
        viewer = Viewer(rotation, np.asarray(camera.position, np.float64), float(camera.fov), float(camera.aspect))
        return self._plane.find_pixel(screen, viewer)

    def _click(self, event: Any) -> None:
        if not self._photo_shown:
            name = self._find_object_along(event.ray_origin, event.ray_direction)
            if name is not None:
                self._select(name)
            return
        if self._mode in ("add", "split"):
            return
        pixel = self._pixel(event.client, event.screen_pos)
        if pixel is None:
            return
        if self._mode == "table":
            self._place = None
            self._apply(ChooseTable(point=(max(0, round(pixel[0])), max(0, round(pixel[1])))))
        elif (item := self._find_object(*pixel)) is not None:
            self._select(item.name)

    def _take_rectangle(self, event: Any) -> None:
        mode, photo = self._mode, self._editor.photo
        corners = [self._pixel(event.client, corner) for corner in (event.screen_min, event.screen_max)]
        if mode not in ("add", "split") or corners[0] is None or corners[1] is None:
            return
        height, width = photo.depth.shape
        columns = np.clip(sorted(corner[0] + 0.5 for corner in corners if corner), 0, width - 1)
        rows = np.clip(sorted(corner[1] + 0.5 for corner in corners if corner), 0, height - 1)
        left, right, top, bottom = (round(float(value)) for value in (*columns, *rows))
        rectangle = Rectangle(left=left, top=top, right=right, bottom=bottom)
        if mode == "add":
            edit: Edit = Add(rectangle=rectangle)
            mask = self._editor.preview_mask(rectangle)
        else:
            item = self._require_selected()
            edit = Split(place=self._editor.place_of(item.name), rectangle=rectangle)
            mask = self._editor.masks[item.name] & rectangle.mask((height, width))
        if mask is None or not mask.any():
            fault = (
                "differs from its rim: drag a larger or tighter one" if mode == "add" else "is of the selected object"
            )
            self._say(f"Nothing in this rectangle {fault}.", failed=True)
            return
        self._set_mode("select", (edit, mask))
        self._say(f"{int(mask.sum())} pixels, magenta in the photo: take this mask?")

    def _take_offer(self) -> None:
        if self._offer is None:
            return
        edit, mask = self._offer
        rows, columns = np.nonzero(mask)
        middle = len(rows) // 2
        self._apply(edit, (int(columns[middle]), int(rows[middle])))

    # Panel

    def _build_panel(self) -> None:
        gui = self._viser.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        gui.set_panel_label("grs edit")
        gui.main_panel.dock_right()
        self._status = gui.add_html("")
        self._button_group("View", {"Photo": partial(self._show_photo, True), "3D": partial(self._show_photo, False)})
        self._button_group(
            "Edits", {"Undo": partial(self._step, "undo"), "Redo": partial(self._step, "redo"), "Save": self._save}
        )
        self._take_mask = self._button("Take this mask", self._take_offer, color="green")
        self._cancel = self._button("Cancel", partial(self._set_mode, "select"), color="gray")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Objects"):
            self._button("Add an object: drag a rectangle", partial(self._set_mode, "add"))
            with gui.add_folder("Selected") as self._details:
                self._facts = gui.add_html("")
                self._button_group(
                    "Object",
                    {
                        "Merge": partial(self._begin_with_selected, "merge"),
                        "Split": partial(self._begin_with_selected, "split"),
                        "Delete": lambda: self._edit(lambda place: Delete(place=place)),
                    },
                )
                self._button_group(
                    "This is",
                    {kind.capitalize(): partial(self._mark, kind) for kind in ("robot", "scenery", "container")},
                )
                self._name = gui.add_text("Name", "")
                self._mass = gui.add_number("Mass, kg", 0.1, step=0.001)
                self._friction = gui.add_number("Friction", 0.6, step=0.01)
                self._button("Set name, mass and friction", self._set_facts)
                self._button_group(
                    "Shape", {shape.capitalize(): partial(self._shape, shape) for shape in ("box", "cylinder", "bowl")}
                )
                self._button_group("Asset", {"As seen": partial(self._choose_asset, AS_SEEN), "Best ten": self._rank})
                self._ranked = gui.add_html("", visible=False)
                self._asset = gui.add_dropdown("Best ten", ("-",), visible=False)
                self._take_asset = self._button(
                    "Take this asset", lambda: self._choose_asset(self._names[self._asset.value])
                )
                self._take_asset.visible = False
                self._names: dict[str, str] = {}
            self._list = gui.add_folder("Objects of the scene")
        with tabs.add_tab("Table and robot"):
            self._planes = gui.add_html("")
            self._button("Choose the table: click it in the photo", partial(self._set_mode, "table"))
            self._moves_robot = gui.add_checkbox("Move the robot's base", False)
            self._moves_robot.on_update(self._later(lambda _: self._show_photo(not self._moves_robot.value)))
            self._edits = gui.add_html("")
        with tabs.add_tab("Run"):
            gui.add_html(escape_lines("Saves the scene, and makes a task in it."))
            self._run_button = self._button("Go on", self._run, color="green")
            self._steps = gui.add_html("")
            self._button("Finish: save and close", lambda: self._work.put(None), color="gray")

    def _button(self, label: str, work: Callable[[], None], **options: Any) -> Any:
        button = self._viser.gui.add_button(label, **options)
        button.on_click(self._later(lambda _: work()))
        return button

    def _button_group(self, label: str, work: Mapping[str, Callable[[], None]]) -> None:
        group = self._viser.gui.add_button_group(label, tuple(work))

        async def enqueue(event: Any) -> None:
            self._work.put(work[event.target.value])

        group.on_click(enqueue)

    # Acts

    def _edit(self, make: Callable[[Pixel], Edit]) -> None:
        self._apply(make(self._editor.place_of(self._require_selected().name)))

    def _mark(self, kind: Literal["robot", "scenery", "container"]) -> None:
        self._edit(lambda place: Mark(place=place, kind=kind))

    def _shape(self, shape: Literal["box", "cylinder", "bowl"]) -> None:
        self._edit(lambda place: ChooseShape(place=place, shape=shape))

    def _choose_asset(self, asset: str) -> None:
        self._edit(lambda place: ChooseAsset(place=place, asset=asset))

    def _begin_with_selected(self, mode: Mode) -> None:
        self._require_selected()
        self._set_mode(mode)

    def _step(self, act: Literal["undo", "redo"]) -> None:
        before = self._editor.scene.frame
        self._editor.undo() if act == "undo" else self._editor.redo()
        if self._editor.scene.frame != before:
            self._draw_place()
        self._set_mode("select")
        changed = self._editor.undone[-1] if act == "undo" else self._editor.edits[-1]
        self._say(f"{'Undone' if act == 'undo' else 'Done again'}: {describe_edit(changed)}")

    def _save(self) -> None:
        self._say("saving …")
        self._say(f"Saved: {self._editor.save()}")

    def _set_facts(self) -> None:
        item = self._require_selected()
        place = self._editor.place_of(item.name)
        shown = (*map(_rounded, self._physics(item)), item.name)
        mass, friction, name = (
            self._mass.value,
            self._friction.value,
            self._name.value,
        )  # before an edit fills them anew
        if mass != shown[0]:
            self._apply(SetMass(place=place, mass=mass), place)
        if friction != shown[1]:
            self._apply(SetFriction(place=place, friction=friction), place)
        if name != shown[2]:
            self._apply(Rename(place=place, name=name), place)

    def _physics(self, item: SceneObject) -> tuple[float, float]:
        """Mass (kg) and coefficient of friction."""
        asset = self._editor.library.asset(item.asset)
        return (
            asset.mass if item.mass is None else item.mass,
            asset.friction if item.friction is None else item.friction,
        )

    def _rank(self) -> None:
        item, library = self._require_selected(), self._editor.library
        self._say("comparing pictures …")
        names = self._editor.ranked_assets(self._editor.place_of(item.name))
        cells: list[str] = []
        for number, name in enumerate(names, 1):
            view = render_asset_views(library, name, [_ASIDE], size=2 * THUMBNAIL)[0].rgba
            cover = view[..., 3:] / 255
            picture = np.rint(view[..., :3] * cover + 245 * (1 - cover)).astype(np.uint8)
            shown = inline_picture(crop_thumbnail(picture, np.ones(picture.shape[:2], np.bool_)))
            kind = escape_lines(f"{number} {library.asset(name).kind.replace('_', ' ')}", size=0.65)
            cells.append(f'<div style="width:60px">{shown}{kind}</div>')
        self._ranked.content = f'<div style="display:flex;flex-wrap:wrap;gap:6px">{"".join(cells)}</div>'
        self._names = {f"{number} {name}": name for number, name in enumerate(names, 1)}
        self._asset.options = tuple(self._names) or ("-",)
        self._asset.value = next(iter(self._names), "-")
        for handle in (self._ranked, self._asset, self._take_asset):
            handle.visible = bool(names)
        self._say(f"{len(names)} assets look like it, the best first.")

    def _run(self) -> None:
        self._run_button.disabled = True
        steps: list[str] = []

        def show(step: str) -> None:
            steps.append(step)
            self._steps.content = escape_lines(*steps)

        try:
            self._save()
            self._say("The graph runs; edits wait until it ends.")
            ended = self._go_on(show)
        finally:
            self._run_button.disabled = False
        self._server.documents[REPORT] = ended.report
        verdict = escape_lines(f"{ended.status}: {ended.reason}" if ended.reason else ended.status, size=1.0)
        where = escape_lines(f"{ended.folder}", f"grs replay {ended.folder} opens the trace.")
        link = f'<a href="{REPORT}" target="_blank" rel="noopener">Report: programs, audit, trace</a>'
        film = _FILM.search(ended.report)
        shown = "" if film is None else f'<img alt="film" style="width:100%" src="{film[0].decode()}">'
        self._steps.content = f"<b>{verdict}</b>{shown}{link}{where}{escape_lines(*steps)}"
        self._say(f"The run is {ended.status}.")

    # Drawing

    def _show_photo(self, shown: bool) -> None:
        self._photo_shown = shown
        self._photo_node.visible, self._cloud.visible = shown, not shown
        self._redraw()
        for client in self._viser.get_clients().values():
            self._look(client)

    def _welcome(self, client: Any) -> None:
        """Show a browser the photo, and again whole where its window or panel changes."""
        shown: list[float] = []  # aspects

        async def fit(camera: Any) -> None:
            aspect = float(camera.aspect)
            if self._photo_shown and shown[-1:] != [aspect]:
                shown.append(aspect)
                self._work.put(partial(self._look, client))

        client.camera.on_update(fit)
        self._look(client)

    def _look(self, client: Any) -> None:
        """Put a browser's camera at the photo's, or aside of it."""
        pose, camera = self._plane.pose, client.camera
        centre = self._centre()
        with client.atomic():
            if self._photo_shown:
                camera.up_direction = pose[:3, :3] @ np.array([0.0, -1.0, 0.0])
                camera.position = pose[:3, 3]
                camera.look_at = pose[:3, 3] + pose[:3, :3] @ np.array([0.0, 0.0, 1.0])
                camera.fov = self._plane.find_field_of_view(float(camera.aspect))
            else:
                away = pose[:3, 3] - centre
                turn = math.radians(35)
                turned = np.array(
                    [
                        away[0] * math.cos(turn) - away[1] * math.sin(turn),
                        away[0] * math.sin(turn) + away[1] * math.cos(turn),
                        away[2],
                    ]
                )
                camera.up_direction = (0.0, 0.0, 1.0)
                camera.position = centre + 1.1 * turned
                camera.look_at = centre
                camera.fov = math.radians(50)

    def _centre(self) -> Floats:
        """(3,) between the objects, or halfway to the robot that is moved, m."""
        positions = [item.position for item in self._editor.scene.objects] or [(0.5, 0.0, 0.0)]
        centre: Floats = np.mean(positions, axis=0)
        return centre / 2 if self._moves_robot.value else centre

    def _draw_place(self) -> None:
        """Draw all that depends on the robot frame: photo, cloud, table and robot."""
        scene, photo, frame = self._viser.scene, self._editor.photo, self._editor.scene.frame
        scene.reset()
        scene.set_up_direction("+z")
        self._nodes.clear()
        pose = np.asarray(frame.T_robot_cam, np.float64)
        self._plane = PhotoPlane(photo.camera.intrinsics, pose)
        turn = matrix_to_quaternion(pose[:3, :3])
        self._photo_node = scene.add_image(
            "/photo",
            photo.rgb,
            *self._plane.size,
            wxyz=(turn[3], *turn[:3]),
            position=self._plane.centre,
            format="jpeg",
            jpeg_quality=90,
            cast_shadow=False,
            receive_shadow=False,
            visible=self._photo_shown,
        )
        points = photo.camera_frame_point_map() @ pose[:3, :3].T + pose[:3, 3]
        seen = photo.depth > 0
        height = points[..., 2]
        self._levels = {"table": clean_region(seen & (np.abs(height - frame.height) < _TABLE_BAND))}
        for plane in frame.planes:
            if not plane.taken:
                near = seen & (np.abs(height - plane.height) < MOST_OFF_PLANE)
                self._levels[f"plane {plane.number}"] = clean_region(near)
        kept = np.flatnonzero(seen)[:: max(1, int(seen.sum()) // _MOST_POINTS)]
        self._cloud = scene.add_point_cloud(
            "/cloud",
            points.reshape(-1, 3)[kept].astype(np.float32),
            photo.rgb.reshape(-1, 3)[kept],
            point_size=0.002,
            precision="float32",
            visible=not self._photo_shown,
        )
        scene.add_frame("/robot", axes_length=0.15, axes_radius=0.006, position=(0.0, 0.0, 0.0))
        for name, radius in (("near", NEAREST), ("far", FARTHEST)):
            around = np.linspace(-np.pi, np.pi, 97)
            ring = np.stack([radius * np.cos(around), radius * np.sin(around), np.full(97, frame.height)], axis=-1)
            segments = np.stack([ring[:-1], ring[1:]], axis=1).astype(np.float32)
            scene.add_line_segments(f"/robot/{name}", segments, _REACH_COLOR, thickness=0.004)
        self._gizmo = self._add_gizmo("/gizmo", 0.15, self._drag_object)
        self._robot_gizmo = self._add_gizmo("/base", 0.3, self._drag_robot)
        planes = [
            f"plane {plane.number}: {plane.height * 100:+.1f} cm, {plane.share:.0%} of the photo"
            + (", the table" if plane.taken else "")
            for plane in frame.planes
        ] or ["no planes were searched"]
        self._planes.content = escape_lines(f"Robot frame: {frame.origin.replace('_', ' ')}. {frame.note}", *planes)
        if self._photo_shown:  # else it is seen from where it was in the frame before
            for client in self._viser.get_clients().values():
                self._look(client)

    def _add_gizmo(self, name: str, scale: float, moved: Callable[[Floats, float, bool], None]) -> Any:
        gizmo = self._viser.scene.add_transform_controls(
            name, scale=scale, active_axes=(True, True, False), depth_test=False, visible=False
        )

        async def enqueue(event: Any) -> None:
            if event.client_id is None:  # written by this page
                return
            turn = np.asarray(gizmo.wxyz, np.float64)
            pose = (np.array(gizmo.position, np.float64), 2 * math.atan2(turn[3], turn[0]))
            waiting, self._dragged = self._dragged is not None, pose
            if event.phase == "end":
                self._dragged = None
                self._work.put(partial(moved, *pose, True))
            elif not waiting:
                self._work.put(partial(self._show_drag, moved))

        gizmo.on_update(enqueue)
        return gizmo

    def _show_drag(self, moved: Callable[[Floats, float, bool], None]) -> None:
        pose, self._dragged = self._dragged, None
        if pose is not None:
            moved(*pose, False)

    def _drag_object(self, position: Floats, yaw: float, ended: bool) -> None:
        item = self._selected()
        if item is None:
            return
        start, orientation = _pose(item)
        shift = position - start
        yaw = math.remainder(yaw, 2 * math.pi)
        target = (float(item.position[0] + shift[0]), float(item.position[1] + shift[1]))
        place = self._editor.place_of(item.name)
        if ended:
            if math.hypot(shift[0], shift[1]) < _STILL[0] and abs(yaw) < math.radians(_STILL[1]):
                self._redraw()
            else:
                self._apply(Move(place=place, position=target, yaw=yaw))
            return
        turn = quaternion_to_matrix((0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
        turned = matrix_to_quaternion(turn @ quaternion_to_matrix(orientation))
        node = self._nodes[item.name][1]
        node.position, node.wxyz = (position[0], position[1], start[2]), (turned[3], *turned[:3])
        names = self._editor.overlaps(place, target, yaw)
        self._say(f"overlaps {', '.join(names)}" if names else f"{item.name}: free here", failed=bool(names))

    def _drag_robot(self, position: Floats, yaw: float, ended: bool) -> None:
        yaw = math.remainder(yaw, 2 * math.pi)
        at = (float(position[0]), float(position[1]))
        if ended:
            self._apply(PlaceRobot(position=at, yaw=yaw))
        else:
            self._say(f"base at {at[0]:.3f}, {at[1]:.3f} m, turned by {math.degrees(yaw):.0f}°")

    def _redraw(self) -> None:
        """Draw all that an edit changes."""
        scene, masks = self._editor.scene, self._editor.masks
        item = self._selected()
        shown = {each.name: masks[each.name] for each in scene.objects if each.name in masks}
        preview = self._offer[1] if self._offer else None
        levels = self._levels if self._mode == "table" else {"": self._levels["table"]}
        name = None if item is None else item.name
        with self._viser.atomic():
            self._photo_node.image = draw_photo(self._editor.photo.rgb, shown, name, levels, preview)
            self._draw_objects()
            self._draw_gizmos(item)
            self._fill_details(item)
            self._fill_rows(name)
            self._take_mask.visible = self._offer is not None
            self._cancel.visible = self._offer is not None or self._mode != "select"
            lines = [f"{number}. {describe_edit(edit)}" for number, edit in enumerate(self._editor.edits, 1)]
            self._edits.content = escape_lines("Edits:", *(lines or ["none"]))

    def _draw_objects(self) -> None:
        library, scene = self._editor.library, self._editor.scene
        names = {item.name for item in scene.objects}
        for name in [name for name in self._nodes if name not in names]:
            self._nodes.pop(name)[1].remove()
        for item in scene.objects:
            key = (item.asset, library.asset_path(item.asset).stat().st_mtime_ns)
            position, orientation = _pose(item)
            wxyz = (orientation[3], *orientation[:3])
            if item.name not in self._nodes or self._nodes[item.name][0] != key:
                if item.name in self._nodes:
                    self._nodes[item.name][1].remove()
                node = self._viser.scene.add_glb(
                    f"/objects/{quote(item.name, safe='')}", build_asset_glb(library, item.asset)
                )
                self._nodes[item.name] = (key, node)
            node = self._nodes[item.name][1]
            node.position, node.wxyz, node.visible = position, wxyz, not self._photo_shown

    def _draw_gizmos(self, item: SceneObject | None) -> None:
        robot = bool(self._moves_robot.value)
        self._gizmo.visible = item is not None and not self._photo_shown and not robot
        if item is not None:
            self._gizmo.position, self._gizmo.wxyz = _pose(item)[0], (1.0, 0.0, 0.0, 0.0)
        self._robot_gizmo.visible = robot and not self._photo_shown
        self._robot_gizmo.position, self._robot_gizmo.wxyz = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)

    def _fill_details(self, item: SceneObject | None) -> None:
        self._details.visible = item is not None
        for handle in (self._ranked, self._asset, self._take_asset):
            handle.visible = False
        if item is None:
            return
        self._facts.content = self._describe(item)
        facts = (item.name, *map(_rounded, self._physics(item)))
        for field, value in zip((self._name, self._mass, self._friction), facts, strict=True):
            if self._filled.get(field.label) != (item.id, value):  # else a person may be changing it
                self._filled[field.label], field.value = (item.id, value), value

    def _fill_rows(self, selected: str | None) -> None:
        objects = self._editor.scene.objects
        while len(self._rows) > len(objects):
            for handle in self._rows.pop():
                handle.remove()
        while len(self._rows) < len(objects):
            number = len(self._rows)
            with self._list:
                button = self._viser.gui.add_button("", color="gray")
                facts = self._viser.gui.add_html("")
            button.on_click(self._later(lambda _, number=number: self._select_row(number)))
            self._rows.append((button, facts))
        for number, (item, (button, facts)) in enumerate(zip(objects, self._rows, strict=True), 1):
            label, content = f"{number}  {item.name}", self._describe(item)
            color = "yellow" if item.name == selected else "gray"
            if button.label != label:
                button.label = label
            if button.color != color:
                button.color = color
            if facts.content != content:
                facts.content = content

    def _select_row(self, number: int) -> None:
        if number < len(self._editor.scene.objects):
            self._select(self._editor.scene.objects[number].name)

    def _describe(self, item: SceneObject) -> str:
        """An object as HTML: thumbnail, asset, size, mass, confidence, support and doubts."""
        scene, masks = self._editor.scene, self._editor.masks
        confidence = None if item.match is None else item.match.confidence
        under = [f"{each.kind} {each.reference}" for each in scene.relations if each.subject == item.name]
        lines = [
            f"{item.asset}{'' if item.matched else ' (reconstructed)'}",
            f"{' x '.join(f'{100 * extent:.1f}' for extent in item.size)} cm, {1000 * self._physics(item)[0]:.0f} g"
            + ("" if confidence is None else f", confidence {confidence:.0%}"),
            ", ".join(under) or "on the table",
            *doubts_of(item),
        ]
        mask = masks.get(item.name)
        picture: Image | None = None if mask is None else crop_thumbnail(self._editor.photo.rgb, mask)
        shown = "" if picture is None else inline_picture(picture)
        return (
            f'<div style="display:flex;gap:8px;align-items:flex-start">{shown}<div>{escape_lines(*lines)}</div></div>'
        )


def doubts_of(item: SceneObject) -> list[str]:
    """The doubtful facts about an object, a line each."""
    doubts = [item.pick_trouble] if item.pick_trouble else []
    if item.held:
        doubts.append("would fall: held in the air")
    if item.stands_in_robot:
        doubts.append("stands in the robot: left out of tasks")
    if not item.reachable:
        doubts.append("out of the robot's reach")
    if item.drift is not None and item.drift > 0.02:
        doubts.append(f"moves by {100 * item.drift:.1f} cm until it rests")
    if item.match is not None and item.match.runner_up:
        doubts.append(f"or {item.match.runner_up}")
    return doubts


def _pose(item: SceneObject) -> tuple[Floats, tuple[float, float, float, float]]:
    """Position (m) and orientation (xyzw) at rest."""
    position, orientation = item.settled or (item.position, item.orientation)
    return np.asarray(position, np.float64), orientation


def _rounded(value: float) -> float:
    return round(float(value), 4)
