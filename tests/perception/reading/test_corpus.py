"""Whatever lies where a scene should be, and whatever happened to its bytes: a frame, or one named error."""

import contextlib
import os
import resource
import sys
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from grs_agents.base.errors import InputError
from grs_agents.perception.reading.masks import read_masks
from grs_agents.perception.reading.scene_source import check_scene_source, read_scene
from tests.needs import needs
from tests.perception.reading.conftest import FORMS, Truth, make_truth

NAMES: dict[str, tuple[str, ...]] = {
    "folder": ("rgb.png", "depth.png", "camera.json"),
    "npz": ("scene.npz",),
    "pcd packed": ("cloud.pcd",),
    "ply": ("cloud.ply",),
    "npy": ("cloud.npy",),
}
FILES = [(form, name) for form, names in NAMES.items() for name in names]


@pytest.fixture(autouse=True)
def _bounded_memory() -> Iterator[None]:
    """A reader that believes a forged header fails here instead of filling the machine."""
    if sys.platform != "linux":
        yield
        return
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + (3 << 30), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def refused(source: Path, name: str) -> None:
    """The scene is refused in one line that names the file and a remedy."""
    with pytest.raises(InputError) as caught:
        check_scene_source(source)
        read_scene(source)
    assert Path(name).stem in str(caught.value)
    assert caught.value.remedy
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("form", "name"), FILES)
@pytest.mark.parametrize(
    "content",
    [b"", b"\0", b"\xff\xfe\xfd" * 50, b"{" * 20_000, b"\x89PNG\r\n\x1a\n", b"[1e999]", b"\0" * 5000, b"null"],
    ids=lambda value: str(value)[:16],
)
def test_anything_else_in_its_place(tmp_path: Path, truth: Truth, form: str, name: str, content: bytes) -> None:
    source = FORMS[form](tmp_path, truth)
    (tmp_path / name).write_bytes(content)
    refused(source, name)


@pytest.mark.parametrize(("form", "name"), FILES)
def test_every_cut_is_refused(tmp_path: Path, truth: Truth, form: str, name: str) -> None:
    source = FORMS[form](tmp_path, truth)
    whole = (tmp_path / name).read_bytes()
    for share in (0.01, 0.1, 0.5, 0.9):
        (tmp_path / name).write_bytes(whole[: int(share * len(whole))])
        refused(source, name)


@pytest.mark.parametrize(("form", "name"), FILES)
def test_what_is_no_file(tmp_path: Path, truth: Truth, form: str, name: str) -> None:
    source = FORMS[form](tmp_path, truth)
    file = tmp_path / name
    file.unlink()
    file.symlink_to(file)  # a loop
    refused(source, name)
    file.unlink()
    file.symlink_to(tmp_path / "nothing")
    refused(source, name)
    file.unlink()
    os.mkfifo(file)  # nobody will ever write into it
    refused(source, name)
    if source != file:
        file.unlink()
        file.mkdir()
        refused(source, name)


@pytest.mark.parametrize("target", ["/dev/zero", "/dev/stdin"])
def test_a_device(tmp_path: Path, truth: Truth, target: str) -> None:
    source = FORMS["folder"](tmp_path, truth)
    (tmp_path / "rgb.png").unlink()
    (tmp_path / "rgb.png").symlink_to(target)
    refused(source, "rgb.png")


@needs("sparse files")
def test_a_file_of_a_thousand_gigabytes(tmp_path: Path, truth: Truth) -> None:
    source = FORMS["npy"](tmp_path, truth)
    os.truncate(tmp_path / "cloud.npy", 1 << 40)
    refused(source, "cloud.npy")


@pytest.mark.parametrize(
    "name", ["", "x" * 5000, "a/b", "loop", "\x00", "photo.png", "scene.npz", "photo.heic", "\udcff"]
)
def test_names_that_lead_nowhere(tmp_path: Path, name: str) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "photo.heic").write_bytes(b"ftypheic")
    with pytest.raises(InputError):
        check_scene_source(tmp_path / name)
        read_scene(tmp_path / name)


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "3",
        '"fx"',
        "{}",
        '{"fx": 1e999}',
        '{"fx": -60.0}',
        '{"fx": {"a": 1}}',
        '{"width": 1e30}',
        '{"width": 48.5}',
        '{"height": 0}',
        f'{{"fx": {"9" * 5000}}}',
        f'{{"cx": {10**400}}}',
        '{"distortion": [0, 1e400, 0, 0, 0]}',
        '{"K": ' + "[" * 500 + "]" * 500 + "}",
        '{"convention": "opengl", "T_robot_cam": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}',
        '{"T_robot_cam": [[0, 0], [0, 0, 0]]}',
        '{"T_robot_cam": [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}',
        '{"T_robot_cam": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1e400]]}',
        '{"T_robot_cam": [["a", 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}',
    ],
    ids=lambda value: value[:30],
)
def test_a_camera_that_is_none(tmp_path: Path, truth: Truth, text: str) -> None:
    """Alone, and laid over a good one."""
    source = FORMS["folder"](tmp_path, truth)
    good = (tmp_path / "camera.json").read_text()
    (tmp_path / "camera.json").write_text(text)
    refused(source, "camera.json")
    if text.startswith('{"'):
        (tmp_path / "camera.json").write_text(f"{good[:-1]}, {text[1:]}")
        refused(source, "camera.json")


def test_a_camera_with_a_byte_order_mark_is_read(tmp_path: Path, truth: Truth) -> None:
    source = FORMS["folder"](tmp_path, truth)
    plain = read_scene(source)
    (tmp_path / "camera.json").write_bytes(b"\xef\xbb\xbf" + (tmp_path / "camera.json").read_bytes())
    assert read_scene(source).camera == plain.camera


@st.composite
def edits(draw: st.DrawFn) -> list[tuple[str, float, bytes]]:
    """What happens to some bytes: where (as a share of the length) and what is put there."""
    kind = st.sampled_from(("set", "insert", "cut", "remove"))
    place = st.one_of(st.floats(0, 1), st.floats(0, 0.1))
    special = st.sampled_from(
        (b"\xff" * 4, b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0" * 4, b"nan", b"-1", b"1e999")
    )
    return draw(st.lists(st.tuples(kind, place, st.one_of(special, st.binary(min_size=1, max_size=4))), max_size=6))


def spoilt(data: bytes, changes: list[tuple[str, float, bytes]]) -> bytes:
    for kind, share, content in changes:
        at = min(int(share * len(data)), max(len(data) - 1, 0))
        if kind == "cut" and len(changes) < 3:
            data = data[:at]
        elif kind == "set":
            data = data[:at] + content + data[at + len(content) :]
        elif kind == "insert":
            data = data[:at] + content + data[at:]
        elif kind == "remove":
            data = data[:at] + data[at + len(content) :]
    return data


def with_right_sums(data: bytes) -> bytes:
    """A PNG whose chunks have the sums that belong to them, so that its decoder gets to see what is in them."""
    out, at = data[:8], 8
    while at + 12 <= len(data):
        end = at + 8 + int.from_bytes(data[at : at + 4])
        out += data[at:end] + zlib.crc32(data[at + 4 : end]).to_bytes(4)
        at = end + 4
    return out


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, list[Path]]]:
    """A scene of each form, with its files."""
    made: dict[str, tuple[Path, list[Path]]] = {}
    for form, make in FORMS.items():
        folder = tmp_path_factory.mktemp("scene")
        source = make(folder / "data", make_truth())
        made[form] = (source, sorted(file for file in folder.rglob("*") if file.is_file()))
    return made


@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(changes=edits(), which=st.integers(0, 9), sums=st.booleans())
def test_spoilt_bytes(
    scenes: dict[str, tuple[Path, list[Path]]],
    form: str,
    changes: list[tuple[str, float, bytes]],
    which: int,
    sums: bool,
) -> None:
    source, files = scenes[form]
    file = files[which % len(files)]
    good = file.read_bytes()
    bad = spoilt(good, changes)
    try:
        file.write_bytes(with_right_sums(bad) if sums and file.suffix == ".png" else bad)
        with contextlib.suppress(InputError):
            frame = read_scene(source)
            assert frame.rgb.shape[:2] == frame.depth.shape == (frame.camera.height, frame.camera.width)
            assert (frame.depth >= 0).all()
        with contextlib.suppress(InputError):
            assert read_masks(source, (36, 48)).labels.max() <= 255
    finally:
        file.write_bytes(good)
