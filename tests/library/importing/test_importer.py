"""Importing whole sources through the door: what comes out, what is refused, and that it goes on."""

import shutil
from pathlib import Path

import pytest

from evals.synthesis import Recipe
from grs_agents.base.errors import InputError
from grs_agents.library.importing import importer
from grs_agents.library.importing.archives import open_import_source
from grs_agents.library.importing.asset_discovery import MOST_ITEMS
from grs_agents.library.importing.asset_preparation import asset_view_path
from grs_agents.library.importing.drop_testing import build_asset_colliders, run_drop_test, verify_asset
from grs_agents.library.importing.importer import ImportRun
from grs_agents.library.importing.journal import Journal
from grs_agents.library.importing.types import ImportOptions, ImportOutcome
from grs_agents.library.library import Library
from grs_agents.perception.matching.feature_matcher import match_by_features
from tests.library.importing import models
from tests.perception.matching.photo import request_of


def run(
    source: Path, root: Path, collection: str = "mine", again: bool = False, faces: int = 12_000
) -> dict[str, tuple[ImportOutcome, bool]]:
    """Import a source; each outcome by its item's name, and whether it was known before."""
    told: dict[str, tuple[ImportOutcome, bool]] = {}
    options = ImportOptions(faces=faces)
    with open_import_source(str(source), options) as found:
        order = ImportRun(root, collection, options, Library().assets(), again)
        order.run(found, lambda outcome, old: told.update({outcome.item: (outcome, old)}))
    return told


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, tuple[ImportOutcome, bool]]]:
    """A mixed folder with a bowl of too many faces, a copy of it and a broken file, imported once."""
    source, root = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("root")
    models.write_many(source)
    models.bowl().subdivide_to_size(0.02).export(source / "bowl.ply")
    (source / "copy.ply").write_bytes((source / "bowl.ply").read_bytes())
    (source / "broken.obj").write_text("v 0 0 0\n")
    return root, run(source, root, faces=600)


def test_a_mixed_folder_is_imported_and_what_is_broken_is_refused(
    imported: tuple[Path, dict[str, tuple[ImportOutcome, bool]]],
) -> None:
    _, told = imported
    states = {name: outcome.status for name, (outcome, _) in told.items()}
    assert states.pop("broken") == "refused" and states.pop("copy") == "duplicate"
    assert states == dict.fromkeys(("block", "bowl", "can", "carton", "crate", "tin"), "imported")
    assert "same files as mine/bowl.urdf" in told["copy"][0].reason
    assert "broken.obj" in told["broken"][0].reason


def test_every_import_is_whole_and_rests_two_seconds_on_a_table(
    imported: tuple[Path, dict[str, tuple[ImportOutcome, bool]]],
) -> None:
    library = Library(imported[0])
    assert len(library.assets()) == 6
    for asset in library.assets():
        verdict = verify_asset(library, asset)
        assert verdict.ok and verdict.rests, verdict
        assert all(asset_view_path(imported[0], asset.name, number).is_file() for number in range(3))


def test_imported_things_are_found_again_in_a_photo(
    imported: tuple[Path, dict[str, tuple[ImportOutcome, bool]]], tmp_path: Path
) -> None:
    """A YCB-style folder, a URDF, an MJCF, a GLB, an OBJ, an STL and a PLY match themselves."""
    root = Path(shutil.copytree(imported[0], tmp_path / "root"))
    models.write_ycb(tmp_path / "ycb")
    run(tmp_path / "ycb", root, "ycb")
    library = Library(root)
    assert len(library.everyday_assets()) == 7
    recipe = Recipe(seed=1, objects=7, distractors=0, tilt=40, width=480, height=360)
    request, names = request_of(recipe, library, ocr=False)
    found = match_by_features(request, library).matches
    told = {name: found[number].asset for number, name in names.items()}
    assert len(told) == 7
    assert sum(name == asset for name, asset in told.items()) >= 6, told


def test_units_up_axes_and_sizes_are_metric(imported: tuple[Path, dict[str, tuple[ImportOutcome, bool]]]) -> None:
    library = Library(imported[0])
    sizes = {asset.kind: asset.size for asset in library.assets()}
    assert sizes["tin"] == pytest.approx((0.066, 0.066, 0.08), abs=1e-3)  # millimetres
    assert sizes["crate"] == pytest.approx((0.06, 0.10, 0.16), abs=1e-4)  # glTF has y up
    assert sizes["can"] == pytest.approx((0.066, 0.066, 0.084), abs=1e-4)
    assert sizes["bowl"] == pytest.approx((0.16, 0.16, 0.06), abs=2e-3)


def test_physics_tell_where_they_come_from(imported: tuple[Path, dict[str, tuple[ImportOutcome, bool]]]) -> None:
    physics = {asset.kind: asset.physics_or_defaults() for asset in Library(imported[0]).assets()}
    assert physics["block"].mass.value == 0.4
    assert physics["block"].mass.provenance == "catalogue"
    assert physics["block"].friction.value == 0.9
    assert physics["bowl"].mass.provenance == "estimate"
    assert physics["crate"].mass.provenance == "default"
    assert physics["crate"].mass.deviation > physics["bowl"].mass.deviation > physics["block"].mass.deviation


def test_a_bowl_is_hollow_and_a_box_is_not(imported: tuple[Path, dict[str, tuple[ImportOutcome, bool]]]) -> None:
    hollow = {asset.kind for asset in Library(imported[0]).assets() if asset.hollow}
    assert hollow == {"bowl"}


def test_colours_come_from_textures_and_materials(imported: tuple[Path, dict[str, tuple[ImportOutcome, bool]]]) -> None:
    colors = {asset.kind: asset.color for asset in Library(imported[0]).assets()}
    assert colors["crate"] == "green" and colors["block"] == "yellow" and colors["carton"] in ("red", "blue")


def test_a_second_import_goes_on_where_the_first_ended(tmp_path: Path) -> None:
    source, root = tmp_path / "source", tmp_path / "root"
    models.textured_box(source, "one", (0.05, 0.06, 0.07))
    models.picture(source / "texture_map.png")
    assert not run(source, root)["one"][1]
    journal = Journal(root, "mine").path
    journal.write_bytes(journal.read_bytes() + b'{"item": "two", "sour')  # stopped while it wrote
    models.textured_box(source, "two", (0.04, 0.06, 0.12))
    told = run(source, root)
    assert told["one"][1] and not told["two"][1]
    (root / "mine" / "meshes" / "one.obj").unlink()
    told = run(source, root)
    assert not told["one"][1] and told["two"][1]
    assert [asset.kind for asset in Library(root).assets()] == ["one", "two"]
    models.picture(source / "texture_map.png", models.BLUE, models.BLUE)
    assert not any(old for _, old in run(source, root).values())


def test_the_same_shape_is_a_copy_only_with_the_same_look(tmp_path: Path) -> None:
    source = tmp_path / "source"
    for name in ("first", "second", "third"):
        models.textured_box(source / name, name, (0.05, 0.06, 0.07), f"{name}.png")
    models.picture(source / "first" / "first.png")
    models.picture(source / "second" / "second.png", (222, 31, 29), (31, 60, 201))
    models.picture(source / "third" / "third.png", (20, 200, 40), (20, 200, 40))
    told = run(source, tmp_path / "root")
    assert told["second"][0].status == "duplicate" and "shape and look" in told["second"][0].reason
    assert told["third"][0].status == "imported" and "has the shape of mine/first.urdf" in told["third"][0].notes[-1]
    assert not (tmp_path / "root" / "mine" / "second.urdf").exists()


def test_known_layouts_are_read_as_what_they_are(tmp_path: Path) -> None:
    source, root = tmp_path / "source", tmp_path / "root"
    models.write_ycb(source / "ycb")
    models.write_gso(source / "gso")
    models.write_hope(source / "hope")
    told = run(source, root)
    assert set(told) == {"006_mustard_bottle", "Red_Block_Toy", "milk", "bbq_sauce", "cookies"}
    assets = {asset.kind: asset for asset in Library(root).assets()}
    mustard, block, milk = assets["006_mustard_bottle"], assets["Red_Block_Toy"], assets["milk"]
    assert mustard.mass == 0.603 and mustard.physics_or_defaults().mass.provenance == "measured"
    assert block.color == "red" and block.origin is not None and block.origin.license == "CC-BY-4.0"
    assert milk.size == pytest.approx((0.072, 0.073, 0.19), abs=1e-4)
    assert milk.origin is not None and milk.origin.license == "CC-BY-NC-SA-4.0"
    assert assets["bbq_sauce"].size[2] == pytest.approx(0.148, abs=1e-4)  # z is up in this one
    assert assets["cookies"].size == pytest.approx((0.123, 0.04, 0.167), abs=1e-4)
    for asset in assets.values():
        assert run_drop_test(
            build_asset_colliders(Library(root), Library(root).load_object_model(asset.name)), asset.mass, 0.6
        ).is_stable


def test_a_dae_says_its_unit_and_what_is_up(tmp_path: Path) -> None:
    towers = {
        "Y_UP": ("0.01", (0.06, 0.20, 0.08)),
        "Z_UP": ("0.001", (0.06, 0.08, 0.21)),
        "X_UP": ("1", (0.22, 0.06, 0.08)),
    }
    for up, (meter, size) in towers.items():
        x, y, z = (extent / float(meter) for extent in size)
        models.write_dae(tmp_path / "source" / f"{up}.dae", (x, y, z), meter, up)
    told = run(tmp_path / "source", tmp_path / "root")
    assert len(told) == 3
    for up, (_, size) in towers.items():
        asset = told[up][0].asset
        assert asset is not None, told[up][0].reason
        assert (asset.size[2], asset.color) == (pytest.approx(max(size), abs=1e-4), "red")
        assert sorted(asset.size) == pytest.approx(sorted(size), abs=1e-4)
        assert not told[up][0].notes


def test_with_the_real_packages_a_fine_bowl_is_made_simpler_and_stays_hollow(
    imported: tuple[Path, dict[str, tuple[ImportOutcome, bool]]],
) -> None:
    outcome = imported[1]["bowl"][0]
    assert outcome.asset is not None and outcome.asset.hollow, outcome.reason
    assert any("faces became" in note for note in outcome.notes)
    model = Library(imported[0]).load_object_model(outcome.asset.name)
    assert 4 <= len(model.colliders) <= 16


def test_malformed_files_are_refused_by_name_and_the_rest_goes_on(tmp_path: Path) -> None:
    source, root = tmp_path / "source", tmp_path / "root"
    reasons = models.write_malformed(source)
    models.textured_box(source / "good", "good", (0.05, 0.06, 0.07))
    models.picture(source / "good" / "texture_map.png")
    told = {outcome.source: outcome for outcome, _ in run(source, root).values()}
    assert told.pop("good/good.obj").status == "imported"
    assert set(reasons) <= set(told)
    for name, reason in reasons.items():
        assert told[name].status == "refused", name
        assert reason in told[name].reason, told[name].reason
    assert [asset.kind for asset in Library(root).assets()] == ["good"]


def test_empty_members_of_an_archive_are_passed_over(tmp_path: Path) -> None:
    models.textured_box(tmp_path / "home", "crate", (0.05, 0.06, 0.07))
    models.picture(tmp_path / "home" / "texture_map.png")
    files = {file.name: file.read_bytes() for file in (tmp_path / "home").iterdir()}
    models.zipped(tmp_path / "many.zip", files | {f"{number}/a.obj": b"" for number in range(MOST_ITEMS + 1)})
    told = run(tmp_path / "many.zip", tmp_path / "root")
    assert {name: outcome.status for name, (outcome, _) in told.items()} == {"crate": "imported"}


def test_the_assets_of_a_source_are_bounded(tmp_path: Path) -> None:
    models.zipped(tmp_path / "many.zip", {f"{number}.obj": b"v" for number in range(MOST_ITEMS + 1)})
    with pytest.raises(InputError, match="holds 5001 assets; an import takes at most 5000; import it in parts"):
        run(tmp_path / "many.zip", tmp_path / "root")


def test_descriptions_that_all_name_the_same_files_are_bounded(tmp_path: Path) -> None:
    text = b'<robot><mesh filename="a.obj"/></robot>'
    count = 2_300
    files = {f"{number}/{name}": data for number in range(count) for name, data in (("a.obj", b"v"), ("b.urdf", text))}
    models.zipped(tmp_path / "many.zip", files)
    with pytest.raises(InputError, match="too many of the same name"):
        run(tmp_path / "many.zip", tmp_path / "root")


def test_the_work_of_a_source_is_bounded_and_goes_on_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("first", "second"):
        models.textured_box(tmp_path / "source" / name, name, (0.05, 0.06, 0.07 if name == "first" else 0.12))
        models.picture(tmp_path / "source" / name / "texture_map.png")
    monkeypatch.setattr(importer, "_BASE_SECONDS", 0.0)
    monkeypatch.setattr(importer, "_SECONDS_A_MEGABYTE", 0.0)
    told = run(tmp_path / "source", tmp_path / "root")
    assert told["first"][0].status == "imported" and told["second"][0].status == "refused"
    assert "of at most 0 s; the same command goes on" in told["second"][0].reason
    told = run(tmp_path / "source", tmp_path / "root")
    assert told["second"][0].status == "refused"  # the first took a moment to be known
    monkeypatch.undo()
    told = run(tmp_path / "source", tmp_path / "root")
    assert told["first"][1] and told["second"][0].status == "imported"


def test_a_bomb_among_archives_is_refused_and_the_others_are_unpacked(tmp_path: Path) -> None:
    source, home = tmp_path / "source", tmp_path / "home"
    models.textured_box(home, "crate", (0.05, 0.06, 0.07))
    models.picture(home / "texture_map.png")
    source.mkdir()
    models.zipped(source / "good.zip", {file.name: file.read_bytes() for file in home.iterdir()})
    models.zip_bomb(source / "bomb.zip")
    models.zipped(source / "slip.zip", {"../../outside.obj": b"v 0 0 0\n"})
    (source / "noise.zip").write_bytes(b"PK nothing")
    told = {name: outcome for name, (outcome, _) in run(source, tmp_path / "root").items()}
    assert told["crate"].status == "imported"
    assert "unpacks to more than" in told["bomb.zip"].reason
    assert "leaves the folder" in told["slip.zip"].reason
    assert told["noise.zip"].status == "refused"
    assert not (tmp_path.parent / "outside.obj").exists()
