"""Whether confidence means something: how often what a match names is right, where the library lacks some of it."""

from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from evals.benchmark.calibration import (
    calibration_figures,
    fit_coefficients,
    name_assets,
    reliability,
    write_reliability_diagram,
)
from grs_agents import terminal
from grs_agents.config import Limits
from grs_agents.errors import InputError
from grs_agents.library import Library
from grs_agents.metrics import metrics_table, metrics_to_dicts
from grs_agents.perception import DEFAULT
from grs_agents.perception.matching import INPUTS
from grs_agents.sandbox import Sandbox
from grs_agents.terminal import EscapingParser, print_json
from grs_agents.toolkit import ToolContext


def main(arguments: Sequence[str]) -> int:
    """Segment and match labelled scenes, and compare the confidence of each match with whether it is right.

    Returns:
        0 if every target is reached, 1 if not.

    Raises:
        InputError: a folder holds no scene, or nobody says what a scene shows.
    """
    parser = EscapingParser(prog="grs eval confidence", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/eval-confidence"), help="where the diagram goes")
    parser.add_argument(
        "--scenes",
        action="append",
        required=True,
        metavar="DIR",
        help="folder of scenes with truth.json, as `grs eval perception --synthesised` makes them; repeat",
    )
    parser.add_argument("--segment", default="segment_rgbd", metavar="TOOL", help="what segments")
    parser.add_argument("--fit", action="store_true", help="also print the coefficients that fit these scenes best")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    options = parser.parse_args(arguments)
    folders = [folder for place in options.scenes for folder in _scene_folders(Path(place))]
    with Sandbox() as sandbox:
        context = ToolContext(sandbox=sandbox, library=Library(), limits=Limits())
        named = [one for folder in folders for one in name_assets(folder, options.segment, context)]
    if not named:
        raise InputError("no segment of these scenes is like an asset", "name scenes with objects")
    figures = calibration_figures(named, DEFAULT.matching.least)
    write_reliability_diagram(options.out / "reliability.png", named)
    fitted = dict(zip(("constant", *INPUTS), fit_coefficients(named), strict=True)) if options.fit else {}
    if options.json:
        print_json({"figures": metrics_to_dicts(figures), "reliability": reliability(named), "fitted": fitted})
    else:
        console = terminal.make_console()
        console.print(metrics_table("confidence of matches", figures))
        shown = Table("confidence", "right", "matches", title="reliability")
        for row in reliability(named):
            shown.add_row(f"{row['confidence']:.2f}", f"{row['right']:.2f}", str(row["matches"]))
        console.print(shown)
        for name, value in fitted.items():
            console.print(f"{name}: {value:.4g}")
        console.print(f"reliability.png is in {options.out}")
    return 0 if all(one.is_target_met is not False for one in figures) else 1


def _scene_folders(place: Path) -> list[Path]:
    """The folder of a scene itself, or those in it that hold one."""
    found = sorted({file.parent for pattern in ("camera.json", "*/camera.json") for file in place.glob(pattern)})
    if not found:
        raise InputError(f"{place} holds no scene", "name a folder of scene folders")
    return found
