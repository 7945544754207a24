"""Whether each object of described scenes has a stand-in of its size where it is: for a folder of runs."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from grs_agents.errors import InputError
from grs_agents.scene import SceneObject, read_description

CENTRE, SIZE = 0.02, 0.25
"""The centre may be off by so much (m), each extent by such a share."""


def main(arguments: Sequence[str]) -> int:
    """Check every ``scene.json`` below a folder, as `grs eval real` and `grs scene` leave them.

    Returns:
        0 if every stand-in agrees with what was measured, 1 if not.

    Raises:
        InputError: the folder holds no described scene.
    """
    parser = argparse.ArgumentParser(prog="grs eval placement", description=__doc__)
    parser.add_argument("folder", type=Path, help="a folder of run folders")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    options = parser.parse_args(arguments)
    files = sorted(options.folder.rglob("scene.json"))
    if not files:
        raise InputError(f"{options.folder} holds no scene.json", "make some with `grs eval real` or `grs scene`")
    rows = [
        {"scene": file.parent.name, **deviation(thing)} for file in files for thing in read_description(file).objects
    ]
    off = [row for row in rows if not row["agrees"]]
    if options.json:
        print(json.dumps({"scenes": len(files), "objects": len(rows), "off": off}, indent=2))
    else:
        for row in off:
            print(f"{row['scene']}: {row['object']} ({row['asset']}): centre {1000 * row['centre']:.0f} mm, "
                  f"size {100 * row['size']:.0f} % off")  # fmt: skip
        print(f"{len(rows) - len(off)} of {len(rows)} objects in {len(files)} scenes have a stand-in of their size")
    return 1 if off else 0


def deviation(thing: SceneObject) -> dict[str, Any]:
    """How far a stand-in's centre (m) and largest extent (share) are off the measured box."""
    x, y, z, w = thing.orientation
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    cosine, sine = abs(np.cos(yaw)), abs(np.sin(yaw))
    size = np.sort(thing.size)
    around = np.sort([size[0], size[1], size[2]])
    measured = np.sort(thing.box.size)
    turned = np.sort([thing.size[0] * cosine + thing.size[1] * sine, thing.size[0] * sine + thing.size[1] * cosine,
                      thing.size[2]])  # fmt: skip
    share = min(float(np.abs(one / measured - 1).max()) for one in (around, turned))
    centre = float(np.linalg.norm(np.subtract(thing.position, thing.box.center)))
    return {"object": thing.name, "asset": thing.asset, "centre": centre, "size": share,
            "agrees": centre <= CENTRE and share <= SIZE}  # fmt: skip
