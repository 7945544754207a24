"""Public cases of models: imported through the command with the right value each."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.cases.public_cases import copy_case
from tests.cli.command import grs


def import_case(name: str, folder: Path) -> list[dict[str, Any]]:
    """The outcomes of importing a case."""
    copy_case(name, folder)
    done = grs("assets", "import", name, "--library", "lib", "--json", folder=folder)
    assert done.returncode == 0, done.stdout
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    ("name", "picture", "color", "size", "note"),
    [
        ("mtl_backslash", "textures/label.png", None, (0.06, 0.04, 0.03), ""),
        ("mtl_space_in_texture", "front label.png", None, (0.06, 0.04, 0.03), ""),
        ("mtl_missing", None, "gray", (0.06, 0.04, 0.03), "cereal.mtl"),
        ("urdf_lego_mtl_missing", None, "yellow", (0.0317, 0.0318, 0.023), ""),
        ("urdf_material_texture", "crate.png", None, (0.06, 0.04, 0.03), ""),
        ("urdf_mirrored_scale", None, "green", (0.06, 0.04, 0.03), ""),
        ("mjcf_refquat", "visual/image0.png", None, (0.06, 0.04, 0.03), ""),
    ],
)
def test_a_model_is_imported_with_its_look(
    tmp_path: Path, name: str, picture: str | None, color: str | None, size: tuple[float, ...], note: str
) -> None:
    (outcome,) = import_case(name, tmp_path)
    assert outcome["status"] == "imported"
    asset = outcome["asset"]
    assert sorted(asset["size"]) == pytest.approx(sorted(size), abs=2e-3)
    assert note in " ".join(outcome["notes"])
    if color == "gray":
        assert asset["color"] in ("gray", "white")  # bare scans are told lit
    elif color is not None:
        assert asset["color"] == color
    if picture is not None:
        texture = tmp_path / "lib" / "assets" / "library" / f"{name}/textures/{asset['kind']}.png"
        with Image.open(texture) as shown, Image.open(tmp_path / name / picture) as meant:
            wanted = {tuple(rgb) for rgb in np.asarray(meant.convert("RGB")).reshape(-1, 3).tolist()}
            got = {tuple(rgb) for rgb in np.asarray(shown.convert("RGB")).reshape(-1, 3).tolist()}
        assert got == wanted


def test_names_in_other_scripts_are_told_apart_and_kept_for_the_words(tmp_path: Path) -> None:
    outcomes = import_case("names_not_latin", tmp_path)
    assert len({outcome["item"] for outcome in outcomes}) == 3
    assert {outcome["item"] for outcome in outcomes} == {"zvezda", "ringo", "u9a6c_u514b_u676f"}
    for outcome in outcomes:
        assert Path(outcome["source"]).stem in outcome["asset"]["description"]


def test_what_is_not_read_is_listed_with_the_way_to_convert_it(tmp_path: Path) -> None:
    copy_case("folder_of_unsupported", tmp_path)
    done = grs("assets", "import", "folder_of_unsupported", "--library", "lib", folder=tmp_path)
    assert done.returncode == 0 and "1 imported, 0 duplicates, 0 refused, 3 not read" in done.stdout
    for line in ("chair.usdz: it is USD; open it in Blender", "lamp.fbx: it is FBX", "part.step: it is STEP; export"):
        assert f"not read {line}" in done.stdout
