"""An asset of another size than was measured gives way to a proxy, and the evaluation of placement tells so."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from grs_agents.agents.types import Description
from grs_agents.base import content
from grs_agents.base.errors import InputError
from grs_agents.graph.placement import place_asset_or_proxy, replace_misfit_assets
from grs_agents.graph.services import Services
from grs_agents.graph.state import TableObject
from grs_agents.library.asset_rendering import render_asset_views
from grs_agents.library.library import Library
from grs_agents.perception.picture_files import load_mask, save_candidates, save_frame
from grs_agents.perception.proxies.proxy import write_scaled_asset
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.settling.settling import PlacedObject
from grs_agents.perception.types import (
    DroppedCandidate,
    MatchEvidence,
    RGBDFrame,
    SceneDescription,
    TableFrame,
)
from tests.perception.settling.photo import photo_of

WORDS = Description(is_object=True, description="a carton", color="white", shape="box", category="carton")
Photo = tuple[RGBDFrame, TableFrame]


def services_in(folder: Path, proxies: bool = True) -> Services:
    """As much of the services as matching uses."""

    class Some(SimpleNamespace):
        @property
        def library(self) -> Library:
            """The shipped assets and those of the run."""
            own = folder / "assets"
            return Library().copy_with_overlay_root(own) if own.is_dir() else Library()

    return cast(Services, Some(folder=folder, config=SimpleNamespace(match=SimpleNamespace(proxies=proxies))))


def replace_misfits(
    objects: list[TableObject], taken: list[str], photo: Photo, services: Services
) -> tuple[list[TableObject], list[DroppedCandidate], list[str]]:
    masks = {item.id: load_mask(services.folder / item.mask) for item in objects}
    return replace_misfit_assets(objects, taken, masks, photo, services)


@pytest.fixture
def seen(tmp_path: Path) -> tuple[Photo, TableObject]:
    """A milk carton in a photo."""
    milk = PlacedObject("HOPE/Milk.urdf", ((0.5, 0.0, 0.096), (0.0, 0.0, 0.0, 1.0)))
    frame, table, mask = photo_of([milk], Library())
    save_frame(frame, tmp_path)
    (record,) = save_candidates(frame, measure_candidates(frame, table, mask.astype("int32")), tmp_path)
    return (frame, table), TableObject.from_record(record).model_copy(update={"description": WORDS})


def matched(asset: str, record: TableObject, services: Services, method: str = "match_features") -> TableObject:
    reply = MatchEvidence(
        match="asset", asset=asset, method=method, reason="white", scores={asset: 0.8}, confidence=0.8
    )
    return place_asset_or_proxy(record.model_copy(update={"match": reply}), services, [])


def test_what_is_of_its_size_stays(seen: tuple[Photo, TableObject], tmp_path: Path) -> None:
    photo, record = seen
    one = matched("HOPE/Milk.urdf", record, services_in(tmp_path))
    assert replace_misfits([one], [], photo, services_in(tmp_path)) == ([one], [], [])


def test_what_is_not_of_its_size_gives_way_to_a_proxy(seen: tuple[Photo, TableObject], tmp_path: Path) -> None:
    photo, record = seen
    one = matched("HOPE/Butter.urdf", record, services_in(tmp_path))
    other = one.place(matched=False, name="white_carton_1")
    (replaced, kept), lost, notes = replace_misfits([one, other], ["x"], photo, services_in(tmp_path))
    assert kept == other and not lost and not notes
    found = replaced.scene_object
    assert (found.name, found.asset, found.matched) == ("white_carton_2", "proxy/white_carton_2.urdf", False)
    assert found.match is not None and found.match.runner_up == "HOPE/Butter.urdf" and found.match.asset is None
    assert "HOPE/Butter.urdf was matched" in found.evidence and "% off" in found.evidence
    assert found.match.scores == {"HOPE/Butter.urdf": 0.8}
    (_,), lost, _ = replace_misfits([other], [], photo, services_in(tmp_path, proxies=False))
    _, (dropped,), _ = replace_misfits([one], [], photo, services_in(tmp_path, proxies=False))
    assert not lost and "match.proxies" in dropped.reason


def test_what_is_certain_may_be_larger_than_what_is_seen(seen: tuple[Photo, TableObject], tmp_path: Path) -> None:
    photo, record = seen
    half = record.upright.model_copy(update={"size": (*record.upright.size[:2], record.upright.size[2] / 2)})
    one = matched("HOPE/Milk.urdf", record, services_in(tmp_path)).place(upright=half)
    sure = MatchEvidence(match="asset", asset=one.scene_object.asset, confidence=0.99)
    known = one.place(match=sure, method="registered", residual=0.001)
    for other in (
        one,
        known.place(residual=0.004),
        known.place(match=sure.model_copy(update={"confidence": 0.6})),
        known.place(match=sure.model_copy(update={"confidence": None})),
    ):
        ((found,), _, _) = replace_misfits([other], [], photo, services_in(tmp_path))
        assert not found.scene_object.matched
    assert replace_misfits([known], [], photo, services_in(tmp_path)) == ([known], [], [])


def test_what_a_model_recognised_keeps_its_name_where_the_asset_has_another_size(
    seen: tuple[Photo, TableObject], tmp_path: Path
) -> None:
    photo, record = seen
    services = services_in(tmp_path)
    one = matched("HOPE/Butter.urdf", record, services, "match_hybrid")
    (replaced,), lost, (note,) = replace_misfits([one], [], photo, services)
    found = replaced.scene_object
    assert (found.name, found.asset, found.matched) == ("butter_1", "proxy/butter_1.urdf", False) and not lost
    assert (found.category, found.description) == ("carton", "a carton")
    assert note.startswith("butter_1: HOPE/Butter.urdf is not of the measured size") and "as seen" in note


def test_a_recognised_asset_is_scaled_where_it_is_only_larger(seen: tuple[Photo, TableObject], tmp_path: Path) -> None:
    photo, record = seen
    library = Library()
    milk = library.asset("HOPE/Milk.urdf")
    small = write_scaled_asset(tmp_path / "assets", "small", milk.name, library, 1 / 1.5)
    services = services_in(tmp_path)
    (kept,), lost, (note,) = replace_misfits(
        [matched(small.name, record, services, "match_hybrid")], [], photo, services
    )
    found = kept.scene_object
    assert (found.name, found.asset, found.matched) == ("milk_1", "scaled/milk_1.urdf", True) and not lost
    assert found.size == pytest.approx(milk.size, abs=0.015)
    copy = services.library.asset(found.asset)
    assert (copy.kind, copy.category, copy.everyday) == ("Milk", milk.category, False)
    assert copy.mass == pytest.approx(milk.mass, rel=0.25)
    (view,) = render_asset_views(services.library, found.asset, [(1.0, 0.0, 0.0)], size=64)
    (known,) = render_asset_views(library, milk.name, [(1.0, 0.0, 0.0)], size=64)
    assert np.abs(view.rgba.astype(float) - known.rgba).mean() < 2
    assert "scaled by 1.4" in note and "scaled by 1.4" in found.evidence
    by_features = matched(small.name, record, services)
    ((replaced,), _, notes) = replace_misfits([by_features], [], photo, services)
    assert not replaced.scene_object.matched and not notes


def test_the_evaluation_of_placement_names_what_is_off(
    seen: tuple[Photo, TableObject], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photo, record = seen
    main, out = content.load_module("evals", "placement").main, ("--out", str(tmp_path / "out"))
    with pytest.raises(InputError, match=r"no scene\.json"):
        main([str(tmp_path / "scene"), *out])
    objects = [
        matched(asset, record, services_in(tmp_path)).scene_object for asset in ("HOPE/Milk.urdf", "HOPE/Butter.urdf")
    ]
    told = SceneDescription(source="s", image="i", frame=photo[1], objects=tuple(objects))
    told.write(tmp_path / "run" / "scene.json")
    assert main([str(tmp_path), *out, "--json"]) == 1
    figures = json.loads(capsys.readouterr().out)
    assert (figures["objects"], [one["asset"] for one in figures["off"]]) == (2, ["HOPE/Butter.urdf"])
    told.model_copy(update={"objects": tuple(objects[:1])}).write(tmp_path / "run" / "scene.json")
    assert main([str(tmp_path), *out]) == 0
    assert "1 of 1 objects" in capsys.readouterr().out
    sure = MatchEvidence(match="asset", asset=objects[1].asset, confidence=0.99)
    known = objects[1].model_copy(update={"match": sure, "method": "registered", "residual": 0.001})
    told.model_copy(update={"objects": (known,)}).write(tmp_path / "run" / "scene.json")
    assert main([str(tmp_path), *out]) == 0
    assert "1 of them a certain asset" in capsys.readouterr().out
