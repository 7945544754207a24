"""Small files that stand for gigabytes or hours are refused in one line, and cost the process with the keys nothing."""

import json
import resource
import shutil
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from grs_agents.base.foreign.arrays import read_npz
from grs_agents.base.trace.events import EVENT, Rollout
from grs_agents.library.importing.types import ImportOptions
from grs_agents.sandbox.host.foreign_reader import READING
from scripts.check_portable import write_example
from tests import bombs
from tests.cli.command import grs
from tests.cli.test_foreign_folder import made, run
from tests.gantry import GANTRY
from tests.slow import slow_where

__all__ = ["made", "run"]  # fixtures

MEBIBYTE = 1 << 20
KIBIBYTES = 1024
"""In which the kernel tells the memory of a process."""


def peak() -> int:
    """The most memory that this process ever had, MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // KIBIBYTES


def children_peak() -> int:
    """The most memory that a child of this process ever had, one of an earlier test included, MiB."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // KIBIBYTES


def scene_with(sample_scene: Path, folder: Path, name: str, write: Callable[[Path], object]) -> Path:
    """A copy of the sample scene in which ``name`` is written anew; its other file of that stem is gone."""
    copy = Path(shutil.copytree(sample_scene, folder / "scene"))
    (copy / f"{Path(name).stem}.png").unlink()
    write(copy / name)
    return copy


HUGE = bombs.array_header((60_000, 60_000, 3))
PHOTO = bombs.array_header((8_000, 8_000, 3))
ARCHIVES: dict[str, tuple[Callable[[Path], object], str]] = {
    "bzip2": (lambda file: bombs.zeros_npz(file, "rgb", zipfile.ZIP_BZIP2, PHOTO, 192), "packed by bzip2"),
    "lzma": (lambda file: bombs.zeros_npz(file, "rgb", zipfile.ZIP_LZMA, PHOTO, 64), "packed by LZMA"),
    "header": (lambda file: bombs.long_header_npz(file, "rgb", 512), "header of more than 65536 bytes"),
    "members": (lambda file: bombs.many_members_npz(file, 100_000), "table of members of 4700000 bytes"),
    "declared": (lambda file: bombs.zeros_npz(file, "rgb", zipfile.ZIP_DEFLATED, HUGE, 16), "more than 536870912"),
}


@pytest.mark.parametrize("kind", slow_where({"lzma", "header"}.__contains__, ARCHIVES))
def test_an_array_unpacks_to_no_more_than_it_may(tmp_path: Path, kind: str) -> None:
    write, words = ARCHIVES[kind]
    write(tmp_path / "scene.npz")
    if kind != "members":
        with zipfile.ZipFile(tmp_path / "scene.npz", "a") as archive:  # what a scene needs beside it
            for name in ("depth", "K"):
                archive.writestr(f"{name}.npy", bombs.array_header((3, 3), "<f8") + bytes(72))
    before = peak()
    done = grs("scene", "scene.npz", "--out", "out", folder=tmp_path)
    assert done.returncode == 2 and words in done.stderr and len(done.stderr.splitlines()) == 1, done.stderr
    assert peak() - before < 200


PICTURES: dict[str, tuple[str, Callable[[Path], object], str]] = {
    "declared": ("rgb.png", lambda file: bombs.png(file, 60_000, 60_000, rows=4), "not a readable picture"),
    "whole": ("rgb.png", lambda file: bombs.png(file, 8_000, 8_000), "8000x8000, of another shape"),
    "strip": ("depth.tif", lambda file: bombs.tiff(file, 640, 480, 1500), "depth.tif"),
}


@pytest.mark.parametrize("kind", slow_where({"strip"}.__contains__, PICTURES))
def test_a_photo_is_decoded_in_a_worker(sample_scene: Path, tmp_path: Path, kind: str) -> None:
    name, write, words = PICTURES[kind]
    scene_with(sample_scene, tmp_path, name, write)
    before, earlier = peak(), children_peak()
    done = grs("scene", "scene", "--out", "out", folder=tmp_path)
    assert done.returncode == 2 and words in done.stderr and len(done.stderr.splitlines()) == 1, done.stderr
    assert peak() - before < 150  # a picture of 8000x8000 takes 450 MiB
    assert children_peak() <= max(600, earlier)


def test_a_photo_read_in_a_worker_is_the_same(sample_scene: Path, tmp_path: Path) -> None:
    from grs_agents.perception.reading.foreign_scene import read_foreign_masks, read_foreign_scene
    from grs_agents.perception.reading.masks import read_masks
    from grs_agents.perception.reading.scene_source import read_scene

    copy = Path(shutil.copytree(sample_scene, tmp_path / "scene"))
    shutil.copy(copy / "labels.png", copy / "masks.png")
    (copy / "rgb.png").rename(tmp_path / "elsewhere.png")
    (copy / "rgb.png").symlink_to(tmp_path / "elsewhere.png")  # as data sets keep their files
    here, there = read_scene(copy), read_foreign_scene(copy)
    assert (here.rgb == there.rgb).all() and (here.depth == there.depth).all()
    link = f"{copy / 'rgb.png'} is a link to {tmp_path / 'elsewhere.png'}, outside the scene's folder"
    assert (here.camera, here.source, (*here.notes, link)) == (there.camera, there.source, there.notes)
    shape = here.depth.shape
    assert (
        read_masks(copy, (shape[0], shape[1])).labels == read_foreign_masks(copy, (shape[0], shape[1])).labels
    ).all()


@pytest.mark.parametrize(
    ("link", "target", "words"),
    [
        ("rgb.png", "/", "which is no file of a scene"),
        ("camera.json", "/etc/passwd", "which is no file of a scene"),
        ("masks", "/etc", "which is no file of a scene"),
    ],
)
def test_a_link_in_a_scene_to_anything_else_is_refused(
    sample_scene: Path, tmp_path: Path, link: str, target: str, words: str
) -> None:
    from grs_agents.base.errors import InputError
    from grs_agents.perception.reading.foreign_scene import read_foreign_masks, read_foreign_scene

    copy = Path(shutil.copytree(sample_scene, tmp_path / "scene"))
    (copy / link).unlink(missing_ok=True)
    (copy / link).symlink_to(target)
    with pytest.raises(InputError, match=words):
        if link == "masks":
            read_foreign_masks(copy, (480, 640))
        else:
            read_foreign_scene(copy)


def test_links_that_no_reader_needs_open_nothing_to_the_worker(
    sample_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from grs_agents.perception.reading.foreign_scene import read_foreign_scene
    from grs_agents.sandbox.host.foreign_reader import ForeignReader

    copy = Path(shutil.copytree(sample_scene, tmp_path / "scene"))
    blob = tmp_path / "blobs" / ("0123456789abcdef" * 4)
    blob.parent.mkdir()
    (copy / "rgb.png").rename(blob)
    for name, target in {"rgb.png": blob, "x": Path("/"), "h": Path.home(), "notes.json": Path("/etc/passwd")}.items():
        (copy / name).symlink_to(target)
    opened: list[Path] = []

    class Reader(ForeignReader):
        def __init__(self, module: str, readable: Sequence[Path]) -> None:
            opened.extend(readable)
            super().__init__(module, readable)

    monkeypatch.setattr("grs_agents.perception.reading.foreign_scene.ForeignReader", Reader)
    assert read_foreign_scene(copy).rgb.shape == (480, 640, 3)
    assert opened == [copy, blob]


def test_what_a_worker_reads_costs_no_more_than_its_limits(tmp_path: Path) -> None:
    from grs_agents.base.errors import InputError
    from grs_agents.sandbox.host.foreign_reader import ForeignReader

    bombs.png(tmp_path / "a.png", 8_000, 8_000)
    worker = "grs_agents.views.common.decoding_worker"
    with ForeignReader(worker, [tmp_path], READING.model_copy(update={"memory_mib": 64})) as reader:
        with pytest.raises(InputError, match=r"a\.png"):
            reader.read({"picture": str(tmp_path / "a.png"), "flags": 1}, "a.png")
        with pytest.raises(InputError, match="cannot read"):  # it may open nothing else
            reader.read({"picture": str(Path(__file__).with_name("a.png")), "flags": 1}, "a.png")


def test_without_a_backend_bounds_and_an_empty_environment_are_left(
    sample_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from grs_agents.base.errors import InputError
    from grs_agents.perception.reading.foreign_scene import read_foreign_scene
    from grs_agents.sandbox.host.foreign_reader import ForeignReader

    monkeypatch.setattr("grs_agents.perception.reading.foreign_scene.ForeignReader", ForeignReader)

    def lacks(backend: str) -> list[tuple[str, str]]:
        return [] if backend == "none" else [("it is not there", "install it")]

    monkeypatch.setattr("grs_agents.sandbox.host.sandbox.missing_requirements", lacks)
    copy = Path(shutil.copytree(sample_scene, tmp_path / "scene"))
    assert read_foreign_scene(copy).rgb.shape == (480, 640, 3)
    bombs.png(copy / "rgb.png", 8_000, 8_000)
    before = peak()
    with pytest.raises(InputError, match="of another shape"):
        read_foreign_scene(copy)
    assert peak() - before < 150


IMPORTED: dict[str, tuple[str, Callable[[Path], object], str]] = {
    "names": ("a.tar.gz", lambda file: bombs.long_names_tar(file, 16_000, 32_000), "unpacks to more than"),
    "one name": ("a.tar.gz", lambda file: bombs.one_long_name_tar(file, 300), "header of more than 65536 bytes"),
    "passed over": ("a.tgz", lambda file: bombs.passed_over_tar(file, 400), "unpacks to more than"),
    "bzip2": ("a.zip", lambda file: bombs.zip_of_zeros(file, "a.obj", zipfile.ZIP_BZIP2, 64), "packed by bzip2"),
    "deflate": ("a.zip", lambda file: bombs.zip_of_zeros(file, "a.obj", zipfile.ZIP_DEFLATED, 400), "unpacks to more"),
    "points": ("a.gltf", lambda file: bombs.gltf_of_many_points(file, 1_500_000_000), "a.gltf"),
}


def write_textured(file: Path, side: int) -> None:
    """A tetrahedron whose picture is large."""
    bombs.png(file.with_name("a.png"), side, side, rows=4)
    file.with_name("a.mtl").write_text("newmtl a\nmap_Kd a.png\n")
    corners = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nvt 0 0\nusemtl a\n"
    faces = "".join(f"f {a}/1 {b}/1 {c}/1\n" for a, b, c in ((1, 3, 2), (1, 2, 4), (2, 3, 4), (3, 1, 4)))
    file.write_text(f"mtllib a.mtl\n{corners}{faces}")


@pytest.mark.parametrize("kind", slow_where({"names", "passed over", "deflate"}.__contains__, IMPORTED))
def test_an_import_unpacks_to_no_more_than_it_may(tmp_path: Path, kind: str) -> None:
    name, write, words = IMPORTED[kind]
    (tmp_path / "source").mkdir()
    write(tmp_path / "source" / name)
    before = peak()
    done = grs("assets", "import", f"source/{name}", "--library", "mine", folder=tmp_path)
    assert done.returncode == 1 and "1 refused" in done.stdout and words in done.stdout, done.stdout + done.stderr
    assert peak() - before < 150
    assert ImportOptions().limits.unpacked > 1e9  # what is unpacked is bounded by the archive's own size


def test_a_picture_bomb_costs_an_asset_its_look(tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    write_textured(tmp_path / "source" / "a.obj", 60_000)
    before = peak()
    done = grs("assets", "import", "source/a.obj", "--library", "mine", folder=tmp_path)
    assert done.returncode == 0 and "3600000000 pixels" in done.stderr, done.stdout + done.stderr
    assert "the picture is not shown" in done.stderr
    assert peak() - before < 150


ROBOTS = {
    "replicate": ("<worldbody>", "<worldbody><replicate count='100000'><geom size='.1'/></replicate>", "<replicate>"),
    "absolute": ("<worldbody>", "<asset><mesh name='m' file='/etc/passwd'/></asset><worldbody>", "/etc/passwd"),
    "above": ("<worldbody>", "<asset><mesh name='m' file='../m.obj'/></asset><worldbody>", "../m.obj"),
    "meshdir": ('angle="radian"/>', 'angle="radian" meshdir="/etc"/>', "/etc"),
    "include": ("<worldbody>", "<include file='../more.xml'/><worldbody>", "../more.xml"),
    "plugin": ("<worldbody>", "<extension><plugin plugin='p'/></extension><worldbody>", "<extension>"),
    "texture": (
        "<worldbody>",
        "<asset><texture name='t' type='2d' builtin='flat' width='49000' height='49000'/></asset><worldbody>",
        "49000x49000",
    ),
    "memory": ("<worldbody>", "<size memory='100G'/><worldbody>", "100G"),
    "bodies": ("<worldbody>", "<worldbody>" + "<body><geom size='.01'/></body>" * 600, "500 elements <body>"),
}


@pytest.mark.parametrize("kind", ROBOTS)
def test_the_robot_of_a_task_folder_is_looked_at_before_it_is_compiled(tmp_path: Path, kind: str) -> None:
    old, new, words = ROBOTS[kind]
    task = write_example(tmp_path / "task", robot="robot/arm.xml")
    (task / "robot").mkdir()
    (task / "robot" / "arm.xml").write_text(GANTRY.replace(old, new))
    done = grs("export", "task", folder=tmp_path)
    assert done.returncode == 2 and words in done.stderr and len(done.stderr.splitlines()) == 1, done.stderr


def test_a_robot_elsewhere_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(GANTRY)
    write_example(tmp_path / "task", robot=str(tmp_path / "arm.xml"))
    done = grs("export", "task", folder=tmp_path)
    assert done.returncode == 2 and "no path inside" in done.stderr


def test_a_recording_of_a_strangers_run_unpacks_to_no_more_than_it_may(run: Path) -> None:
    file = next(run.rglob("*.npz"))
    with np.load(file) as found:
        arrays = {name: found[name] for name in found.files}
    bombs.zeros_npz(file, "tool", zipfile.ZIP_BZIP2, bombs.array_header((8_000_000, 3), "<f4"), 128)
    with zipfile.ZipFile(file, "a") as archive:
        for name in arrays.keys() - {"tool"}:
            with archive.open(f"{name}.npy", "w") as content:
                np.lib.format.write_array(content, arrays[name])
    before = peak()
    done = grs("report", "run", "--out", "run/trace.rrd", folder=run.parent)
    assert done.returncode == 2 and "packed by bzip2" in done.stderr, done.stderr
    assert grs("report", "run", folder=run.parent).returncode == 0  # the page says why there is no film
    assert "packed by bzip2" in (run / "report.html").read_text("utf-8")
    done = grs("share", "run", folder=run.parent)
    assert done.returncode != 0 or file.name in done.stdout, done.stdout
    assert peak() - before < 300
    with pytest.raises(Exception, match="packed by bzip2"):
        read_npz(file, {"tool": "metres"}, {})


def test_names_in_a_log_are_cut() -> None:
    line = json.dumps({"kind": "rollout", "seed": 0, "reward": 1.0, "outcome": "o" * 1_000_000, "moved": ["m" * 1000]})
    event = EVENT.validate_json(line)
    assert isinstance(event, Rollout)
    assert len(event.outcome) == len(event.moved[0]) == 200
