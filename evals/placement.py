"""Check that each object of processed scenes has an asset or a proxy of its measured size and place."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from grs_agents.errors import InputError
from grs_agents.library import Library
from grs_agents.perception import (
    SceneObject,
    deviation_from_measured_box,
    is_match_certain,
    read_scene_description,
    upright_box_from_aabb,
)
from grs_agents.terminal import EscapingParser


def main(arguments: Sequence[str]) -> int:
    """Check every ``scene.json`` below a folder, as `grs batch` and `grs scene` leave them.

    Returns:
        0 if every asset and proxy agrees with the measured box, 1 if not.

    Raises:
        InputError: the folder holds no described scene.
    """
    parser = EscapingParser(prog="grs eval placement", description=__doc__)
    parser.add_argument("folder", type=Path, help="a folder of run folders")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    options = parser.parse_args(arguments)
    files = sorted(options.folder.rglob("scene.json"))
    if not files:
        raise InputError(f"{options.folder} holds no scene.json", "make some with `grs batch` or `grs scene`")
    rows: list[dict[str, Any]] = []
    for file in files:
        library, proxies = Library(), file.parent / "assets"
        library = library.with_overlay(proxies) if proxies.is_dir() else library
        rows += [{"scene": file.parent.name, **_row(thing, library)} for thing in read_scene_description(file).objects]
    off, known = [row for row in rows if not row["agrees"]], sum(row["is_match_certain"] for row in rows)
    if options.json:
        print(json.dumps({"scenes": len(files), "objects": len(rows), "off": off, "is_match_certain": known}, indent=2))
    else:
        for row in off:
            errors = f"centre {1000 * row['centre']:.0f} mm, size {100 * row['size']:.0f} % off"
            print(f"{row['scene']}: {row['object']} ({row['asset']}): {errors}")
        print(f"{len(rows) - len(off)} of {len(rows)} objects in {len(files)} scenes have a stand-in of their size")
        if known:
            print(f"{known} of them a certain asset that is larger than what is seen of it")
    return 1 if off else 0


def _row(thing: SceneObject, library: Library) -> dict[str, Any]:
    measured = thing.upright or upright_box_from_aabb(thing.box)
    off = deviation_from_measured_box(thing.asset, (thing.position, thing.orientation), library, measured)
    certain = is_match_certain(thing)
    figures = {"object": thing.name, "asset": thing.asset, "centre": off.centre, "size": off.size}
    return {
        **figures,
        "agrees": off.is_within_tolerance or certain,
        "is_match_certain": certain and not off.is_within_tolerance,
    }
