"""What was imported is found again in a photo: a YCB-style folder, a URDF, an MJCF, a GLB, an OBJ, an STL and a PLY."""

from pathlib import Path

from evals.synthesis import Recipe
from grs_agents.library import Library
from grs_agents.library.importing import ImportOptions, ImportRun, open_import_source
from grs_agents.perception.matching import match_by_features
from tests.library.importing import models
from tests.perception.matching.photo import request_of


def test_imported_things_match_themselves(tmp_path: Path) -> None:
    models.write_many(tmp_path / "mixed")
    models.write_ycb(tmp_path / "ycb")
    for name in ("mixed", "ycb"):
        with open_import_source(str(tmp_path / name), ImportOptions()) as source:
            ImportRun(tmp_path / "root", name, ImportOptions(), Library().assets()).run(source, lambda *_: None)
    library = Library(tmp_path / "root")
    assert len(library.everyday_assets()) == 7
    recipe = Recipe(seed=1, objects=7, distractors=0, tilt=40, width=480, height=360)
    request, names = request_of(recipe, library, ocr=False)
    found = match_by_features(request, library, "match_features").matches
    told = {name: found[number].asset for number, name in names.items()}
    assert len(told) == 7
    assert sum(name == asset for name, asset in told.items()) >= 6, told
