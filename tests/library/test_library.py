"""Finding assets, overlays and templates."""

from pathlib import Path

import pytest

from grs_agents.base import content
from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.library.library import Library
from grs_agents.perception.proxies.proxy import primitive_proxy, write_proxy


@pytest.fixture(scope="module")
def library() -> Library:
    """The shipped library."""
    return Library()


def test_an_unknown_name_is_answered_with_the_nearest(library: Library) -> None:
    for ask in (library.asset, library.asset_path, library.load_object_model):
        with pytest.raises(UnknownNameError, match=r"use one of: HOPE/Milk\.urdf"):
            ask("HOPE/Milkk.urdf")


def test_names_assets_and_paths_agree(library: Library) -> None:
    assert library.asset_names() == [asset.name for asset in library.assets()] == sorted(library.asset_names())
    assert library.asset_path("HOPE/Milk.urdf").read_text().startswith("<?xml")
    assert "HOPE/Milk.urdf" in library
    assert "HOPE/Beer.urdf" not in library


def test_a_template_is_read_with_its_defaults_or_with_ours(library: Library) -> None:
    name = "container/container-template.urdf"
    assert name in library.template_names()
    assert library.template_defaults(name)["DIM"] == pytest.approx(library.load_object_model(name).size)
    filled = library.load_filled_template(name, {"DIM": (0.3, 0.2, 0.1), "COLOR": (1, 0, 0)})
    assert filled.size == pytest.approx((0.3, 0.2, 0.1))
    assert {shape.color for shape in filled.visuals} == {(1, 0, 0, 1)}
    assert len(filled.colliders) == 5


def test_a_cylinder_is_as_wide_as_its_first_dimension(library: Library) -> None:
    filled = library.load_filled_template("cylinder/cylinder-template.urdf", {"DIM": (0.06, 0.06, 0.1)})
    assert filled.size == pytest.approx((0.06, 0.06, 0.1))


def test_negative_dimensions_are_refused(library: Library) -> None:
    with pytest.raises(InputError, match="not positive"):
        library.load_filled_template("box/box-template.urdf", {"DIM": (-1, 1, 1)})


def test_an_overlay_adds_and_wins(library: Library, tmp_path: Path) -> None:
    asset = write_proxy(tmp_path, "mug_1", primitive_proxy("cylinder", (0.08, 0.08, 0.1), (0.8, 0.1, 0.1)), "a red mug")
    both = library.copy_with_overlay_root(tmp_path)
    assert both.asset("proxy/mug_1.urdf") == asset
    assert both.asset_path("proxy/mug_1.urdf").is_relative_to(tmp_path)
    assert len(both.asset_names()) == len(library.asset_names()) + 1
    assert "proxy/mug_1.urdf" not in library
    again = Library(*map(Path, map(str, both.roots)))
    assert again.asset_names() == both.asset_names()
    write_proxy(tmp_path, "mug_1", primitive_proxy("box", (0.1, 0.1, 0.1), (0.1, 0.1, 0.8)), "a blue box")
    assert library.copy_with_overlay_root(tmp_path).asset("proxy/mug_1.urdf").color == "blue"
    assert (
        library.copy_with_overlay_root(tmp_path).copy_with_overlay_root(library.roots[0]).roots[-1] == library.roots[0]
    )


def test_files_are_found_in_every_root_and_nowhere_else(library: Library, tmp_path: Path) -> None:
    both = library.copy_with_overlay_root(tmp_path)
    assert both.mesh_or_texture_path("HOPE/meshes/Milk.obj").is_file()
    for name in ("HOPE/meshes/Beer.obj", "../../pyproject.toml"):
        with pytest.raises(InputError, match="does not exist"):
            both.mesh_or_texture_path(name)


def test_everyday_assets_are_no_templates_and_no_zones(library: Library) -> None:
    assert any(asset.kind == "Milk" for asset in library.everyday_assets())
    assert not any(asset.template or asset.category == "zone" for asset in library.everyday_assets())


def test_a_content_folder_is_laid_over_the_shipped_library(
    library: Library, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = tmp_path / "assets" / "library" / "own"
    own.mkdir(parents=True)
    (own / "tin.urdf").write_text(library.asset_path("cylinder/cylinder.urdf").read_text())
    monkeypatch.setattr(content, "_overlays", [])
    content.add_overlay_folder(tmp_path)
    both = Library()
    assert both.asset("own/tin.urdf").size == pytest.approx(library.asset("cylinder/cylinder.urdf").size)
    assert set(library.asset_names()) < set(both.asset_names())
