"""From a candidate and the agents' words to an object of the scene."""

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from grs_agents.graph.placement import explain_why_no_scene_object, place_asset_or_proxy
from grs_agents.graph.services import Services
from grs_agents.graph.state import TableObject
from grs_agents.library.library import Library
from grs_agents.perception.types import MatchEvidence

RECORD = TableObject.model_validate(
    {
        "id": 4,
        "mask": "scene/mask_04.png",
        "crop": "scene/crop_04.png",
        "box": {"low": (0.45, 0.05, 0.0), "high": (0.55, 0.15, 0.19)},
        "upright": {"center": (0.5, 0.1, 0.095), "size": (0.073, 0.072, 0.19), "yaw": 0.3},
        "color": (0.9, 0.9, 1.0),
        "shape": "box",
        "points": 900,
        "description": {
            "is_object": True,
            "description": "a white carton",
            "color": "white",
            "shape": "box",
            "category": "carton",
        },
    }
)


def with_match(match: MatchEvidence | None) -> TableObject:
    """The carton, matched."""
    return RECORD.model_copy(update={"match": match})


@pytest.fixture
def services(tmp_path: Path) -> Services:
    """As much of the services as matching uses."""
    return cast(Services, SimpleNamespace(folder=tmp_path, library=Library()))


def test_a_match_stands_where_the_photo_shows_it(services: Services) -> None:
    reply = MatchEvidence(match="asset", asset="HOPE/Milk.urdf", reason="size and colour", confidence=0.9)
    found = place_asset_or_proxy(with_match(reply), services, []).scene_object
    assert (found.name, found.asset, found.matched, found.reachable) == ("milk_1", "HOPE/Milk.urdf", True, True)
    assert found.position == pytest.approx((0.5, 0.1, 0.095), abs=0.002)
    assert found.evidence == "size and colour"
    assert found.match == reply


def test_what_nothing_matches_becomes_a_proxy(services: Services) -> None:
    reply = MatchEvidence(match="no_asset", reason="nothing alike")
    found = place_asset_or_proxy(with_match(reply), services, ["white_carton_1"]).scene_object
    assert (found.name, found.asset, found.matched) == ("white_carton_2", "proxy/white_carton_2.urdf", False)
    assert found.size == pytest.approx((0.073, 0.072, 0.19))
    library = Library().copy_with_overlay_root(services.folder / "assets")
    assert library.asset(found.asset).description == "a white carton"


def test_what_is_no_object_is_dropped_with_a_reason() -> None:
    glare = RECORD.described.model_copy(update={"is_object": False, "description": "a glare"})
    assert "glare" in explain_why_no_scene_object(RECORD.model_copy(update={"description": glare}))
    assert "shadow" in explain_why_no_scene_object(with_match(MatchEvidence(match="no_object", reason="a shadow")))
    lacking = with_match(MatchEvidence(match="no_asset"))
    assert explain_why_no_scene_object(lacking) == ""
    assert "match.proxies" in explain_why_no_scene_object(lacking, proxies=False)
