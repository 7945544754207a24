"""An asset of another size than was measured gives way to a proxy, and the evaluation of placement tells so."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from grs_agents.agents.types import Description
from grs_agents.base import content
from grs_agents.base.errors import InputError
from grs_agents.graph.placement import place_asset_or_proxy, replace_misfit_assets
from grs_agents.graph.services import Services
from grs_agents.graph.state import TableObject
from grs_agents.library.library import Library
from grs_agents.perception.picture_files import save_candidates, save_frame
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.settling.settling import PlacedObject
from grs_agents.perception.types import (
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
    config = SimpleNamespace(match=SimpleNamespace(proxies=proxies))
    return cast(Services, SimpleNamespace(folder=folder, library=Library(), config=config))


@pytest.fixture
def seen(tmp_path: Path) -> tuple[Photo, TableObject]:
    """A milk carton in a photo."""
    milk = PlacedObject("HOPE/Milk.urdf", ((0.5, 0.0, 0.096), (0.0, 0.0, 0.0, 1.0)))
    frame, table, mask = photo_of([milk], Library())
    save_frame(frame, tmp_path)
    (record,) = save_candidates(frame, measure_candidates(frame, table, mask.astype("int32")), tmp_path)
    return (frame, table), TableObject.from_record(record).model_copy(update={"description": WORDS})


def matched(asset: str, record: TableObject, services: Services) -> TableObject:
    reply = MatchEvidence(match="asset", asset=asset, reason="white", scores={asset: 0.8}, confidence=0.8)
    return place_asset_or_proxy(record.model_copy(update={"match": reply}), services, [])


def test_what_is_of_its_size_stays(seen: tuple[Photo, TableObject], tmp_path: Path) -> None:
    _, record = seen
    one = matched("HOPE/Milk.urdf", record, services_in(tmp_path))
    assert replace_misfit_assets([one], [], services_in(tmp_path)) == ([one], [])


def test_what_is_not_of_its_size_gives_way_to_a_proxy(seen: tuple[Photo, TableObject], tmp_path: Path) -> None:
    _, record = seen
    one = matched("HOPE/Butter.urdf", record, services_in(tmp_path))
    other = one.place(matched=False, name="white_carton_1")
    (replaced, kept), lost = replace_misfit_assets([one, other], ["x"], services_in(tmp_path))
    assert kept == other and not lost
    found = replaced.scene_object
    assert (found.name, found.asset, found.matched) == ("white_carton_2", "proxy/white_carton_2.urdf", False)
    assert found.match is not None and found.match.runner_up == "HOPE/Butter.urdf" and found.match.asset is None
    assert "HOPE/Butter.urdf was matched" in found.evidence and "% off" in found.evidence
    assert found.match.scores == {"HOPE/Butter.urdf": 0.8}
    (_,), lost = replace_misfit_assets([one, other][1:], [], services_in(tmp_path, proxies=False))
    _, (dropped,) = replace_misfit_assets([one], [], services_in(tmp_path, proxies=False))
    assert not lost and "match.proxies" in dropped.reason


def test_what_is_certain_may_be_larger_than_what_is_seen(seen: tuple[Photo, TableObject], tmp_path: Path) -> None:
    _, record = seen
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
        ((found,), _) = replace_misfit_assets([other], [], services_in(tmp_path))
        assert not found.scene_object.matched
    assert replace_misfit_assets([known], [], services_in(tmp_path)) == ([known], [])


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
