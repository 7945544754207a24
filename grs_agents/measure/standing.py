"""Where the assets of a measured scene stand, and its twin: what the agents would match is taken from the truth."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from grs_agents.library import Library, write_proxy
from grs_agents.scene import Candidate, Registered, TableFrame, TwinReport, register
from grs_agents.scene.metrics import MATCHED, overlaps
from grs_agents.scene.truth import LabelledScene
from grs_agents.twin import Thing, report_of


@dataclass(frozen=True)
class Standing:
    """What stands for the candidates, by their numbers.

    Attributes:
        poses: of the assets of candidates that match an object of the library.
        drifts: how far each thing moves until the twin is at rest, m.
        twin: its figures; ``None`` where nothing stands on the simulated table.
    """

    poses: Mapping[int, Registered] = field(default_factory=dict[int, Registered])
    drifts: Mapping[int, float] = field(default_factory=dict[int, float])
    twin: TwinReport | None = None


def standing(
    scene: LabelledScene,
    found: npt.NDArray[np.int32],
    candidates: Sequence[Candidate],
    library: Library,
    table: TableFrame | None,
) -> Standing:
    """Register the true asset of each candidate that matches an object, let proxies stand for the others, and settle.

    Args:
        scene: with its truth; without true assets there is nothing to say.
        found: (H, W) numbers of the candidates.
        candidates: measured in ``table``'s frame.
        library: where the true assets are looked up.
        table: ``None`` where none was found.

    Raises:
        SimulationError: MuJoCo takes the twin for impossible.
    """
    truth = {one.id: one.asset for one in scene.truth.objects if one.asset in library}
    if table is None or not truth or not candidates:
        return Standing()
    common = overlaps(found, scene.labels, scene.ignored())
    assets = {
        int(common.segments[column]): truth.get(int(common.truths[row]), "")
        for row, column in common.pairs()
        if common.ious[row, column] >= MATCHED
    }
    poses: dict[int, Registered] = {}
    things: list[Thing] = []
    with tempfile.TemporaryDirectory(prefix="grs-twin-") as folder:
        for one in candidates:
            asset = assets.get(one.id, "")
            if asset:
                stood = poses[one.id] = register(asset, library, one.upright, scene.frame, table, one.mask)
                things.append(Thing(asset, (stood.position, stood.orientation)))
            else:
                things.append(_proxy(one, Path(folder)))
        both = library.overlay(Path(folder)) if len(poses) < len(things) else library
        rest, twin = report_of(things, both, scene.frame, table, scene.labels > 0)
    drifts = {one.id: placed.drift for one, placed in zip(candidates, rest.placed, strict=True) if placed is not None}
    return Standing(poses, drifts, twin if drifts else None)


def _proxy(one: Candidate, folder: Path) -> Thing:
    box = one.upright
    asset = write_proxy(folder, f"candidate_{one.id}", one.shape, box.size, one.color, "a proxy")
    return Thing(asset.name, (box.center, (0.0, 0.0, float(np.sin(box.yaw / 2)), float(np.cos(box.yaw / 2)))))
