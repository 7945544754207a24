"""Objects are told apart, and stand as the photo shows them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np
import pytest

from grs_agents.agents.types import Description
from grs_agents.graph.placement import SettledScene, place_asset_or_proxy, register_objects, settle_scene
from grs_agents.graph.services import Photo, Services
from grs_agents.graph.state import TableObject
from grs_agents.library.library import Library
from grs_agents.perception.coverage import raised_pixel_mask
from grs_agents.perception.picture_files import load_mask, save_candidates, save_frame
from grs_agents.perception.registration.unexplained_segments import add_residual_candidates
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.types import Mask, MatchEvidence, UprightBox
from grs_agents.toolkit import ToolContext, load_tool
from tests.perception.settling.photo import BLOCK, LIBRARY, MILK, photo_of, standing

SPAGHETTI = "HOPE/Spaghetti.urdf"
WORDS = Description(is_object=True, description="a thing", color="red", shape="box", category="thing")
STANDS, BESIDE = standing(MILK, 0.55, 0.0), standing(BLOCK, 0.47, 0.06)


@dataclass(frozen=True)
class OfRun:
    """As much of the services as standing uses."""

    folder: Path

    @property
    def config(self) -> SimpleNamespace:
        """What is configured of it."""
        return SimpleNamespace(
            match=SimpleNamespace(proxies=True),
            tools=SimpleNamespace(shape="shape_seen"),
            shape=SimpleNamespace(model=None),
        )

    def run_tool(self, name: str, **request: Any) -> Any:
        """What a tool answers."""
        tool = load_tool(name)
        return tool.run(tool.Request(**request), cast(ToolContext, None))

    @property
    def library(self) -> Library:
        """The shipped assets, with the proxies of the run."""
        return LIBRARY.copy_with_overlay_root(self.folder / "assets") if (self.folder / "assets").is_dir() else LIBRARY


@dataclass(frozen=True)
class Seen:
    """A carton, whose upper half is a segment of its own, and a block in a photo, and what a run knows of them."""

    services: Services
    photo: Photo
    lower: TableObject
    upper: TableObject
    block: TableObject

    def thing(self, record: TableObject, asset: str | None, taken: list[str]) -> TableObject:
        """An object with an asset, or with a proxy."""
        reply = MatchEvidence(match="asset" if asset else "no_asset", asset=asset, confidence=0.99)
        return place_asset_or_proxy(
            record.model_copy(update={"description": WORDS, "match": reply}), self.services, taken
        )

    def masks(self, objects: Sequence[TableObject]) -> dict[int, Mask]:
        """The pixels of each."""
        return {item.id: load_mask(self.services.folder / item.mask) for item in objects}


@pytest.fixture
def seen(tmp_path: Path) -> Seen:
    frame, table, mask = photo_of([STANDS, BESIDE], LIBRARY)
    block = photo_of([BESIDE], LIBRARY)[2] & mask
    rows = np.arange(mask.shape[0])[:, None]
    upper = mask & ~block & (rows < np.median(np.nonzero(mask & ~block)[0]))
    labels = mask.astype("int32") + upper + 2 * block
    save_frame(frame, tmp_path)
    low, high, stone = map(
        TableObject.from_record, save_candidates(frame, measure_candidates(frame, table, labels), tmp_path)
    )
    return Seen(cast(Services, OfRun(tmp_path)), (frame, table), low, high, stone)


def stood(seen: Seen, objects: list[TableObject]) -> SettledScene:
    return settle_scene(objects, seen.masks(objects), seen.photo, raised_pixel_mask(*seen.photo), seen.services)


def test_a_piece_of_a_known_thing_is_dropped_and_the_others_stand(seen: Seen) -> None:
    known = seen.thing(seen.lower, MILK, [])
    (known,) = register_objects([known], seen.masks([known]), seen.photo, seen.services)
    others = [seen.thing(seen.upper, None, []), seen.thing(seen.block, None, ["red_thing_1"])]
    found = stood(seen, [known, *others])
    assert [one.name for one in found.objects] == [known.scene_object.name, others[1].scene_object.name]
    (gone,) = found.dropped
    assert gone.id == seen.upper.id and known.scene_object.name in gone.reason
    assert found.twin is not None and found.twin.fidelity is not None and found.twin.fidelity > 0.8
    assert not found.warnings


def test_an_asset_that_can_only_be_where_another_stands_gives_way_to_a_proxy(seen: Seen) -> None:
    first, second = (seen.thing(seen.lower, MILK, taken) for taken in ([], ["milk_1"]))
    at = {"position": STANDS.pose[0], "orientation": STANDS.pose[1], "method": "registered", "residual": 0.001}
    first, second = first.place(**at), second.place(**at)
    second = second.model_copy(update={"id": seen.upper.id, "mask": seen.upper.mask})
    second = second.place(id=seen.upper.id, mask=seen.upper.mask)
    found = stood(seen, [first, second])
    assert sum(one.matched for one in found.objects) == 1
    assert len(found.objects) + len(found.dropped) == 2


@pytest.mark.parametrize("given", [False, True])
def test_no_task_is_sure_of_an_object_seen_too_sparsely_unless_the_user_gave_its_mask(seen: Seen, given: bool) -> None:
    file = seen.services.folder / seen.block.mask
    mask = load_mask(file)
    cv2.imwrite(str(file), (mask & (np.cumsum(mask.ravel()).reshape(mask.shape) <= 90)).astype(np.uint8) * 255)
    block = seen.block.model_copy(update={"given": given})
    carton, found = stood(seen, [seen.thing(seen.lower, None, []), seen.thing(block, None, ["red_thing_1"])]).objects
    assert not carton.is_doubtful
    assert found.is_doubtful != given


def test_what_falls_off_another_thing_is_held(tmp_path: Path) -> None:
    """A long box that only just lies on a carton, with nothing but air below the rest of it."""
    carton, beam = standing(MILK, 0.5, -0.09), standing(SPAGHETTI, 0.5, 0.03, above=0.19)
    frame, table, mask = photo_of([carton, beam], LIBRARY)
    upper = photo_of([beam], LIBRARY)[2] & mask
    save_frame(frame, tmp_path)
    saved = save_candidates(frame, measure_candidates(frame, table, mask.astype("int32") + upper), tmp_path)
    low, high = map(TableObject.from_record, saved)
    high = high.model_copy(update={"upright": UprightBox(center=beam.pose[0], size=(0.029, 0.25, 0.05), yaw=0.0)})
    seen = Seen(cast(Services, OfRun(tmp_path)), (frame, table), low, high, high)
    things = [seen.thing(low, None, []), seen.thing(high, None, ["red_thing_1"])]
    found = settle_scene(things, seen.masks(things), seen.photo, raised_pixel_mask(*seen.photo), seen.services)
    assert not found.dropped
    assert [one.held for one in found.objects] == [False, True]
    assert all(one.drift is not None and one.drift < 0.01 for one in found.objects)


def test_a_segment_that_joins_a_known_thing_and_another_is_looked_at_again(seen: Seen) -> None:
    milk = seen.thing(seen.lower, MILK, [])
    (known,) = register_objects([milk], seen.masks([milk]), seen.photo, seen.services)
    both = seen.services.folder / seen.upper.mask
    joined = load_mask(both) | load_mask(seen.services.folder / seen.block.mask)
    cv2.imwrite(str(both), joined.astype(np.uint8) * 255)
    objects = [known, seen.thing(seen.upper, None, [])]
    later, divided = add_residual_candidates(
        [item.scene_object for item in objects],
        objects,
        seen.masks(objects),
        *seen.photo,
        seen.services.library,
        seen.services.folder,
    )
    assert [one.id for one in divided] == [seen.upper.id]
    (found,) = later
    assert (load_mask(seen.services.folder / found.mask) & load_mask(seen.services.folder / seen.block.mask)).any()
