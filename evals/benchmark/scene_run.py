"""A scene comprehended as every run does it, with offline models, and pictures of its twin."""

import shutil
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from grs_agents.base.config.load import load_config
from grs_agents.base.files import write_bytes
from grs_agents.library.library import Library
from grs_agents.perception.image_geometry import Labels
from grs_agents.perception.picture_files import load_mask
from grs_agents.perception.twin_picture import draw_twin
from grs_agents.perception.types import Mask, SceneDescription, read_scene_description
from grs_agents.runs.execution import execute_run
from grs_agents.runs.metrics import cpu_seconds
from grs_agents.runs.run_opening import RunOrder
from grs_agents.sim.rendering.cameras import RenderedImage, encode_png

ASIDE: Final = 40.0
"""Degrees by which the second picture's camera is turned about the objects."""
_PIECE: Final = "a piece of"
"""Says that a dropped segment is part of an object."""
TWIN, TWIN_ASIDE = "twin.png", "twin_aside.png"


@dataclass(frozen=True)
class SceneRun:
    """The result of a run on a scene.

    Attributes:
        scene: its description.
        library: with the run's own shapes.
        owners: (H, W) numbers of the objects by their masks, 0 = none; smaller objects on top.
        owned: (H, W) mask of the objects and their pieces.
        twin: from the photo's camera.
        refused: reason of a rejection; empty if accepted.
        cpu_seconds: of the whole run, offline models included.
    """

    scene: SceneDescription
    library: Library
    owners: Labels
    owned: Mask
    twin: RenderedImage
    refused: str
    cpu_seconds: float


def comprehend_scene(source: str, folder: Path, settings: Sequence[str]) -> SceneRun:
    """Comprehend a scene, and write its run and the pictures `TWIN` and `TWIN_ASIDE` into ``folder``.

    Args:
        source: as for `grs scene`.
        folder: its contents are replaced.
        settings: of the configuration, ``KEY=VALUE``.

    Raises:
        GrsError: the run ended with an error before it described the scene.
    """
    shutil.rmtree(folder, ignore_errors=True)
    config = load_config(None, ["background.on=false", *settings, "graph=scene"])
    begin = cpu_seconds()
    ended = execute_run(
        RunOrder("scene", Path(source), config, folder),
        lambda _folder, _log: nullcontext(),
    )
    seconds = cpu_seconds() - begin
    if ended.problem is not None and not (folder / "scene.json").is_file():
        raise ended.problem
    refused = "" if ended.problem is None else ended.problem.message
    scene, library, shapes = read_scene_description(folder / "scene.json"), Library(), folder / "assets"
    if shapes.is_dir():  # not there if every object has an asset
        library = library.copy_with_overlay_root(shapes)
    masks = {item.id: load_mask(folder / item.mask) for item in scene.objects}
    owners = np.zeros(next(iter(masks.values())).shape, np.int32)
    for number in sorted(masks, key=lambda number: -int(masks[number].sum())):
        owners[masks[number]] = number
    pieces = [
        load_mask(folder / f"scene/mask_{segment.id:02d}.png") for segment in scene.dropped if _PIECE in segment.reason
    ]
    owned = np.logical_or.reduce([owners > 0, *pieces])
    twin = draw_twin(scene, library)
    write_bytes(folder / TWIN, encode_png(twin.color))
    write_bytes(folder / TWIN_ASIDE, encode_png(draw_twin(scene, library, np.deg2rad(ASIDE)).color))
    return SceneRun(scene, library, owners, owned, twin, refused, seconds)
