"""``grs verify``: a run that is as it ended holds; one changed byte is found and named, also under new hashes."""

import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grs_agents.base import content
from grs_agents.base.config.recorded import RecordedConfig
from grs_agents.base.config.schema import Config
from grs_agents.base.trace.log import EventLog
from grs_agents.library.library import Library
from grs_agents.library.shapes import Shape
from grs_agents.runs.hashes import write_hashes
from grs_agents.runs.record import RunRecord
from tests.cli.command import Done, grs
from tests.conftest import shorten_films
from tests.views.conftest import Script


@pytest.fixture
def run(accepted_run: Path, tmp_path: Path) -> Path:
    """A copy of an accepted run, to change."""
    return Path(shutil.copytree(accepted_run, tmp_path / "run"))


def change_byte(file: Path, seed: int = 0) -> None:
    """Change one byte of a file to another."""
    random = np.random.default_rng(seed)
    data = bytearray(file.read_bytes())
    place = int(random.integers(len(data)))
    data[place] ^= int(random.integers(1, 256))
    file.write_bytes(data)


def verify(run: Path) -> tuple[Done, dict[str, Any]]:
    """The verb, and what it says as JSON."""
    done = grs("verify", "run", "--json", folder=run.parent)
    return done, json.loads(done.stdout)


def assert_named(run: Path, name: str) -> None:
    """It does not hold, and every line is about the file ``name``."""
    done, found = verify(run)
    assert (done.returncode, found["status"]) == (1, "differs"), done
    assert found["differences"] and all(line.startswith(f"{name}:") for line in found["differences"]), found


def test_a_run_holds_also_with_what_other_verbs_make_of_it(run: Path) -> None:
    for out in ("trace.rrd", "report.html"):
        assert grs("report", "run", "--out", f"run/{out}", folder=run.parent).returncode == 0
    done, found = verify(run)
    assert done.returncode == 0, done.stdout
    assert found == {"status": "holds", "verdict": "accepted", "recomputed": True, "differences": [], "note": ""}


@pytest.mark.parametrize(
    "name",
    [
        "simulation.py",
        "test_simulation.py",
        "task.json",
        "scene.json",
        "audit.json",
        "run.json",
        "events.jsonl",
        "instances/seed_0.json",
        "instances/seed_0.npz",
        "history/simulation_001.py",
        "scene/rgb.png",
        "checkpoint.sqlite",
        "trace.rrd",
    ],
)
def test_one_changed_byte_is_named(run: Path, name: str) -> None:
    change_byte(run / name)
    assert_named(run, name)
    assert f"{name}: it was changed" in grs("verify", "run", folder=run.parent).stdout


@pytest.mark.parametrize("seed", range(20))
def test_a_changed_byte_among_the_hashes_is_found(run: Path, seed: int) -> None:
    change_byte(run / "hashes.json", seed)
    done, found = verify(run)
    assert done.returncode == 1 and found["differences"]


@pytest.fixture(scope="module")
def shown_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A made-up run of half a second, hashed, with each kind of thing that verbs make of a run to be looked at."""
    folder = tmp_path_factory.mktemp("shown") / "run"
    folder.mkdir()
    script = Script(EventLog(folder / "events.jsonl"), folder)
    script.before_fix()
    script.after_fix(seconds=0.5)
    script.log.close()
    config = RecordedConfig.of(Config())
    ended = RunRecord(
        id="shown",
        status="accepted",
        exit_status=0,
        command="scene",
        source="photo",
        graph="scene",
        config=config,
        versions={},
        seeds=(0, 1),
    )
    ended.write(folder)
    write_hashes(folder)
    with pytest.MonkeyPatch.context() as patch:
        shorten_films(patch)
        for out in SHOWN:
            verb = "share" if out.endswith(".zip") else "report"
            assert grs(verb, "run", "--out", f"run/{out}", folder=folder.parent).returncode == 0
    return folder


@pytest.fixture
def shown(shown_once: Path, tmp_path: Path) -> Path:
    """A copy of it to change."""
    return Path(shutil.copytree(shown_once, tmp_path / "run"))


SHOWN = ("report.html", "instances/film.webp", "trace.rrd", "shared.zip")


def test_what_verbs_make_of_a_run_is_hashed_as_it_is_made(shown: Path) -> None:
    assert grs("report", "run", "--out", "run/trace.rrd", folder=shown.parent).returncode == 0  # over the first
    _, found = verify(shown)
    assert found["differences"] == []
    for out in SHOWN:
        change_byte(shown / out)
    (shown / "trace.1.rrd").write_bytes(b"RRF2")
    _, found = verify(shown)
    names = [f"{out}: it was changed" for out in SHOWN] + ["trace.1.rrd: it was added"]
    assert sorted(found["differences"]) == sorted(names)


def test_a_verb_hashes_nothing_but_what_it_makes(shown: Path) -> None:
    (shown / "task.json").write_text("{}")
    change_byte(shown / "report.html")
    assert grs("report", "run", "--out", "run/trace.rrd", folder=shown.parent).returncode == 0
    _, found = verify(shown)
    assert found["differences"] == ["report.html: it was changed", "task.json: it was added"]
    with (shown / "hashes.json").open("a") as hashes:
        hashes.write(" ")
    assert grs("report", "run", "--out", "run/trace.rrd", folder=shown.parent).returncode == 0
    assert "hashes.json: it was written anew" in verify(shown)[1]["differences"]


def test_a_swapped_recording_is_not_replayed(shown: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    viewer = shown.parent / "viewer"
    viewer.write_text('#!/bin/sh\nfor file; do :; done\ncp "$file" seen.rrd\n')
    viewer.chmod(0o755)
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("grs_agents.views.rerun.viewer.find_rerun_program", lambda: viewer)
    (shown / "trace.rrd").write_bytes(b"somebody else's")
    done = grs("replay", "run", folder=shown.parent)
    assert done.returncode == 0, done.stderr
    seen = (shown.parent / "seen.rrd").read_bytes()
    assert seen.startswith(b"RRF2") and len(seen) > 10_000
    assert (shown / "trace.rrd").read_bytes() == b"somebody else's"
    assert verify(shown)[1]["differences"] == ["trace.rrd: it was changed"]


def test_files_that_are_gone_or_new_are_named(run: Path) -> None:
    (run / "scene.json").unlink()
    assert_named(run, "scene.json")
    shutil.copy(run.parent / "run" / "task.json", run / "scene.json")
    (run / "assets").mkdir(exist_ok=True)
    (run / "assets" / "mine.urdf").write_text("<robot/>")
    _, found = verify(run)
    assert found["differences"] == ["assets/mine.urdf: it was added", "scene.json: it was changed"]


def used_mesh(run: Path) -> tuple[str, str]:
    """An asset of the library that an instance uses, and one of its meshes."""
    library = Library()
    for item in json.loads((run / "instances" / "seed_0.json").read_text())["objects"]:
        shapes: tuple[Shape, ...] = library.load_object_model(item["asset"]).visuals if item["asset"] in library else ()
        for shape in shapes:
            if shape.mesh:
                return item["asset"], shape.mesh
    raise AssertionError("no instance uses a mesh")


@pytest.mark.parametrize("what", ["file", "mesh"])
def test_one_changed_byte_of_an_asset_is_named(run: Path, what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asset, mesh = used_mesh(run)
    own = run.parent / "own" / "assets" / "library"
    shutil.copytree(content.content_path("assets", "library"), own)
    monkeypatch.setattr(content, "_overlays", [run.parent / "own"])
    changed = asset if what == "file" else mesh
    change_byte(own / changed)
    assert_named(run, changed)


def edit_json(file: Path, change: Callable[[Any], None]) -> None:
    """Change what a JSON file says, in the form in which it was written."""
    value = json.loads(file.read_text("utf-8"))
    change(value)
    file.write_text(json.dumps(value, indent=2, ensure_ascii=False) + "\n", "utf-8")


def forge_finding(run: Path) -> str:
    edit_json(run / "audit.json", lambda audit: audit["findings"][1].update(measured="all solved"))
    return "audit.json: findings solved measured:"


def forge_failure(run: Path) -> str:
    edit_json(run / "audit.json", lambda audit: audit["findings"][0].update(passed=False))
    return "audit.json: findings instantiated passed:"


def drop_finding(run: Path) -> str:
    edit_json(run / "audit.json", lambda audit: audit["findings"].pop())
    return "audit.json: findings"


def forge_instance(run: Path) -> str:
    edit_json(run / "instances" / "seed_0.json", lambda instance: instance["objects"][0]["pose"][0].__setitem__(0, 0.5))
    return "instances/seed_0.json: objects 0 pose 0 0:"


def forge_program(run: Path) -> str:
    program = (run / "simulation.py").read_text()
    (run / "simulation.py").write_text(program.replace("super().reset(env)", "super().reset(env)\n        return", 1))
    return "audit.json: findings solved"


def forge_motion(run: Path) -> str:
    with np.load(run / "instances" / "seed_0.npz") as found:
        arrays = {name: found[name] for name in found.files}
    arrays["tool"] = arrays["tool"] + np.float32(1e-3)
    np.savez_compressed(run / "instances" / "seed_0.npz", **arrays)
    return "instances/seed_0.npz:"


def forge_record(run: Path) -> str:
    edit_json(run / "run.json", lambda record: record.update(status="rejected"))
    return "run.json: status: recorded rejected, recomputed accepted"


def lose_instances(run: Path) -> str:
    shutil.rmtree(run / "instances")
    return "instances/seed_0"


def shadow_an_asset(run: Path) -> str:
    own = run / "assets" / "block"
    own.mkdir(parents=True, exist_ok=True)
    shutil.copy(content.content_path("assets", "library") / "block" / "red_block.urdf", own)
    return "assets/block/red_block.urdf"


def forge_away_the_audit(run: Path) -> str:
    (run / "audit.json").unlink()
    return "audit.json: an accepted run has one"


FORGERIES: tuple[tuple[Callable[[Path], str], ...], ...] = (
    (forge_finding, forge_failure, drop_finding, forge_instance, forge_motion, forge_record),
    (forge_program,),
    (lose_instances, shadow_an_asset),
    (forge_away_the_audit,),
)


@pytest.mark.parametrize("forgeries", FORGERIES)
def test_each_change_under_new_hashes_is_found_by_the_audit(
    run: Path, forgeries: tuple[Callable[[Path], str], ...]
) -> None:
    lines = [forge(run) for forge in forgeries]
    write_hashes(run)
    done, found = verify(run)
    assert done.returncode == 1
    for line in lines:
        assert any(difference.startswith(line) for difference in found["differences"]), (line, found)


@pytest.fixture
def key(small_scene: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A word of the log that is taken for a key, which sharing removes."""
    word = "/".join(small_scene.parts[-2:])
    monkeypatch.setenv("MY_TOKEN", word)
    return word


def test_a_shared_run_holds(run: Path, tmp_path: Path, key: str) -> None:
    assert key in (run / "events.jsonl").read_text()
    done = grs("share", "run", "--out", "shared.zip", folder=tmp_path)
    assert done.returncode == 0 and "events.jsonl" in done.stdout, done
    with zipfile.ZipFile(tmp_path / "shared.zip") as archive:
        archive.extractall(tmp_path / "other")
    done = grs("verify", "run", folder=tmp_path / "other")
    assert done.returncode == 0 and "holds (accepted)" in done.stdout


@pytest.mark.usefixtures("key")
def test_sharing_gives_a_changed_file_no_new_hash(run: Path, tmp_path: Path) -> None:
    with (run / "events.jsonl").open("a") as log:
        log.write("\n")
    assert grs("share", "run", "--out", "shared.zip", folder=tmp_path).returncode == 0
    with zipfile.ZipFile(tmp_path / "shared.zip") as archive:
        archive.extractall(tmp_path / "other")
    assert_named(tmp_path / "other" / "run", "events.jsonl")


def test_a_run_of_models_is_verified_without_them(
    tmp_path: Path, known_scene: Path, scripted_server: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("langchain_openai")
    monkeypatch.setenv("OPENAI_API_KEY", "sk-none")
    asking = ["--set", "models.default=openai:some/model", "--set", f"models.default.base_url={scripted_server.url}"]
    done = grs("run", str(known_scene), "--out", "run", *asking, "--set", "audit.seeds=1", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    asked = len(scripted_server.bodies)
    assert "judge" in scripted_server.roles
    done, found = verify(tmp_path / "run")
    assert (done.returncode, found["differences"]) == (0, []) and len(scripted_server.bodies) == asked


def test_a_comprehended_scene_has_no_audit_to_make_again(tmp_path: Path, known_scene: Path) -> None:
    shutil.copytree(known_scene, tmp_path / "run")
    done, found = verify(tmp_path / "run")
    assert (done.returncode, found["recomputed"]) == (0, False)
    change_byte(tmp_path / "run" / "scene.json")
    assert_named(tmp_path / "run", "scene.json")


def test_what_did_not_end_cannot_be_verified(run: Path) -> None:
    (run / "hashes.json").unlink()
    done = grs("verify", "run", folder=run.parent)
    assert done.returncode == 2 and "has no hashes.json" in done.stderr
    assert grs("verify", "nowhere", folder=run.parent).returncode == 2
