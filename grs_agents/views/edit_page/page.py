"""The page: photo, twin, list of objects, and an edit for each act of a person.

Handlers of the browser's events only queue them: the thread that calls `EditPage.serve` does all work, in their order.
"""

import gc
import math
import queue
import re
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any, Final, Literal

import numpy as np
from pydantic import ValidationError

from grs_agents.base.errors import GrsError
from grs_agents.perception.edits import (
    Add,
    ChooseAsset,
    ChooseShape,
    ChooseTable,
    CorrectMask,
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
)
from grs_agents.perception.types import Mask, SceneObject
from grs_agents.views.edit_page.editor import Editor, GoOn
from grs_agents.views.edit_page.guard import GuardedServer
from grs_agents.views.edit_page.object_facts import physics_of
from grs_agents.views.edit_page.panel import Mode, Panel, Shown
from grs_agents.views.edit_page.photo_plane import Floats, escape_lines
from grs_agents.views.edit_page.scene_view import SceneView, pose_at_rest

_STILL = (0.001, 0.5)  # m, degrees: a gizmo moved by less is not moved
_READ: Final = 12.0  # s until a refusal disappears
REPORT: Final = "/report"
_FILM: Final = re.compile(rb"data:image/webp;base64,[A-Za-z0-9+/=]+")  # in a report, of its film alone
_RECTANGLES: Final = ("add", "split", "include", "exclude")
_ASKS: Final[dict[Mode, str]] = {
    "select": "Click an object in the photo, in 3D or in the list.",
    "add": "Drag a rectangle round the object, with a margin of the table.",
    "split": "Drag a rectangle round a part of the selected object.",
    "include": "Drag a rectangle round the part that the selected object lacks.",
    "exclude": "Drag a rectangle round the part that is not of the selected object.",
    "merge": "Click the object that belongs to the selected one.",
    "table": "Click the table in the photo. Perception begins anew.",
}


class EditPage:
    """A page for an editor on a guarded server."""

    def __init__(self, editor: Editor, server: GuardedServer, go_on: GoOn) -> None:
        """Build the page; it reacts while `serve` runs."""
        self._editor, self._server, self._go_on = editor, server, go_on
        self._work: queue.Queue[Callable[[], None] | None] = queue.Queue()
        self._place: Pixel | None = None  # of the selected object
        self._mode: Mode = "select"
        self._offer: tuple[Edit, Mask] | None = None  # an edit to confirm, with its mask
        self._panel = Panel(server.viser.gui, self, self._work.put)
        self._view = SceneView(server.viser, editor, self._work.put, self._drag_object, self._drag_robot)
        self._panel.show_planes(editor.scene.frame)
        self.begin("select")
        server.viser.on_client_connect(self._later(self._view.welcome))
        server.viser.scene.on_click()(self._later(self._click))

    def serve(self) -> None:
        """React to the person until "Finish" is pressed or the process is interrupted; then save."""
        gc.freeze()  # all that is there stays: the collections below look at an act's objects alone
        try:
            while (work := self._work.get()) is not None:
                try:
                    work()
                except GrsError as error:
                    self._refuse(str(error))
                except ValidationError as error:
                    fault = error.errors(include_url=False)[0]
                    self._refuse(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}")
                gc.collect()  # the simulations of an act, large worlds in cycles of references
        finally:
            gc.unfreeze()
            self._editor.save()

    def _refuse(self, reason: str) -> None:
        """Say why an act is refused, also where the panel is scrolled."""
        self._panel.say(reason, failed=True)
        for client in self._server.viser.get_clients().values():
            client.add_notification("Nothing is changed", reason, color="red", auto_close_seconds=_READ)

    def finish(self) -> None:
        """End `serve`."""
        self._work.put(None)

    def _later(self, work: Callable[[Any], None]) -> Callable[[Any], Coroutine[Any, Any, None]]:
        async def enqueue(event: Any) -> None:  # on the server's event loop, hence in the order of the events
            self._work.put(partial(work, event))

        return enqueue

    # State

    def begin(self, mode: Mode, offer: tuple[Edit, Mask] | None = None) -> None:
        """Wait for what a mode asks, or offer an edit with its mask."""
        if mode in ("merge", "split", "include", "exclude"):
            self._require_selected()
        scene = self._server.viser.scene
        if self._mode in _RECTANGLES:
            scene.remove_rect_select_callback("all")
        self._mode, self._offer = mode, offer
        if mode in _RECTANGLES:
            scene.on_rect_select()(self._later(self._take_rectangle))
        if mode in (*_RECTANGLES, "table") and not self._view.shows_photo:
            self._view.show(photo=True)
        self._redraw()
        self._panel.say(_ASKS[mode])

    def _redraw(self) -> None:
        """Draw all that an edit changes."""
        editor, item = self._editor, self._selected()
        scene, masks = editor.scene, editor.masks
        numbered = {each.id: masks[each.name] for each in scene.objects}
        with self._server.viser.atomic():
            self._view.draw_photo(
                numbered, item and item.id, self._offer and self._offer[1], offers_planes=self._mode == "table"
            )
            self._view.draw_objects(item)
            self._panel.show(
                Shown(
                    scene,
                    editor.library,
                    editor.photo.rgb,
                    masks,
                    item,
                    offers=self._offer is not None,
                    busy=self._mode != "select",
                )
            )

    def show_photo(self, shown: bool) -> None:
        """Show the photo, or the twin in 3D."""
        self._view.show(shown)
        self._redraw()

    def move_robot(self, moves: bool) -> None:
        """Show the handle of the robot's base, or hide it."""
        self._view.moves_robot = moves
        self.show_photo(not moves)

    def _selected(self) -> SceneObject | None:
        return None if self._place is None else self._find_object(*self._place)

    def _find_object(self, column: float, row: float) -> SceneObject | None:
        """The smallest object at a pixel."""
        at = (math.floor(row + 0.5), math.floor(column + 0.5))
        height, width = self._editor.photo.depth.shape
        if not (0 <= at[0] < height and 0 <= at[1] < width):
            return None
        masks = self._editor.masks
        there = [item for item in self._editor.scene.objects if masks[item.name][at]]
        return min(there, key=lambda item: int(masks[item.name].sum()), default=None)

    def _require_selected(self) -> tuple[SceneObject, Pixel]:
        """The selected object, and a place that names it."""
        item = self._selected()
        if item is None:
            raise GrsError("no object is selected", "click one in the photo or in the list")
        return item, self._editor.place_of(item.name)

    def select(self, name: str) -> None:
        """Select an object, or merge it with the selected one."""
        place, selected = self._editor.place_of(name), self._selected()
        if self._mode == "merge" and selected is not None and selected.name != name:
            self._apply(Merge(places=(self._editor.place_of(selected.name), place)), place)
            return
        self._place = place
        self._redraw()
        self._panel.say(
            f"{name} is selected. Drag it by its arrows and ring in 3D."
            if self._mode == "select"
            else _ASKS[self._mode]
        )

    # Pointer

    def _click(self, event: Any) -> None:
        if not self._view.shows_photo:
            name = self._view.find_object_along(event.ray_origin, event.ray_direction)
            if name is not None:
                self.select(name)
            return
        pixel = None if self._mode in _RECTANGLES else self._view.find_pixel(event.client, event.screen_pos)
        if pixel is None:
            return
        if self._mode == "table":
            self._place = None
            self._apply(ChooseTable(point=(max(0, round(pixel[0])), max(0, round(pixel[1])))))
        elif (item := self._find_object(*pixel)) is not None:
            self.select(item.name)

    def _take_rectangle(self, event: Any) -> None:
        mode, photo = self._mode, self._editor.photo
        corners = [self._view.find_pixel(event.client, corner) for corner in (event.screen_min, event.screen_max)]
        if mode not in _RECTANGLES or corners[0] is None or corners[1] is None:
            return
        height, width = photo.depth.shape
        columns = np.clip(sorted(corner[0] + 0.5 for corner in corners if corner), 0, width - 1)
        rows = np.clip(sorted(corner[1] + 0.5 for corner in corners if corner), 0, height - 1)
        left, right, top, bottom = (round(float(value)) for value in (*columns, *rows))
        rectangle = Rectangle(left=left, top=top, right=right, bottom=bottom)
        edit: Add | Split | CorrectMask
        if mode == "add":
            edit = Add(rectangle=rectangle)
        else:
            _, place = self._require_selected()
            if mode == "split":
                edit = Split(place=place, rectangle=rectangle)
            else:
                edit = CorrectMask(place=place, rectangle=rectangle, kind=mode)
        mask = self._editor.preview_part(edit)
        if mask is None or not mask.any():
            fault = "Nothing in this rectangle differs from its rim: drag a larger or tighter one."
            self._panel.say(fault, failed=True)
            return
        self.begin("select", (edit, mask))
        self._panel.say(f"{int(mask.sum())} pixels, magenta in the photo: take this mask?")

    def _drag_object(self, position: Floats, yaw: float, ended: bool) -> None:
        if self._selected() is None:
            return
        item, place = self._require_selected()
        shift = position - pose_at_rest(item)[0]
        target = (float(item.position[0] + shift[0]), float(item.position[1] + shift[1]))
        if not ended:
            self._view.drag_object(item, position, yaw)
            names = self._editor.overlaps(place, target, yaw)
            self._panel.say(f"overlaps {', '.join(names)}" if names else f"{item.name}: free here", failed=bool(names))
        elif math.hypot(shift[0], shift[1]) < _STILL[0] and abs(yaw) < math.radians(_STILL[1]):
            self._redraw()
        else:
            self._apply(Move(place=place, position=target, yaw=yaw))

    def _drag_robot(self, position: Floats, yaw: float, ended: bool) -> None:
        at = (float(position[0]), float(position[1]))
        if ended:
            self._apply(PlaceRobot(position=at, yaw=yaw))
        else:
            self._panel.say(f"base at {at[0]:.3f}, {at[1]:.3f} m, turned by {math.degrees(yaw):.0f}°")

    # Acts

    def _apply(self, edit: Edit, place: Pixel | None = None) -> None:
        """Apply an edit; the object at ``place`` is selected then."""
        item = self._selected()
        self._panel.say(f"{edit.act.replace('_', ' ')}{'' if item is None else f' {item.name}'} …")
        try:
            self._editor.apply(edit)
        except GrsError:
            self.begin("select")  # and a dragged object goes back
            raise
        if isinstance(edit, ChooseTable | PlaceRobot):
            self._draw_place()
        self._place = place or self._place
        self.begin("select")
        self._panel.say(self._editor.scene.edits[-1])

    def _draw_place(self) -> None:
        self._view.draw_place()
        self._panel.show_planes(self._editor.scene.frame)

    def take_offer(self) -> None:
        """Apply the offered edit."""
        if self._offer is None:
            return
        edit, mask = self._offer
        if isinstance(edit, CorrectMask) and edit.kind == "exclude" and (item := self._find_object(*edit.place)):
            rest = self._editor.masks[item.name] & ~mask  # stays selected
            mask = rest if rest.any() else mask
        rows, columns = np.nonzero(mask)
        middle = len(rows) // 2
        self._apply(edit, (int(columns[middle]), int(rows[middle])))

    def delete(self) -> None:
        """Delete the selected object."""
        self._apply(Delete(place=self._require_selected()[1]))

    def mark(self, kind: Literal["robot", "scenery", "container"]) -> None:
        """Say what the selected object is."""
        self._apply(Mark(place=self._require_selected()[1], kind=kind))

    def reshape(self, shape: Literal["box", "cylinder", "bowl"]) -> None:
        """Replace the selected object by a primitive of its size."""
        self._apply(ChooseShape(place=self._require_selected()[1], shape=shape))

    def set_facts(self, name: str, mass: float, friction: float) -> None:
        """Set the name, the mass (kg) and the friction of the selected object, where they differ from those shown."""
        item, place = self._require_selected()
        shown = (*physics_of(item, self._editor.library), item.name)
        if mass != shown[0]:
            self._apply(SetMass(place=place, mass=mass), place)
        if friction != shown[1]:
            self._apply(SetFriction(place=place, friction=friction), place)
        if name != shown[2]:
            self._apply(Rename(place=place, name=name), place)

    def rank_assets(self) -> None:
        """Offer the assets that look like the selected object."""
        _, place = self._require_selected()
        self._panel.say("comparing pictures …")
        names = self._editor.ranked_assets(place)
        self._panel.show_assets(names, self._editor.library)
        self._panel.say(f"{len(names)} assets look like it, the best first.")

    def choose_asset(self, asset: str) -> None:
        """Replace the selected object by an asset, or by its reconstruction."""
        self._apply(ChooseAsset(place=self._require_selected()[1], asset=asset))

    def step(self, act: Literal["undo", "redo"]) -> None:
        """Undo the last act, or do it again."""
        frame, lines = self._editor.scene.frame, self._editor.scene.edits
        self._editor.undo() if act == "undo" else self._editor.redo()
        if self._editor.scene.frame != frame:
            self._draw_place()
        self.begin("select")
        self._panel.say(f"Undone: {lines[-1]}" if act == "undo" else f"Done again: {self._editor.scene.edits[-1]}")

    def save(self) -> None:
        """Write the scene and its edits."""
        self._panel.say("saving …")
        self._panel.say(f"Saved: {self._editor.save()}")

    def run(self) -> None:
        """Save, run the graph from the scene, and show its steps, film and verdict."""
        panel, steps = self._panel, list[str]()
        panel.run_button.disabled = True

        def show(step: str) -> None:
            steps.append(step)
            panel.run_steps.content = escape_lines(*steps)

        try:
            self.save()
            panel.say("The graph runs; edits wait until it ends.")
            ended = self._go_on(show)
        finally:
            panel.run_button.disabled = False
        self._server.documents[REPORT] = ended.report
        verdict = escape_lines(f"{ended.status}: {ended.reason}" if ended.reason else ended.status, size=1.0)
        where = escape_lines(f"{ended.folder}", f"grs replay {ended.folder} opens the trace.")
        link = f'<a href="{REPORT}" target="_blank" rel="noopener">Report: programs, audit, trace</a>'
        film = _FILM.search(ended.report)
        shown = "" if film is None else f'<img alt="film" style="width:100%" src="{film[0].decode()}">'
        panel.run_steps.content = f"<b>{verdict}</b>{shown}{link}{where}{escape_lines(*steps)}"
        panel.say(f"The run is {ended.status}.")
