"""What lies on, in and against what."""

import numpy as np
import pytest

from grs_agents.base import Pose
from grs_agents.library.library import Library
from grs_agents.perception.settling.support_relations import body_from_asset, find_spatial_relations
from grs_agents.perception.types import SpatialRelation

LIBRARY = Library()
HERE = (0.0, 0.0, 0.0, 1.0)


def at(asset: str, x: float, y: float, bottom: float = 0.0) -> tuple[str, Pose]:
    """An upright asset by its place and the height of its bottom, m."""
    low, high = np.array(LIBRARY.load_object_model(asset).bounds)
    return asset, ((x, y, bottom + float(high[2] - low[2]) / 2), HERE)


def relations_of(*things: tuple[str, Pose]) -> tuple[SpatialRelation, ...]:
    """The relations of things called a, b, ..."""
    return find_spatial_relations(
        [body_from_asset(chr(97 + number), *thing, LIBRARY) for number, thing in enumerate(things)]
    )


MILK, TUNA, BLOCK, BOX = "HOPE/Milk.urdf", "HOPE/Tuna.urdf", "block/red_block.urdf", "container/open_box.urdf"


@pytest.mark.parametrize("swapped", [False, True])
def test_what_is_stacked_is_on(swapped: bool) -> None:
    height = float(np.ptp(np.array(LIBRARY.load_object_model(TUNA).bounds), axis=0)[2])
    things = [at(BLOCK, 0.5, 0.0, bottom=height), at(TUNA, 0.5, 0.0)]
    upper, lower = ("b", "a") if swapped else ("a", "b")
    found = relations_of(*(reversed(things) if swapped else things))
    assert found == (SpatialRelation(kind="on", subject=upper, reference=lower),)


def test_what_a_container_holds_is_in() -> None:
    found = relations_of(at(BLOCK, 0.5, 0.0, bottom=0.006), at(BOX, 0.5, 0.0))
    assert found == (SpatialRelation(kind="in", subject="a", reference="b"),)


def test_what_stands_side_by_side_touches_once() -> None:
    width = float(np.ptp(np.array(LIBRARY.load_object_model(BLOCK).bounds), axis=0)[0])
    found = relations_of(at(BLOCK, 0.5, 0.0), at(BLOCK, 0.5 + width, 0.0))
    assert found == (SpatialRelation(kind="touching", subject="a", reference="b"),)


def test_what_stands_apart_has_no_relation() -> None:
    assert relations_of(at(BLOCK, 0.4, 0.2), at(MILK, 0.6, -0.2), at(TUNA, 0.4, -0.1)) == ()
