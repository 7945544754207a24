"""An asset that is seen from one side is found where it stands."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grs_agents.base import Quat
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion, quaternion_from_rpy
from grs_agents.perception.asset_surfaces import find_asset_symmetry
from grs_agents.perception.proxies.proxy import primitive_proxy, write_proxy
from grs_agents.perception.registration.registration import register_asset
from grs_agents.perception.settling.settling import PlacedObject
from grs_agents.perception.types import Mask, UprightBox
from tests.perception.settling.photo import photo_of

LIBRARY = Library()


def box_around(asset: str, turn: Quat, yaw_error: float = 0.2) -> UprightBox:
    """A box as it would be measured badly: 12 mm off, and turned too far."""
    low, high = np.array(LIBRARY.load_object_model(asset).bounds)
    extents = np.abs(matrix_from_quaternion(turn)) @ (high - low)
    x, y, z = (float(value) for value in extents)
    return UprightBox(center=(0.512, 0.008, z / 2), size=(x, y, z), yaw=yaw_error)


@pytest.mark.parametrize(
    ("asset", "roll", "yaw"),
    [("HOPE/Milk.urdf", 0.0, 0.4), ("HOPE/Raisins.urdf", math.pi / 2, 0.1), ("HOPE/Ketchup.urdf", 0.0, -0.3)],
)
def test_an_asset_is_found_where_it_stands(asset: str, roll: float, yaw: float) -> None:
    turn = quaternion_from_rpy(roll, 0.0, yaw)
    middle = _resting(asset, turn)
    frame, table, mask = photo_of([PlacedObject(asset, (middle, turn))], LIBRARY)
    found = register_asset(asset, LIBRARY, box_around(asset, turn), frame, table, mask)
    assert found.method == "registered"
    assert np.linalg.norm(np.subtract(found.position, middle)) < 0.01
    assert (
        find_asset_symmetry(asset, LIBRARY).rotation_error_degrees(
            matrix_from_quaternion(found.orientation), matrix_from_quaternion(turn)
        )
        < 10
    )
    assert found.residual < 0.005


def test_the_yaw_of_a_round_thing_is_said_to_say_nothing() -> None:
    asset, turn = "HOPE/Tuna.urdf", quaternion_from_rpy(0.0, 0.0, 0.0)
    frame, table, mask = photo_of([PlacedObject(asset, (_resting(asset, turn), turn))], LIBRARY)
    assert register_asset(asset, LIBRARY, box_around(asset, turn), frame, table, mask).round


def test_what_is_hardly_seen_stays_in_its_box() -> None:
    asset, turn = "HOPE/Milk.urdf", quaternion_from_rpy(0.0, 0.0, 0.0)
    frame, table, _ = photo_of([PlacedObject(asset, (_resting(asset, turn), turn))], LIBRARY)
    nothing: Mask = np.zeros(frame.depth.shape, np.bool_)
    found = register_asset(asset, LIBRARY, box_around(asset, turn, 0.0), frame, table, nothing)
    assert found.method == "box"
    assert found.position[:2] == pytest.approx((0.512, 0.008))


def test_where_little_depth_was_measured_the_silhouette_tells_where_an_asset_stands() -> None:
    asset, turn = "HOPE/Corn.urdf", quaternion_from_rpy(0.0, 0.0, 0.3)
    middle = _resting(asset, turn)
    frame, table, mask = photo_of([PlacedObject(asset, (middle, turn))], LIBRARY)
    seen = np.argwhere(mask)
    apart = np.hypot(*(seen - seen.mean(axis=0)).T)
    depth = frame.depth.copy()
    depth[tuple(seen[apart > 0.17 * np.ptp(seen[:, 1])].T)] = 0
    found = register_asset(asset, LIBRARY, box_around(asset, turn), replace(frame, depth=depth), table, mask)
    assert np.linalg.norm(np.subtract(found.position, middle)) < 0.002


def test_another_asset_is_no_fit() -> None:
    milk, turn = "HOPE/Milk.urdf", quaternion_from_rpy(0.0, 0.0, 0.4)
    frame, table, mask = photo_of([PlacedObject(milk, (_resting(milk, turn), turn))], LIBRARY)
    right = register_asset(milk, LIBRARY, box_around(milk, turn), frame, table, mask)
    wrong = register_asset("HOPE/Tuna.urdf", LIBRARY, box_around(milk, turn), frame, table, mask)
    assert wrong.residual > 3 * right.residual


def test_a_taller_can_is_not_sunk_into_the_table_to_fit_a_lower_one(tmp_path: Path) -> None:
    for name, height in (("low", 0.05), ("tall", 0.07)):
        write_proxy(
            tmp_path,
            name,
            primitive_proxy("cylinder", (0.08, 0.08, height), (0.5, 0.5, 0.5)),
            f"a {name} can",
        )
    library = LIBRARY.copy_with_overlay_root(tmp_path)
    frame, table, mask = photo_of([PlacedObject("proxy/low.urdf", ((0.5, 0.0, 0.025), (0.0, 0.0, 0.0, 1.0)))], library)
    box = UprightBox(center=(0.504, 0.003, 0.025), size=(0.08, 0.08, 0.05), yaw=0.0)
    low, tall = (register_asset(f"proxy/{name}.urdf", library, box, frame, table, mask) for name in ("low", "tall"))
    assert tall.position[2] - tall.size[2] / 2 > -0.01
    assert tall.cost > low.cost + 0.008


def _resting(asset: str, turn: Quat) -> tuple[float, float, float]:
    low, high = np.array(LIBRARY.load_object_model(asset).bounds)
    return 0.5, 0.0, float((np.abs(matrix_from_quaternion(turn)) @ (high - low))[2]) / 2
