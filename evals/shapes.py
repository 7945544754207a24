"""How good reconstructed shapes are: of known assets, photographed alone with a sensor's noise, and of real scenes."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from evals.benchmark.shape_runs import measure_known, measure_real, scene_folders, shape_targets, write_sheets
from grs_agents.files import write_json
from grs_agents.runs import positive_int
from grs_agents.terminal import EscapingParser, print_escaped


def main(arguments: Sequence[str]) -> int:
    """Reconstruct every object, and write figures and sheets to look at.

    Returns:
        0 if every target is met, 1 if not.

    Raises:
        InputError: a folder holds no scene.
    """
    parser = EscapingParser(prog="grs eval shapes", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/eval-shapes"), help="where figures and sheets go")
    parser.add_argument("--known", type=positive_int, default=60, metavar="N", help="assets to photograph: 60")
    parser.add_argument("--seed", type=int, default=0, help="of assets, cameras and noise")
    parser.add_argument(
        "--scenes", type=Path, action="append", default=[], metavar="DIR", help="scenes, or a folder of them; repeat"
    )
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    options = parser.parse_args(arguments)
    known, known_rows = measure_known(options.known, options.seed)
    real, real_rows = measure_real(scene_folders(options.scenes))
    targets = shape_targets(known, real)
    figures = {"targets": targets, "known": [asdict(one) for one in known], "real": [asdict(one) for one in real]}
    write_json(options.out / "shapes.json", figures)
    write_sheets(options.out, "known", known_rows)
    write_sheets(options.out, "real", real_rows)
    for row in targets:
        met = {True: "met", False: "missed", None: ""}[row["met"]]
        print_escaped(f"{row['figure']:40} {row['value']!s:>8} {row['target'] or '':>6} {met}")
    if options.json:
        print_escaped(json.dumps(figures))
    return 0 if all(row["met"] in (True, None) for row in targets) else 1
