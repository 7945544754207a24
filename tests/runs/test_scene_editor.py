"""A person corrects a scene act by act, and the edits replayed without a page give the same scene."""

import json
import shutil
from collections.abc import Generator
from pathlib import Path

import cv2
import numpy as np
import pytest

from grs_agents.base.config.load import load_config
from grs_agents.base.errors import GrsError, InputError
from grs_agents.cli.edit import order_run
from grs_agents.graph.editing import BEFORE, open_edited_scene
from grs_agents.graph.scene_prompt import scene_for_prompt
from grs_agents.library.library import Library
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
    PlaceRobot,
    Rectangle,
    Rename,
    SetFriction,
    SetMass,
    Split,
)
from grs_agents.perception.types import Mask, SceneDescription, SceneObject, read_scene_description
from grs_agents.runs.record import read_record
from grs_agents.runs.run_opening import RunOrder
from grs_agents.runs.scene_editor import SceneEditor
from tests.cli.command import grs
from tests.scene_editing import open_editor


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory, sample_run: Path) -> Generator[SceneEditor]:
    """The sample scene, opened once; each test leaves it as it was."""
    with open_editor(sample_run, tmp_path_factory.mktemp("edited") / "scene") as editor:
        yield editor


@pytest.fixture
def editor(opened: SceneEditor) -> Generator[SceneEditor]:
    """The editor without edits."""
    yield opened
    while opened.edits:
        opened.undo()
    opened.undone = ()


def named(scene: SceneDescription) -> dict[str, SceneObject]:
    """The objects by name."""
    return {item.name: item for item in scene.objects}


def rectangle_around(mask: Mask, margin: int = 8) -> Rectangle:
    """A rectangle as a person draws it around an object."""
    rows, columns = np.nonzero(mask)
    return Rectangle(
        left=int(columns.min()) - margin,
        top=int(rows.min()) - margin,
        right=int(columns.max()) + margin,
        bottom=int(rows.max()) + margin,
    )


def test_facts_are_known_to_authors_and_to_the_simulation(editor: SceneEditor) -> None:
    milk = editor.place_of("milk_1")
    for edit in (
        Rename(place=milk, name="oat milk"),
        SetMass(place=milk, mass=1.25),
        SetFriction(place=milk, friction=0.9),
    ):
        editor.apply(edit)
    item = named(editor.scene)["oat_milk_1"]
    asset = editor.library.asset(item.asset)
    assert (asset.mass, asset.friction) == (1.25, 0.9)
    assert editor.library.load_object_model(item.asset).mass == pytest.approx(1.25)
    assert asset.physics is not None and asset.physics.mass.provenance == "measured"
    (row,) = (row for row in scene_for_prompt(editor.scene, editor.library)["objects"] if row["name"] == "oat_milk_1")
    assert (row["mass"], row["friction"], row["description"]) == (1.25, 0.9, "oat milk")
    assert editor.scene.edits[1] == "oat_milk_1 weighs 1.25 kg"


def test_segments_are_added_merged_split_and_removed(editor: SceneEditor) -> None:
    before = editor.masks
    editor.apply(Merge(places=(editor.place_of("mustard_1"), editor.place_of("raisins_1"))))
    (whole,) = set(editor.masks) - set(before)
    assert np.array_equal(editor.masks[whole], before["mustard_1"] | before["raisins_1"])
    right = int(np.nonzero(before["raisins_1"])[1].min()) - 1
    rows, columns = before["milk_1"].shape
    editor.apply(
        Split(place=editor.place_of(whole), rectangle=Rectangle(left=right, top=0, right=columns, bottom=rows))
    )
    assert len(editor.scene.objects) == 11
    editor.apply(Delete(place=editor.place_of("tuna_1")))
    editor.apply(Mark(place=editor.place_of("cookies_1"), kind="scenery"))
    assert {"tuna_1", "cookies_1"}.isdisjoint(named(editor.scene))
    reasons = [region.reason for region in editor.scene.coverage.unowned] if editor.scene.coverage else []
    assert any("deleted by a person" in reason for reason in reasons)
    assert not any("scenery" in reason for reason in reasons)  # it is no raised pixel any more
    rectangle = rectangle_around(before["tuna_1"])
    seen = editor.preview_part(Add(rectangle=rectangle))
    assert seen is not None and (seen & before["tuna_1"]).sum() > 0.8 * (seen | before["tuna_1"]).sum()
    editor.apply(Add(rectangle=rectangle))
    assert np.array_equal(editor.masks[editor.scene.objects[-1].name], seen)
    assert editor.scene.edits[-1] == f"{editor.scene.objects[-1].name} is added"


def test_an_added_object_takes_the_pixels_of_others_and_says_so(editor: SceneEditor) -> None:
    before = editor.masks
    editor.apply(Merge(places=(editor.place_of("mustard_1"), editor.place_of("raisins_1"))))
    (whole,) = set(editor.masks) - set(before)
    editor.apply(Add(rectangle=rectangle_around(before["mustard_1"])))
    added, line = editor.scene.objects[-1].name, editor.scene.edits[-1]
    share = round(100 * float((before["mustard_1"]).sum() / (before["mustard_1"] | before["raisins_1"]).sum()))
    assert f"{added} is added; it takes" in line and f" % of {whole}, which is now " in line
    assert abs(int(line.split("it takes ")[1].split(" %")[0]) - share) <= 2
    assert not any((editor.masks[added] & mask).any() for name, mask in editor.masks.items() if name != added)
    rest = editor.masks[line.rsplit(" is now ")[1].split(";")[0]]
    assert (rest & before["raisins_1"]).sum() > 0.9 * (rest | before["raisins_1"]).sum()
    editor.apply(Add(rectangle=rectangle_around(before["mustard_1"])))
    assert f" % of {added}, which it replaces" in editor.scene.edits[-1]


def test_a_larger_rectangle_leaves_an_added_object_alone(editor: SceneEditor) -> None:
    before = editor.masks
    around = Add(rectangle=rectangle_around(before["mustard_1"] | before["raisins_1"]))
    both = editor.preview_part(around)
    assert both is not None and (both & before["mustard_1"]).sum() > 0.9 * before["mustard_1"].sum()
    editor.apply(Add(rectangle=rectangle_around(before["mustard_1"])))
    added = editor.masks[editor.scene.objects[-1].name]
    seen = editor.preview_part(around)
    assert seen is not None and not (seen & added).any()
    assert (seen & before["raisins_1"]).sum() > 0.9 * before["raisins_1"].sum()


def test_a_rectangle_gives_an_object_a_part_and_takes_it_away(editor: SceneEditor) -> None:
    before = editor.masks
    editor.apply(Merge(places=(editor.place_of("mustard_1"), editor.place_of("raisins_1"))))
    (whole,) = set(editor.masks) - set(before)
    rectangle = rectangle_around(before["raisins_1"])
    part = CorrectMask(place=editor.place_of(whole), rectangle=rectangle, kind="exclude")
    seen = editor.preview_part(part)
    assert seen is not None and (seen & before["raisins_1"]).sum() > 0.9 * (seen | before["raisins_1"]).sum()
    editor.apply(part)
    left = editor.scene.objects[-1].name
    assert editor.scene.edits[-1] == f"{whole} loses a part and is now {left}"
    assert np.array_equal(editor.masks[left], (before["mustard_1"] | before["raisins_1"]) & ~seen)
    editor.apply(CorrectMask(place=editor.place_of(left), rectangle=rectangle, kind="include"))
    again, both = editor.masks[editor.scene.objects[-1].name], before["mustard_1"] | before["raisins_1"]
    assert (again & both).sum() > 0.95 * (again | both).sum()
    corner = Rectangle(left=0, top=0, right=9, bottom=9)
    with pytest.raises(InputError, match="holds nothing of"):
        editor.apply(CorrectMask(place=editor.place_of("milk_1"), rectangle=corner, kind="exclude"))
    around = rectangle_around(before["milk_1"], 20)
    with pytest.raises(InputError, match="holds all of milk_1"):
        editor.apply(Split(place=editor.place_of("milk_1"), rectangle=around))


def test_an_object_gets_another_asset_or_shape_at_its_place(editor: SceneEditor) -> None:
    tuna = editor.place_of("tuna_1")
    assert len(editor.ranked_assets(tuna)) == 10 and "HOPE/Tuna.urdf" in editor.ranked_assets(tuna)
    editor.apply(ChooseAsset(place=tuna, asset="HOPE/TomatoSauce.urdf"))
    assert named(editor.scene)["tuna_1"].matched
    editor.apply(ChooseAsset(place=tuna, asset="as_seen"))
    assert editor.library.asset(named(editor.scene)["tuna_1"].asset).category == "proxy"
    editor.apply(ChooseShape(place=tuna, shape="bowl", size=(0.1, 0.1, 0.05)))
    asset = editor.library.asset(named(editor.scene)["tuna_1"].asset)
    assert asset.hollow and asset.size == pytest.approx((0.1, 0.1, 0.05), abs=0.002)
    editor.apply(Mark(place=editor.place_of("blue_block_1"), kind="container"))
    assert editor.library.asset(named(editor.scene)["blue_block_1"].asset).hollow
    with pytest.raises(GrsError, match=r"did you mean HOPE/Tuna\.urdf"):
        editor.apply(ChooseAsset(place=tuna, asset="HOPE/Tunna.urdf"))
    first = named(editor.scene)["tuna_1"].position
    assert np.hypot(first[0] - 0.62, first[1] + 0.24) < 0.02


def test_a_moved_object_stands_on_what_is_below_and_overlaps_are_named(editor: SceneEditor) -> None:
    block, red = editor.place_of("blue_block_1"), named(editor.scene)["red_block_1"]
    editor.apply(Move(place=block, position=(red.position[0], red.position[1]), yaw=0.3))
    settled = named(editor.scene)["blue_block_1"].settled
    assert settled is not None and settled[0][2] == pytest.approx(0.06, abs=0.004)
    assert any(it.kind == "on" and it.reference == "red_block_1" for it in editor.scene.relations)
    editor.apply(Move(place=editor.place_of("red_block_1"), position=(0.45, -0.4)))
    carried = named(editor.scene)["blue_block_1"].settled
    assert carried is not None and np.allclose(carried[0], (0.45, -0.4, 0.06), atol=0.01)
    assert editor.overlaps(block, (0.62, -0.28), 0.0) == ("tuna_1",)
    scene = editor.scene
    with pytest.raises(InputError, match="blue_block_1 would stand in or half on tuna_1"):
        editor.apply(Move(place=block, position=(0.62, -0.28)))
    assert editor.scene is scene and len(editor.edits) == 2


def test_what_stood_on_a_deleted_object_comes_down(editor: SceneEditor) -> None:
    block, tuna = editor.place_of("blue_block_1"), named(editor.scene)["tuna_1"]
    editor.apply(Move(place=block, position=(tuna.position[0], tuna.position[1])))
    editor.apply(Delete(place=editor.place_of("tuna_1")))
    item = named(editor.scene)["blue_block_1"]
    assert item.settled is not None and item.settled[0][2] == pytest.approx(0.02, abs=0.004)
    assert not item.held and item.drift is not None and item.drift < 0.005


@pytest.mark.parametrize(
    ("edit", "problem"),
    [
        (Delete(place=(1, 1)), "no object at the pixel 1, 1"),
        (Delete(place=(9999, 1)), "no object at the pixel 9999, 1"),
        (Add(rectangle=Rectangle(left=0, top=0, right=9000, bottom=9)), "leaves the photo of 640 x 480"),
        (PlaceRobot(position=(0.1, 0.0)), "the photo is calibrated"),
        (ChooseTable(point=(1, 1)), "on no level plane|has no depth"),
    ],
)
def test_an_edit_that_does_not_fit_leaves_the_scene(editor: SceneEditor, edit: Edit, problem: str) -> None:
    scene = editor.scene
    with pytest.raises(GrsError, match=problem):
        editor.apply(edit)
    assert editor.scene is scene and editor.edits == ()


def test_undo_and_redo_give_the_scenes_before_and_after(editor: SceneEditor) -> None:
    first = editor.scene
    editor.apply(Delete(place=editor.place_of("tuna_1")))
    second = editor.scene
    editor.undo()
    assert editor.scene is first
    editor.redo()
    assert editor.scene is second and editor.undone == ()  # kept, not made again
    editor.undo()
    with pytest.raises(InputError, match="no edit to undo"):
        editor.undo()
    editor.apply(Delete(place=editor.place_of("bowl_1")))
    with pytest.raises(InputError, match="no edit to redo"):
        editor.redo()


def test_a_scene_with_an_object_without_pixels_is_refused(editor: SceneEditor, tmp_path: Path) -> None:
    folder = shutil.copytree(editor.folder, tmp_path / "foreign")
    scene = read_scene_description(folder / BEFORE)
    cv2.imwrite(str(folder / scene.objects[0].mask), np.zeros(editor.photo.depth.shape, np.uint8))
    with pytest.raises(InputError, match=f"the mask {scene.objects[0].mask} is empty"):
        open_edited_scene(scene, editor.photo, folder)


def test_a_scene_that_is_saved_after_undo_has_the_picture_of_its_coverage(editor: SceneEditor) -> None:
    assert editor.scene.coverage is not None
    picture = editor.folder / editor.scene.coverage.picture
    before = picture.read_bytes()
    editor.apply(Delete(place=editor.place_of("tuna_1")))
    editor.save()
    assert picture.read_bytes() != before
    editor.undo()
    editor.save()
    assert picture.read_bytes() == before


def replay(folder: Path, *arguments: str) -> None:
    """Run ``grs`` with a sandbox that others use too."""
    done = grs(*arguments, folder=folder)
    assert done.returncode in (0, 1), done.stderr


def files_of(folder: Path, library: Library | None = None) -> dict[str, bytes]:
    """The description and the assets of its own of a scene."""
    scene = json.loads((folder / "scene.json").read_text())
    own = [name for item in scene["objects"] if (folder / "assets" / (name := item["asset"])).is_file()]
    assert own
    names = ["scene.json", "edits.json", "scene/before_edits.json", *(f"assets/{name}" for name in own)]
    return {name: (folder / name).read_bytes() for name in names}


def test_edits_replayed_give_the_same_scene_byte_for_byte(small_scene: Path, known_scene: Path, tmp_path: Path) -> None:
    with open_editor(known_scene, tmp_path / "edited") as editor:
        bowl, box, bottle = (editor.place_of(item.name) for item in editor.scene.objects)
        right = Rectangle(left=bowl[0], top=0, right=320, bottom=240)
        for edit in (
            Rename(place=box, name="noodles"),
            Split(place=bowl, rectangle=right),
            SetMass(place=box, mass=0.8),
            Delete(place=bottle),
            Move(place=box, position=(0.45, -0.3), yaw=0.5),
        ):
            editor.apply(edit)
        edits, lines = str(editor.save()), editor.scene.edits
        assert read_record(editor.folder).counts["objects"] == len(editor.scene.objects)
        files = files_of(editor.folder, editor.library)
    replay(tmp_path, "scene", str(small_scene), "--edits", edits, "--out", "again")
    assert files_of(tmp_path / "again") == files
    record = read_record(tmp_path / "again")
    assert record.edits == lines and len(record.edits) == 5
    events = (tmp_path / "again/events.jsonl").read_text()
    assert all(f"corrected by a person: {line}" in events for line in record.edits)
    # a corrected scene is taken as it is, or corrected otherwise
    replay(tmp_path, "scene", "again", "--out", "copied")
    assert files_of(tmp_path / "copied") == files and read_record(tmp_path / "copied").edits == record.edits
    replay(tmp_path, "scene", "copied", "--edits", edits, "--out", "replayed")
    assert files_of(tmp_path / "replayed") == files
    (tmp_path / "wrong.json").write_text('{"version": 1, "edits": [\n{"act": "delete", "place": [1, 1]}\n]}')
    done = grs("scene", "again", "--edits", "wrong.json", "--out", "wrong", folder=tmp_path)
    assert done.returncode == 2 and "edit 1 (delete): there is no object at the pixel 1, 1" in done.stderr


def test_a_graph_with_review_asks_for_the_edits(known_scene: Path, tmp_path: Path, brief_films: None) -> None:
    with open_editor(known_scene, tmp_path / "scene") as editor:
        name = editor.scene.objects[0].name
        editor.apply(Rename(place=editor.place_of(name), name="oat milk"))
        editor.save()
    settings = ("--set", "graph=grs_review", "--set", "audit.seeds=1")
    done = grs("run", str(known_scene), *settings, "--out", "run", folder=tmp_path)
    assert done.returncode == 4 and read_record(tmp_path / "run").status == "waiting"
    again = grs("approve", "run", "--reply", "missing.json", folder=tmp_path)
    assert again.returncode == 4 and "missing.json" in str(read_record(tmp_path / "run").question)
    config = load_config(None, overrides={})
    order = order_run(tmp_path / "run", tmp_path / "scene", config)  # of the page
    assert order.resume and (order.out, order.reply) == (tmp_path / "run", str(tmp_path / "scene/edits.json"))
    assert order_run(tmp_path / "scene", tmp_path / "scene", config) == RunOrder("run", tmp_path / "scene", config)
    done = grs("approve", "run", "--reply", "scene/edits.json", folder=tmp_path)
    assert done.returncode in (0, 1), done.stderr
    record = read_record(tmp_path / "run")
    assert record.edits == (f"{name} is renamed to oat_milk_1",)
    assert "oat_milk" in (tmp_path / "run/scene.json").read_text()
    assert f"{name} is renamed to oat_milk_1" in grs("show", "run", folder=tmp_path).stdout
    grs("report", "run", folder=tmp_path)
    assert f"<li>{name} is renamed to oat_milk_1</li>" in (tmp_path / "run/report.html").read_text()


def test_a_photo_without_calibration_is_corrected_and_replayed(small_scene: Path, tmp_path: Path) -> None:
    source = Path(shutil.copytree(small_scene, tmp_path / "photo"))
    camera = json.loads((source / "camera.json").read_text())
    (source / "camera.json").write_text(json.dumps({key: camera[key] for key in camera if key != "T_robot_cam"}))
    with open_editor(source, tmp_path / "edited") as editor:
        first, second, third, *_ = (item.name for item in editor.scene.objects)
        before = named(editor.scene)[third].position
        editor.apply(Delete(place=editor.place_of(first)))
        editor.apply(ChooseShape(place=editor.place_of(second), shape="box"))
        editor.save()
        files = files_of(editor.folder, editor.library)
        with pytest.raises(InputError, match="fills the table"):
            editor.apply(ChooseTable(point=(305, 230)))  # the plane of the floor
        editor.save()  # perception has written the folder anew
        assert files_of(editor.folder, editor.library) == files
        editor.apply(PlaceRobot(position=(0.05, 0.02), yaw=0.1))
        shifted = np.array((before[0] - 0.05, before[1] - 0.02))
        turned = np.array([[np.cos(0.1), np.sin(0.1)], [-np.sin(0.1), np.cos(0.1)]]) @ shifted
        assert np.allclose(named(editor.scene)[third].position[:2], turned, atol=0.01)
        editor.save()
    replay(tmp_path, "scene", str(source), "--edits", "edited/edits.json", "--out", "again")
    assert files_of(tmp_path / "again") == files_of(tmp_path / "edited")
