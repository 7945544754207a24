"""A run folder as somebody hostile, or a broken disk, might hand it over: one seeded change at a time."""

import io
import json
import os
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np

Random = np.random.Generator
ODD: tuple[Any, ...] = (
    None,
    True,
    -1,
    0,
    1e308,
    -1e308,
    10**40,
    2**63,
    "",
    "x" * 10_000,
    "/etc/passwd",
    "../../../../etc/passwd",
    "a\0b",
    "\x1b]0;owned\x07\x9b31m\u202eevil",
    "[red]markup[/red]",
    [0],
    {"x": 0},
    [1, [2, [3]]],
    {"a": {"b": 1}},
    [1e999],
    "\ud800",
    [0.0, 0.0, 0.0],
    "/dev/zero",
    ".",
    "run.json",
)


def pick(random: Random, things: Any) -> Any:
    """One of ``things``."""
    return things[int(random.integers(len(things)))]


def files_in(folder: Path, *suffixes: str) -> list[Path]:
    """The files below ``folder`` with one of these suffixes, or all."""
    found = sorted(path for path in folder.rglob("*") if path.is_file())
    return [path for path in found if not suffixes or path.suffix in suffixes]


def flip(folder: Path, random: Random) -> None:
    """Change some bytes of a file."""
    file = pick(random, files_in(folder))
    data = bytearray(file.read_bytes())
    for _ in range(int(random.integers(1, 20))):
        if data:
            data[int(random.integers(len(data)))] = int(random.integers(256))
    file.write_bytes(data)


def cut(folder: Path, random: Random) -> None:
    """Cut the end off a file."""
    file = pick(random, files_in(folder))
    data = file.read_bytes()
    file.write_bytes(data[: int(random.integers(len(data) + 1))])


def spots(value: Any) -> list[tuple[Any, Any]]:
    """Every place in a JSON value: its container and its key."""
    found: list[tuple[Any, Any]] = []
    waiting: list[Any] = [value]
    while waiting:
        one = waiting.pop()
        if isinstance(one, dict):
            inside: list[tuple[Any, Any]] = list(cast("dict[Any, Any]", one).items())
        else:
            inside = list(enumerate(cast("list[Any]", one))) if isinstance(one, list) else []
        found += [(one, key) for key, _ in inside]
        waiting += [item for _, item in inside]
    return found


def revalue(folder: Path, random: Random) -> None:
    """Replace or remove a value of a JSON file, or of a line of the log."""
    file = pick(random, [*files_in(folder, ".json"), *files_in(folder, ".jsonl") * 6])
    lines = file.read_text("utf-8").splitlines() if file.suffix == ".jsonl" else [file.read_text("utf-8")]
    number = int(random.integers(len(lines)))
    value = json.loads(lines[number])
    places = spots(value)
    place, key = pick(random, places)
    if random.random() < 0.2:
        del place[key]
    else:
        place[key] = pick(random, ODD)
    lines[number] = json.dumps(value)
    file.write_text("\n".join(lines) + "\n", "utf-8")


def rename(folder: Path, random: Random) -> None:
    """Give a file a name that commands a terminal, or is not UTF-8."""
    file = pick(random, files_in(folder))
    name = pick(random, (b"\x1b[2Jcleared", b"not-utf8-\xff", "\u202egnp.evil".encode(), b"[red]x", b"-rf"))
    file.rename(file.parent / (os.fsdecode(name) + file.suffix))


def link(folder: Path, random: Random) -> None:
    """Put a link in the place of a file."""
    file = pick(random, files_in(folder))
    file.unlink()
    file.symlink_to(pick(random, ("/etc/passwd", "/dev/zero", str(file), "nowhere", "..", "/proc/self/mem")))


def special(folder: Path, random: Random) -> None:
    """Put a pipe or a folder in the place of a file."""
    file = pick(random, files_in(folder))
    file.unlink()
    (os.mkfifo if random.random() < 0.5 else os.mkdir)(file)


def forge_array(folder: Path, random: Random) -> None:
    """An archive whose arrays say that they are huge, or are once unpacked."""
    files = files_in(folder, ".npz")
    file = pick(random, files) if files else folder / "instances" / "seed_0.npz"
    file.parent.mkdir(exist_ok=True)
    with np.load(file) as found:
        arrays = {name: found[name] for name in found.files}
    name = pick(random, sorted(arrays))
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for other, array in arrays.items():
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, array)
            data = buffer.getvalue()
            if other == name:
                data = _forged(array, data, random)
            archive.writestr(f"{other}.npy", data)


def _forged(array: Any, data: bytes, random: Random) -> bytes:
    header = io.BytesIO()
    shape = pick(random, ((10**12,), (10**12, 3), (2**62, 4), (), (0,), (3, 3, 3, 3), (40_000_000,)))
    said = {"descr": np.lib.format.dtype_to_descr(array.dtype), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(header, said)
    return header.getvalue() + (bytes(40_000_000 * 4) if shape == (40_000_000,) else data[128:])


def deep(folder: Path, random: Random) -> None:
    """JSON of many levels, or of many values."""
    file = pick(random, files_in(folder, ".json", ".jsonl"))
    arrays, objects = "[" * 100_000 + "]" * 100_000, '{"a":' * 5_000 + "1" + "}" * 5_000
    inner = pick(random, (arrays, objects, "[" + "[]," * 1_000_000 + "[]]"))
    if file.suffix == ".jsonl":
        line = f'{{"kind":"task_defined","task":{{"a":{inner}}}}}'
        file.write_text(f"{line}\n{file.read_text('utf-8')}", "utf-8")
    else:
        file.write_text(inner, "utf-8")


def misname(folder: Path, random: Random) -> None:
    """Let an event name a file elsewhere."""
    file = folder / "events.jsonl"
    events = [json.loads(line) for line in file.read_text("utf-8").splitlines()]
    naming = [event for event in events if event["kind"] in ("scene_stage", "prompt", "rollout", "program_version")]
    event = pick(random, naming)
    odd = pick(random, ("/etc/passwd", "../run.json", "a/../../b.png", "/dev/zero", "", ".", "scene", "\x1b[31m.png"))
    if event["kind"] == "scene_stage":
        event["files"] = dict.fromkeys([*event.get("files", {}), "rgb"], odd)
    elif event["kind"] == "prompt":
        event["images"] = [odd]
    elif event["kind"] == "rollout":
        event[pick(random, ("recording", "instance"))] = odd
    else:
        event["path"] = odd
    file.write_text("".join(json.dumps(one) + "\n" for one in events), "utf-8")


def huge_picture(folder: Path, random: Random) -> None:
    """A picture that says that it has 60,000 x 60,000 pixels."""
    file = pick(random, files_in(folder, ".png"))
    data = file.read_bytes()
    body = b"IHDR" + struct.pack(">II", 60_000, 60_000) + data[24:29]
    file.write_bytes(data[:12] + body + struct.pack(">I", zlib.crc32(body)) + data[33:])


def inflate(folder: Path, random: Random) -> None:
    """A file of 8 GiB that takes no room on the disk."""
    os.truncate(pick(random, files_in(folder)), 8 << 30)


KINDS: tuple[Callable[[Path, Random], None], ...] = (
    flip,
    cut,
    revalue,
    revalue,
    revalue,
    revalue,
    rename,
    link,
    special,
    forge_array,
    deep,
    misname,
    huge_picture,
    inflate,
)


def mutate(folder: Path, seed: int) -> str:
    """Change the run in ``folder`` once or twice; what was done, in words."""
    random = np.random.default_rng(seed)
    done: list[str] = []
    for _ in range(1 + int(random.random() < 0.3)):
        kind = pick(random, KINDS) if seed >= len(KINDS) or done else KINDS[seed]
        try:
            kind(folder, random)
            done.append(kind.__name__)
        except (OSError, ValueError, KeyError, IndexError):  # the first change left nothing for this one
            continue
    return f"{seed}: {', '.join(done)}"
