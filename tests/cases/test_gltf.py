"""Public bug reports on glTF and GLB files: imported as the format says, or refused by the extension's name."""

from pathlib import Path

import numpy as np
import pytest

from grs_agents.library.importing.mesh_reader import read_mesh
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.types import ImportOptions
from grs_agents.library.library import Library
from tests.cases.public_cases import copy_case
from tests.cli.command import grs
from tests.needs import require

LIMITS = ImportOptions().limits


@pytest.mark.parametrize(
    ("case", "file", "size", "color"),
    [
        ("glb_draco", "Box_Draco.glb", (1.0, 1.0, 1.0), (231, 0, 0)),
        ("glb_gpu_instancing", "pair.glb", (0.26, 0.04, 0.03), None),
        ("glb_quantized", "tin.glb", (0.06, 0.04, 0.03), (231, 89, 89)),
        ("glb_specular_glossiness", "lid.glb", (0.06, 0.04, 0.03), (89, 124, 243)),
        ("gltf_factor_linear", "grey.glb", (0.06, 0.04, 0.03), (124, 124, 124)),
        ("gltf_factor_times_texture", "red.gltf", (0.06, 0.04, 0.03), (231, 0, 0)),
        ("gltf_percent_encoded", "tea_tin.gltf", (0.06, 0.04, 0.03), None),
        ("gltf_texture_transform", "red.gltf", (0.06, 0.04, 0.03), (230, 20, 20)),
    ],
)
def test_a_file_is_read_as_it_is_meant(
    case: str, file: str, size: tuple[float, ...], color: tuple[int, ...] | None, tmp_path: Path
) -> None:
    if case == "glb_draco":
        require("DracoPy")
    folder = copy_case(case, tmp_path)
    model = read_mesh(SourceFolder(folder, LIMITS.bytes), file, LIMITS)
    points = np.concatenate([part.vertices[part.faces].reshape(-1, 3) for part in model.parts])
    assert np.ptp(points, axis=0) == pytest.approx(size, abs=1e-4)
    if color is not None:
        (part,) = model.parts
        colors = part.colors
        if part.image is not None:
            assert part.uvs is not None
            u, v = part.uvs.mean(axis=1).T
            colors = part.image[((1 - v) * len(part.image)).astype(int), (u * part.image.shape[1]).astype(int)]
        assert colors is not None and np.unique(colors, axis=0).tolist() == [list(color)]


def test_imported_files_have_their_colours_and_a_compressed_one_is_named(tmp_path: Path) -> None:
    cases = {
        "gltf_factor_times_texture": "red",
        "gltf_percent_encoded": None,
        "glb_specular_glossiness": "blue",
        "gltf_meshopt": None,
    }
    for case in cases:
        copy_case(case, tmp_path / "source")
    done = grs("assets", "import", "source", "--library", "mine", folder=tmp_path)
    assert done.returncode == 1
    assert "EXT_meshopt_compression" in done.stdout and "3 imported, 0 duplicates, 1 refused" in done.stdout
    library = Library(tmp_path / "mine" / "assets" / "library")
    assets = {Path(asset.origin.source).parts[0]: asset for asset in library.assets() if asset.origin is not None}
    for case, color in cases.items():
        if color is not None:
            assert assets[case].color == color
            assert set(assets[case].description.split()) & {"red", "blue", "white"} == {color}
    assert assets["gltf_percent_encoded"].size == pytest.approx((0.06, 0.03, 0.04), abs=1e-4)  # y up becomes z up
