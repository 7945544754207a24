"""Check that each object of processed scenes has an asset or a proxy of its measured size and place."""

import hashlib
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.perception.registration.size_check import (
    deviation_from_measured_box,
    is_match_certain,
    upright_box_from_aabb,
)
from grs_agents.perception.types import read_scene_description
from grs_agents.runs.experiment_run import ExperimentParser


class _Scene(Frozen):
    objects: tuple[dict[str, Any], ...]


def main(arguments: Sequence[str]) -> int:
    """Check every ``scene.json`` below a folder, as `grs batch` and `grs scene` leave them.

    Returns:
        0 if every asset and proxy agrees with the measured box, 1 if not.

    Raises:
        InputError: the folder holds no described scene.
    """
    parser = ExperimentParser("placement", __doc__)
    parser.add_argument("folder", type=Path, help="a folder of run folders")
    experiment = parser.start(arguments)
    folder = experiment.options.folder
    files = sorted(folder.rglob("scene.json"))
    if not files:
        raise InputError(f"{folder} holds no scene.json", "make some with `grs batch` or `grs scene`")
    work = {
        f"{file.relative_to(folder).parent} {hashlib.sha256(file.read_bytes()).hexdigest()[:12]}": partial(
            _check_scene, file
        )
        for file in files
    }
    rows = [row for scene in experiment.make_or_reuse_rows(_Scene, work) for row in scene.objects]
    off, known = [row for row in rows if not row["agrees"]], sum(row["is_match_certain"] for row in rows)
    lines = [
        f"{row['scene']}: {row['object']} ({row['asset']}): "
        f"centre {1000 * row['centre']:.0f} mm, size {100 * row['size']:.0f} % off"
        for row in off
    ]
    lines.append(f"{len(rows) - len(off)} of {len(rows)} objects in {len(files)} scenes have a stand-in of their size")
    if known:
        lines.append(f"{known} of them a certain asset that is larger than what is seen of it")
    table = [{"scenes": len(files), "objects": len(rows), "of their size": len(rows) - len(off)}]
    more: dict[str, Any] = {"scenes": len(files), "objects": len(rows), "off": off, "is_match_certain": known}
    experiment.tell(table, *lines, **more)
    return 1 if off else 0


def _check_scene(file: Path) -> "_Scene":
    library, proxies = Library(), file.parent / "assets"
    library = library.copy_with_overlay_root(proxies) if proxies.is_dir() else library
    things = read_scene_description(file).objects
    rows: list[dict[str, Any]] = []
    for thing in things:
        measured = thing.upright or upright_box_from_aabb(thing.box)
        off = deviation_from_measured_box(thing.asset, (thing.position, thing.orientation), library, measured)
        certain = is_match_certain(thing)
        rows.append(
            {
                "scene": file.parent.name,
                "object": thing.name,
                "asset": thing.asset,
                "centre": off.centre,
                "size": off.size,
                "agrees": off.is_within_tolerance or certain,
                "is_match_certain": certain and not off.is_within_tolerance,
            }
        )
    return _Scene(objects=tuple(rows))
