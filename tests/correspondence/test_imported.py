"""What was imported is found again in a photo: a YCB-style folder, a URDF, an MJCF, a GLB, an OBJ, an STL and a PLY."""

from pathlib import Path

import numpy as np

from grs_agents.correspondence.matching import by_features
from grs_agents.correspondence.types import MatchRequest, Segment
from grs_agents.library import Library
from grs_agents.library.importing.run import Importing
from grs_agents.library.importing.source import opened
from grs_agents.library.importing.types import ImportOptions
from grs_agents.scene import MatchEvidence, RGBDFrame, candidates_of, find_table
from grs_agents.synth import Recipe, synthesise
from tests.library.importing import models


def unasked(*_: object) -> MatchEvidence:
    raise AssertionError("the model was asked")


def test_imported_things_match_themselves(tmp_path: Path) -> None:
    models.write_many(tmp_path / "mixed")
    models.write_ycb(tmp_path / "ycb")
    for name in ("mixed", "ycb"):
        with opened(str(tmp_path / name), ImportOptions()) as source:
            Importing(tmp_path / "root", name, ImportOptions(), Library().assets()).run(source, lambda *_: None)
    library = Library(tmp_path / "root")
    assert len(library.things()) == 7
    made = synthesise(Recipe(seed=1, objects=7, distractors=0, tilt=40, width=480, height=360), library)
    frame = RGBDFrame(made.rgb, made.depth.astype(np.float32), made.camera, Path("made"))
    table = find_table(frame, np.random.default_rng(0))
    truth = {one.id: one.asset for one in made.truth.objects}
    segments: list[Segment] = []
    names: dict[int, str] = {}
    for one in candidates_of(frame, table, made.seen.labels):
        names[one.id] = truth[int(np.bincount(made.seen.labels[one.mask]).argmax())]
        segments.append(Segment(one.id, one.mask, one.upright, Path("crop.png"), one.points))
    found = by_features(MatchRequest(segments, frame, table, unasked, ocr=False), library, "match_features").matches
    told = {name: found[number].asset for number, name in names.items()}
    assert len(told) == 7
    assert sum(name == asset for name, asset in told.items()) >= 6, told
