"""A person's presses on the page become edits of the scene, in their order."""

import http.client
import json
import math
import shutil
from collections.abc import Callable, Generator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest

from grs_agents.base.geometry.transforms import matrix_to_quaternion
from grs_agents.perception.edits import (
    Add,
    Delete,
    Mark,
    Merge,
    Move,
    PlaceRobot,
    Rename,
    SceneEdits,
    SetMass,
    Split,
    read_edits,
)
from grs_agents.perception.types import LevelPlane, Mask
from grs_agents.runs.scene_editor import SceneEditor
from grs_agents.views.edit_page.editor import EndedRun
from grs_agents.views.edit_page.guard import VISER, GuardedServer
from grs_agents.views.edit_page.page import REPORT, EditPage
from grs_agents.views.edit_page.panel import Panel
from grs_agents.views.edit_page.photo_plane import PhotoPlane, Viewer, escape_lines
from grs_agents.views.edit_page.scene_view import SceneView, pose_at_rest
from tests.needs import needs
from tests.scene_editing import open_editor

pytestmark = needs("viser")
FINISH: tuple[str, Any] = ("Finish: save and close", True)


@pytest.fixture(scope="module")
def editor(tmp_path_factory: pytest.TempPathFactory, known_scene: Path) -> Generator[SceneEditor]:
    """A scene of three objects, opened once."""
    with open_editor(known_scene, tmp_path_factory.mktemp("edited") / "scene") as opened:
        yield opened


class Served:
    """A page whose browser is a websocket client."""

    def __init__(self, editor: SceneEditor, server: GuardedServer, runs: list[str]) -> None:
        def go_on(show: Callable[[str], None]) -> EndedRun:
            show("<step>")
            runs.append("run")
            return EndedRun(editor.folder, "accepted", "<reason>", b"report")

        self.editor, self.server = editor, server
        self.page = EditPage(editor, server, go_on)

    def handles(self) -> list[Any]:
        return list(vars(self.server.viser.gui)["_gui_input_handle_from_uuid"].values())

    def shown(self) -> str:
        """All texts of the panel."""
        texts = [*vars(self.panel).values(), *(facts for _, facts in vars(self.panel)["_rows"])]
        return " ".join(str(getattr(handle, "content", "")) for handle in texts)

    @property
    def panel(self) -> Panel:
        return vars(self.page)["_panel"]

    @property
    def view(self) -> SceneView:
        return vars(self.page)["_view"]

    @property
    def plane(self) -> PhotoPlane:
        return self.view.plane

    def do(self, *acts: tuple[str, Any]) -> None:
        """Set fields, press buttons (label, True) and buttons of groups (group, button), then finish.

        Of the photo, ``("click", pixel)`` clicks it, and ``("rect-select", rectangle)`` drags a rectangle; in 3D
        ``("ray", (origin, direction))`` clicks, and ``("/gizmo", (x, y, yaw))`` drags the selected object.
        """
        messages = import_module("viser._messages")
        parts = urlsplit(self.server.address)
        connection = http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=20)
        connection.request("GET", f"/?{parts.query}")
        cookie = connection.getresponse().headers["Set-Cookie"].partition(";")[0]
        connection.close()
        with import_module("websockets.sync.client").connect(
            f"ws://127.0.0.1:{self.server.port}/",
            origin=f"http://127.0.0.1:{self.server.port}",
            additional_headers={"Cookie": cookie},
            subprotocols=[f"viser-v{VISER}"],
            max_size=None,
        ) as client:
            send = import_module("msgspec").msgpack.encode
            pose, field = self.plane.pose, self.plane.find_field_of_view(1.6)
            turn = matrix_to_quaternion(pose[:3, :3])
            camera = messages.ViewerCameraMessage(
                wxyz=(turn[3], *turn[:3]),
                position=tuple(pose[:3, 3]),
                fov=field,
                near=0.01,
                far=100.0,
                image_height=900,
                image_width=1440,
                look_at=tuple(pose[:3, 3] + pose[:3, 2]),
                up_direction=(0.0, 0.0, 1.0),
            )
            client.send(send(camera.as_serializable_dict()))
            for label, value in (*acts, FINISH):
                if label in ("click", "rect-select"):
                    points = (value[:2], value[2:]) if label == "rect-select" else (value,)
                    screen = tuple(screen_point(self.plane, 1.6, point) for point in points)
                    message = messages.ScenePointerMessage(label, (0.0,) * 3, (0.0, 0.0, 1.0), screen, None)
                elif label in ("/gizmo", "/base"):
                    client.send(send(messages.TransformControlsDragStartMessage(label).as_serializable_dict()))
                    yaw = value[2] / 2
                    turn = (math.cos(yaw), 0.0, 0.0, math.sin(yaw))
                    message = messages.TransformControlsUpdateMessage(label, turn, (*value[:2], 0.0))
                elif label == "ray":
                    message = messages.ScenePointerMessage("click", *value, ((0.5, 0.5),), None)
                else:
                    message = messages.GuiUpdateMessage(vars(self.handle(label))["_impl"].uuid, {"value": value})
                client.send(send(message.as_serializable_dict()))
                if label in ("/gizmo", "/base"):
                    client.send(send(messages.TransformControlsDragEndMessage(label).as_serializable_dict()))
            self.page.serve()
            self.cameras = [
                (np.array(viewer.camera.position), np.array(viewer.camera.look_at))
                for viewer in self.server.viser.get_clients().values()
            ]

    def handle(self, label: str) -> Any:
        [handle] = [handle for handle in self.handles() if getattr(handle, "label", None) == label]
        return handle

    def said(self) -> str:
        return vars(self.panel)["_status"].content

    def written(self) -> SceneEdits:
        return read_edits(self.editor.folder / "edits.json")


@pytest.fixture
def served(editor: SceneEditor) -> Generator[Served]:
    server = GuardedServer(0)
    yield Served(editor, server, [])
    server.stop()
    while editor.edits:
        editor.undo()


def screen_point(plane: PhotoPlane, aspect: float, pixel: tuple[float, float]) -> tuple[float, float]:
    """The point of the screen (0..1 right and down) of a pixel, in the view from the photo's camera."""
    camera, half = plane.camera, math.tan(plane.find_field_of_view(aspect) / 2)
    x = (pixel[0] - camera.cx) / camera.fx / half / aspect
    return (1 + x) / 2, (1 + (pixel[1] - camera.cy) / camera.fy / half) / 2


def box_around(mask: Mask, margin: int = 6) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of a rectangle as a person draws it."""
    rows, columns = np.nonzero(mask)
    low, high = (columns.min() - margin, rows.min() - margin), (columns.max() + margin, rows.max() + margin)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def kinds(edits: Sequence[Any]) -> list[type]:
    return [type(edit) for edit in edits]


def test_presses_are_edits_in_their_order_and_kept(served: Served) -> None:
    rows = {item.name: (f"{number}  {item.name}", True) for number, item in enumerate(served.editor.scene.objects, 1)}
    served.do(rows["spaghetti_1"])  # fills the fields
    served.do(
        ("Name", "flat <b>noodles</b>"),
        ("Mass, kg", 0.5),
        ("Set name, mass and friction", True),
        ("Object", "Merge"),
        rows["mayo_1"],
        ("Edits", "Undo"),
        ("Edits", "Redo"),
        ("This is", "Scenery"),
        rows["bowl_1"],
        ("Edits", "Undo"),
        ("Object", "Delete"),
    )
    assert kinds(served.written().edits) == [SetMass, Rename, Merge, Delete]
    assert Mark not in kinds(served.editor.edits)
    assert "renamed to flat_b_noodles_b" in served.shown() and "<b>" not in served.shown()


def test_a_click_in_3d_selects_the_first_object_on_its_ray(served: Served) -> None:
    bowl, bottle = (item for item in served.editor.scene.objects if item.name in ("bowl_1", "mayo_1"))
    down = (0.0, 0.0, -1.0)
    for item in (bowl, bottle):
        x, y, _ = (item.settled or (item.position,))[0]
        served.do(("View", "3D"), ("ray", ((x, y, 1.0), down)))
        assert f"{item.name} is selected" in served.said()
    served.do(("ray", ((0.0, 1.5, 1.0), down)))
    assert "mayo_1 is selected" in served.said()
    # objects that react to the pointer would take it from parts of the gizmo that lie in them
    nodes = [node for _, node in vars(served.view)["_nodes"].values()]
    assert len(nodes) == 3 and not any(vars(node)["_impl"].click_cb for node in nodes)


def test_rectangles_in_the_photo_split_and_add_and_a_refused_act_leaves_its_mode(served: Served) -> None:
    bowl, bottle = (served.editor.masks[name] for name in ("bowl_1", "mayo_1"))
    served.do(("click", served.editor.place_of("bowl_1")), ("Object", "Split"))
    served.do(("rect-select", box_around(bowl)))
    served.do(("Take this mask", True))
    assert "holds all of bowl_1" in served.said() and served.editor.edits == ()
    assert not served.handle("Cancel").visible
    served.do(("Object", "Split"))
    left, top, right, bottom = box_around(bowl)
    served.do(("rect-select", (left, top, (left + right) // 2, bottom)))
    served.do(("Take this mask", True), ("Add an object: drag a rectangle", True))
    served.do(("rect-select", box_around(bottle)))
    served.do(("Take this mask", True))
    split, add = served.written().edits
    assert isinstance(split, Split) and isinstance(add, Add)
    assert abs(split.rectangle.right - (left + right) // 2) <= 1
    assert abs(add.rectangle.left - box_around(bottle)[0]) <= 1


def test_an_object_that_loses_a_part_stays_selected(served: Served) -> None:
    left, top, right, bottom = box_around(served.editor.masks["bowl_1"])
    served.do(("click", served.editor.place_of("bowl_1")), ("Mask", "Exclude"))
    served.do(("rect-select", (left, top, (left + right) // 2, bottom)))
    served.do(("Take this mask", True))
    rest = served.editor.scene.objects[-1].name
    assert served.editor.scene.edits == (f"bowl_1 loses a part and is now {rest}",)
    assert served.handle("Name").value == rest


def test_an_act_keeps_the_text_that_a_person_is_typing(served: Served) -> None:
    row = ("2  spaghetti_1", True)
    served.do(row)
    served.do(("Name", "noodles"), ("Shape", "Box"), ("Edits", "Undo"))
    assert served.handle("Name").value == "noodles"
    served.do(("1  bowl_1", True), row)
    assert served.handle("Name").value == "spaghetti_1"


def test_a_refused_act_is_said_and_changes_nothing(served: Served) -> None:
    row = (f"1  {served.editor.scene.objects[0].name}", True)
    served.do(("Object", "Delete"), row)
    served.do(("Mass, kg", 1e9), ("Set name, mass and friction", True))
    assert served.editor.edits == ()


def test_messages_and_rows_name_objects_by_name_and_number_of_the_scene(served: Served) -> None:
    bowl, spaghetti, _ = served.editor.scene.objects
    served.do((f"{bowl.id}  bowl_1", True), ("Object", "Delete"))
    assert served.said().endswith("bowl_1 is no object</div></div>") and "1. bowl_1 is no object" in served.shown()
    served.do(("Edits", "Undo"))
    assert "Undone: bowl_1 is no object" in served.said()
    served.do((f"{spaghetti.id}  spaghetti_1", True), ("Object", "Delete"), ("Edits", "Undo"))
    assert f"{spaghetti.id}  spaghetti_1" in [getattr(handle, "label", "") for handle in served.handles()]


def test_the_best_ten_can_be_left_and_a_stale_choice_is_refused(served: Served) -> None:
    served.do(("1  bowl_1", True), ("Asset", "Best ten"))
    take = served.handle("Take this asset")
    assert take.visible and served.handle("Cancel").visible
    served.do(("Cancel", True))
    assert not take.visible and not served.handle("Cancel").visible
    served.do(("Best ten", "an asset ranked before"), ("Take this asset", True))
    assert "is not in the list of assets" in served.said() and served.editor.edits == ()


def test_planes_are_listed_by_their_height_over_the_table(served: Served) -> None:
    frame = served.editor.scene.frame
    planes = (
        LevelPlane(number=1, height=0.07, share=0.4, taken=True),
        LevelPlane(number=2, height=0.52, share=0.2, taken=False),
    )
    served.panel.show_planes(frame.model_copy(update={"planes": planes}))
    assert "plane 1: the table, 40%" in served.shown() and "plane 2: +45.0 cm, 20%" in served.shown()


def test_a_drag_of_the_gizmo_moves_the_object_and_back_if_it_would_stand_in_another(served: Served) -> None:
    box, bottle = (item for item in served.editor.scene.objects if item.name in ("spaghetti_1", "mayo_1"))
    here, there = (pose_at_rest(item)[0] for item in (box, bottle))
    row = (f"{box.id}  spaghetti_1", True)
    served.do(row, ("View", "3D"), ("/gizmo", (here[0] + 0.02, here[1] - 0.03, 0.4)))
    [move] = served.editor.edits
    assert isinstance(move, Move) and move.yaw == pytest.approx(0.4)
    assert np.allclose(np.subtract(move.position, box.position[:2]), (0.02, -0.03))
    assert "spaghetti_1 is moved" in served.said()
    place = served.editor.place_of("spaghetti_1")
    beside = ((there[0] + step, there[1]) for step in np.arange(0.01, 0.3, 0.01))
    half_on = next(at for at in beside if served.editor.overlaps(place, at, 0.0) == ("mayo_1",))
    served.do(("/gizmo", (*half_on, 0.0)))
    assert "would stand in or half on mayo_1" in served.said() and len(served.editor.edits) == 1
    moved = next(item for item in served.editor.scene.objects if item.name == "spaghetti_1")
    served.do(("/gizmo", (*pose_at_rest(moved)[0][:2], 0.0)))
    assert len(served.editor.edits) == 1  # it was let go where it stood


def test_the_photo_stays_in_view_when_its_camera_has_another_pose(known_scene: Path, tmp_path: Path) -> None:
    shutil.copytree(known_scene, tmp_path / "known")
    description = json.loads((known_scene / "scene.json").read_text())
    description["frame"]["origin"] = "table_plane"
    (tmp_path / "known/scene.json").write_text(json.dumps(description))
    with open_editor(tmp_path / "known", tmp_path / "edited") as editor:
        editor.apply(PlaceRobot(position=(0.1, 0.05), yaw=0.2))
        server = GuardedServer(0)
        served = Served(editor, server, [])
        moved = served.plane.pose
        served.do(("Edits", "Undo"))
        server.stop()
    pose = served.plane.pose
    assert np.linalg.norm(pose[:3, 3] - moved[:3, 3]) > 0.05
    [(position, aim)] = served.cameras
    assert np.allclose(position, pose[:3, 3]) and np.allclose(aim, pose[:3, 3] + pose[:3, 2])


def test_a_run_goes_on_from_the_saved_scene(served: Served) -> None:
    served.do(("Go on", True))
    assert served.server.documents[REPORT] == b"report"
    steps = served.panel.run_steps.content
    assert "&lt;step&gt;" in steps and "accepted: &lt;reason&gt;" in steps and f'href="{REPORT}"' in steps


def test_a_point_of_the_screen_is_the_pixel_on_its_ray(editor: SceneEditor) -> None:
    pose = np.asarray(editor.scene.frame.T_robot_cam)
    plane = PhotoPlane(editor.photo.camera.intrinsics, pose)
    camera = plane.camera
    for aspect in (0.6, 1.0, 2.3):
        viewer = Viewer(pose[:3, :3], pose[:3, 3], plane.find_field_of_view(aspect), aspect)
        for pixel in ((0, 0), (camera.width - 1, camera.height - 1), (100, 31)):
            screen = screen_point(plane, aspect, pixel)
            assert 0 <= screen[0] <= 1 and 0 <= screen[1] <= 1  # the whole photo is on the screen
            assert plane.find_pixel(screen, viewer) == pytest.approx(pixel, abs=1e-6)
    behind = Viewer(pose[:3, :3], pose[:3, 3] + 9 * pose[:3, 2], 1.0, 1.0)
    assert plane.find_pixel((0.5, 0.5), behind) is None


def test_foreign_text_is_escaped() -> None:
    assert "<script" not in escape_lines("<script>alert(1)</script>", '"><img src=x onerror=alert(1)>')
    assert "<img" not in escape_lines("<img>")
