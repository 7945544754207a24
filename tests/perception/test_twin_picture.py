"""The twin is drawn where its objects stand, from the photo's camera and from aside."""

import numpy as np
import pytest

from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.perception.twin_picture import draw_twin
from grs_agents.perception.types import Aabb, Intrinsics, SceneDescription, SceneObject, TableFrame

CAMERA = Intrinsics(fx=200, fy=200, cx=99.5, cy=74.5, width=200, height=150)
DOWN = ((1.0, 0.0, 0.0, 0.5), (0.0, -1.0, 0.0, 0.0), (0.0, 0.0, -1.0, 1.0), (0.0, 0.0, 0.0, 1.0))
"""A camera 1 m above (0.5, 0), looking straight down."""


def _object(number: int, asset: str, x: float, y: float) -> SceneObject:
    size = Library().asset(asset).size
    return SceneObject(
        id=number,
        name=f"thing_{number}",
        asset=asset,
        matched=True,
        description="",
        category="",
        color="",
        box=Aabb(low=(x, y, 0.0), high=(x, y, size[2])),
        position=(x, y, size[2] / 2),
        orientation=(0.0, 0.0, 0.0, 1.0),
        size=size,
        reachable=True,
        evidence="",
        mask="mask.png",
        crop="crop.png",
    )


def _scene(camera: Intrinsics | None = CAMERA) -> SceneDescription:
    return SceneDescription(
        source="",
        image="",
        frame=TableFrame(T_robot_cam=DOWN, origin="calibrated", residual=0.0, inliers=1.0),
        objects=(_object(3, "HOPE/Corn.urdf", 0.5, 0.1), _object(7, "block/red_block.urdf", 0.4, -0.1)),
        camera=camera,
        table_color=(0.2, 0.2, 0.6),
    )


def test_each_object_is_where_it_stands() -> None:
    picture = draw_twin(_scene(), Library())
    assert picture.color.shape == (150, 200, 3)
    assert set(np.unique(picture.owner)) == {-1, 3, 7}
    rows, columns = np.nonzero(picture.owner == 7)  # the cube: its top is 0.96 m away
    assert columns.mean() == pytest.approx(99.5 - 0.1 / 0.96 * 200, abs=0.5)
    assert rows.mean() == pytest.approx(74.5 + 0.1 / 0.96 * 200, abs=0.5)
    assert np.median(picture.depth[rows, columns]) == pytest.approx(0.96, abs=1e-3)
    red, green, blue = picture.color[rows, columns].mean(axis=0)
    assert red > 2 * max(green, blue)
    assert picture.color[5, 5, 2] > 1.5 * picture.color[5, 5, 0]  # the table is as blue as in the photo


def test_from_aside_the_sides_are_seen() -> None:
    straight, aside = draw_twin(_scene(), Library()), draw_twin(_scene(), Library(), np.deg2rad(40))
    assert set(np.unique(aside.owner)) == {-1, 3, 7}
    on_top = [np.isclose(one.depth[one.owner == 7], 0.96, atol=1e-4).mean() for one in (straight, aside)]
    assert on_top[0] > 0.7  # a level face looked at straight down
    assert on_top[1] < 0.1


def test_a_description_without_a_camera_is_refused() -> None:
    with pytest.raises(InputError, match="camera"):
        draw_twin(_scene(None), Library())
