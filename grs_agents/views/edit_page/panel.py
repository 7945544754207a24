"""The panel of the page: buttons, fields and lists."""

from collections.abc import Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, Protocol

from grs_agents.base.errors import GrsError
from grs_agents.library.library import Library
from grs_agents.perception.edits import AS_SEEN
from grs_agents.perception.types import Mask, SceneDescription, SceneObject, TableFrame
from grs_agents.views.edit_page.object_facts import describe_object, draw_assets, physics_of
from grs_agents.views.edit_page.photo_plane import Image, escape_lines

Mode = Literal["select", "add", "split", "include", "exclude", "merge", "table"]
Work = Callable[[], None]
_WIDTH = 300  # px: a third of a small window
_LEGEND = "3D: drag an object by its arrows or ring. Orange arcs: nearest and farthest reach of the robot."


class Acts(Protocol):
    """The acts that the panel offers."""

    def show_photo(self, shown: bool) -> None: ...
    def select(self, name: str) -> None: ...
    def begin(self, mode: Mode) -> None: ...
    def take_offer(self) -> None: ...
    def step(self, act: Literal["undo", "redo"]) -> None: ...
    def save(self) -> None: ...
    def delete(self) -> None: ...
    def mark(self, kind: Literal["robot", "scenery", "container"]) -> None: ...
    def reshape(self, shape: Literal["box", "cylinder", "bowl"]) -> None: ...
    def set_facts(self, name: str, mass: float, friction: float) -> None: ...
    def rank_assets(self) -> None: ...
    def choose_asset(self, asset: str) -> None: ...
    def move_robot(self, moves: bool) -> None: ...
    def run(self) -> None: ...
    def finish(self) -> None: ...


@dataclass(frozen=True)
class Shown:
    """The state that the panel shows."""

    scene: SceneDescription
    library: Library
    rgb: Image
    masks: Mapping[str, Mask]
    selected: SceneObject | None
    offers: bool  # a mask to take
    busy: bool  # a mode that can be cancelled


class Panel:
    """The widgets, whose events are queued."""

    def __init__(self, gui: Any, acts: Acts, put: Callable[[Work], None]) -> None:
        """Build all widgets; ``put`` queues the work of an event."""
        self._gui, self._acts, self._put = gui, acts, put
        self._rows: list[tuple[Any, Any]] = []  # button and facts of each object
        self._names: list[str] = []  # of the objects in the rows
        self._filled: dict[str, tuple[int, str | float]] = {}  # of each field: object and value of the last filling
        self._assets: dict[str, str] = {}  # of the list of the best ten, by their lines
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        gui.set_panel_label("grs edit")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_WIDTH)
        self._status = gui.add_html("")
        self._buttons("View", {"Photo": partial(acts.show_photo, True), "3D": partial(acts.show_photo, False)})
        self._buttons(
            "Edits", {"Undo": partial(acts.step, "undo"), "Redo": partial(acts.step, "redo"), "Save": acts.save}
        )
        self._take_mask = self._button("Take this mask", acts.take_offer, color="green")
        self._cancel = self._button("Cancel", partial(acts.begin, "select"), color="gray")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Objects"):
            self._button("Add an object: drag a rectangle", partial(acts.begin, "add"))
            with gui.add_folder("Selected") as self._details:
                self._build_details(acts)
            self._list = gui.add_folder("Objects of the scene")
        with tabs.add_tab("Table and robot"):
            self._planes = gui.add_html("")
            self._button("Choose the table: click it in the photo", partial(acts.begin, "table"))
            self._moves_robot = gui.add_checkbox("Move the robot's base", False)
            self._moves_robot.on_update(self._queued(lambda: acts.move_robot(bool(self._moves_robot.value))))
            gui.add_html(escape_lines(_LEGEND))
            self._edits = gui.add_html("")
        with tabs.add_tab("Run"):
            gui.add_html(escape_lines("Saves the scene, and makes a task in it."))
            self.run_button = self._button("Go on", acts.run, color="green")
            self.run_steps = gui.add_html("")
            self._button("Finish: save and close", acts.finish, color="gray")

    def _build_details(self, acts: Acts) -> None:
        gui = self._gui
        self._facts = gui.add_html("")
        begin: Mapping[str, Work] = {"Merge": partial(acts.begin, "merge"), "Split": partial(acts.begin, "split")}
        self._buttons("Object", {**begin, "Delete": acts.delete})
        self._buttons("Mask", {"Include": partial(acts.begin, "include"), "Exclude": partial(acts.begin, "exclude")})
        self._buttons(
            "This is", {kind.capitalize(): partial(acts.mark, kind) for kind in ("robot", "scenery", "container")}
        )
        self._name = gui.add_text("Name", "")
        self._mass = gui.add_number("Mass, kg", 0.1, step=0.001)
        self._friction = gui.add_number("Friction", 0.6, step=0.01)
        self._button(
            "Set name, mass and friction",
            lambda: acts.set_facts(self._name.value, self._mass.value, self._friction.value),
        )
        self._buttons(
            "Shape", {shape.capitalize(): partial(acts.reshape, shape) for shape in ("box", "cylinder", "bowl")}
        )
        self._buttons("Asset", {"As seen": partial(acts.choose_asset, AS_SEEN), "Best ten": acts.rank_assets})
        ranked = gui.add_html("", visible=False)
        self._asset = gui.add_dropdown("Best ten", ("-",), visible=False)
        take = self._button("Take this asset", self._take_asset)
        self._ranked = ranked, self._asset, take

    def _take_asset(self) -> None:
        line = self._asset.value
        if line not in self._assets:
            raise GrsError(f"{line!r} is not in the list of assets", 'press "Best ten" again')
        self._acts.choose_asset(self._assets[line])

    def _button(self, label: str, work: Work, **options: Any) -> Any:
        button = self._gui.add_button(label, **options)
        button.on_click(self._queued(work))
        return button

    def _queued(self, work: Work) -> Callable[[Any], Coroutine[Any, Any, None]]:
        async def enqueue(_: Any) -> None:  # on the server's event loop, hence in the order of the events
            self._put(work)

        return enqueue

    def _buttons(self, label: str, work: Mapping[str, Work]) -> None:
        group = self._gui.add_button_group(label, tuple(work))

        async def enqueue(event: Any) -> None:
            self._put(work[event.target.value])  # which the next press replaces

        group.on_click(enqueue)

    def say(self, *lines: str, failed: bool = False) -> None:
        """Show lines for the person; ``failed`` in red."""
        color = "#c92a2a" if failed else "inherit"
        self._status.content = f'<div role="status" style="color:{color}">{escape_lines(*lines, size=0.9)}</div>'

    def show(self, shown: Shown) -> None:
        """Show a state; text that a person is typing is kept, and the best ten disappear."""
        item = shown.selected
        self._details.visible = item is not None
        for handle in self._ranked:
            handle.visible = False
        described = {
            each.name: describe_object(each, shown.scene, shown.library, shown.rgb, shown.masks[each.name])
            for each in shown.scene.objects
        }
        if item is not None:
            self._facts.content = described[item.name]
            facts = (item.name, *physics_of(item, shown.library))
            for field, value in zip((self._name, self._mass, self._friction), facts, strict=True):
                if self._filled.get(field.label) != (item.id, value):
                    self._filled[field.label], field.value = (item.id, value), value
        self._fill_rows(shown, described)
        self._take_mask.visible, self._cancel.visible = shown.offers, shown.offers or shown.busy
        lines = [f"{number}. {line}" for number, line in enumerate(shown.scene.edits, 1)]
        self._edits.content = escape_lines("Edits:", *(lines or ["none"]))

    def show_planes(self, frame: TableFrame) -> None:
        """List the planes by their heights over the table."""
        table = next((plane.height for plane in frame.planes if plane.taken), 0.0)
        lines = [
            f"plane {plane.number}: "
            + ("the table" if plane.taken else f"{100 * (plane.height - table):+.1f} cm")
            + f", {plane.share:.0%} of the photo"
            for plane in frame.planes
        ] or ["no planes were searched"]
        self._planes.content = escape_lines(f"Robot frame: {frame.origin.replace('_', ' ')}. {frame.note}", *lines)

    def show_assets(self, names: Sequence[str], library: Library) -> None:
        """Offer assets, the best first."""
        ranked, _, _ = self._ranked
        ranked.content = draw_assets(names, library)
        self._assets = {f"{number} {name}": name for number, name in enumerate(names, 1)}
        self._asset.options = tuple(self._assets) or ("-",)
        self._asset.value = self._asset.options[0]
        for handle in (*self._ranked, self._cancel):
            handle.visible = bool(names)

    def _fill_rows(self, shown: Shown, described: Mapping[str, str]) -> None:
        objects = shown.scene.objects
        while len(self._rows) > len(objects):
            for handle in self._rows.pop():
                handle.remove()
        while len(self._rows) < len(objects):
            with self._list:
                button, facts = self._gui.add_button("", color="gray"), self._gui.add_html("")
            button.on_click(self._queued(partial(self._select_row, len(self._rows))))
            self._rows.append((button, facts))
        self._names = [item.name for item in objects]
        for item, (button, facts) in zip(objects, self._rows, strict=True):
            values = {"label": f"{item.id}  {item.name}", "color": "yellow" if item is shown.selected else "gray"}
            for handle, changed in ((button, values), (facts, {"content": described[item.name]})):
                for key, value in changed.items():
                    if getattr(handle, key) != value:  # else the browser draws it anew
                        setattr(handle, key, value)

    def _select_row(self, number: int) -> None:
        if number < len(self._names):
            self._acts.select(self._names[number])
