"""The texture of the table is the photo of it, seen straight from above."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from grs_agents.library.asset_rendering import Lens
from grs_agents.library.library import Library
from grs_agents.perception.table_appearance import write_table_texture
from grs_agents.perception.table_finding import find_table, robot_frame_point_map
from grs_agents.perception.types import RGBDFrame, TableFrame
from grs_agents.sim.instance.task_instance import InstanceTable
from grs_agents.sim.rendering.pictures import render_from_camera
from grs_agents.sim.rendering.stage import Props
from grs_agents.sim.world.appearance import TABLE_CENTER, TABLE_SIDE
from tests.perception.conftest import Rendered

LIGHT, DARK = 190, 120


@pytest.fixture(scope="module")
def photo(rendered: Rendered) -> tuple[RGBDFrame, TableFrame]:
    """The rendered table with squares of 10 cm painted on it, red where x is large."""
    frame = rendered.frame
    table = find_table(frame, np.random.default_rng(0))
    x, y, _ = np.moveaxis(np.nan_to_num(robot_frame_point_map(frame, table)), -1, 0)
    squares = np.where((np.floor(x / 0.1) + np.floor(y / 0.1)) % 2, LIGHT, DARK)
    picture = np.stack([np.where(x > np.median(x), squares, 40), squares, squares // 2], axis=-1)
    picture[rendered.labels > 0] = (255, 0, 255)
    return replace(frame, rgb=picture.astype(np.uint8)), table


def write(photo: tuple[RGBDFrame, TableFrame], objects: npt.NDArray[np.bool_], folder: Path) -> npt.NDArray[np.uint8]:
    """The texture (H, W, 3), red, green, blue."""
    name = write_table_texture(*photo, objects, folder)
    assert name is not None
    picture = cv2.imread(str(folder / name))
    assert picture is not None
    return np.asarray(picture[:, :, ::-1], np.uint8)


def test_the_pattern_of_the_table_lies_where_it_is(
    rendered: Rendered, photo: tuple[RGBDFrame, TableFrame], tmp_path: Path
) -> None:
    texture = write(photo, rendered.labels > 0, tmp_path)
    frame, table = photo
    points = robot_frame_point_map(frame, table)[40:-40:7, 40:-40:7].reshape(-1, 3)
    colors = frame.rgb[40:-40:7, 40:-40:7].reshape(-1, 3).astype(float)
    flat = (np.abs(points[:, 2]) < 0.003) & (colors[:, 2] < 200)
    columns, rows = ((points[flat, :2] - TABLE_CENTER) / TABLE_SIDE * (1, -1) + 0.5).T * len(texture)
    inside = (columns > 0) & (columns < len(texture)) & (rows > 0) & (rows < len(texture))
    found = texture[rows[inside].astype(int), columns[inside].astype(int)].astype(float)
    assert np.median(np.abs(found - colors[flat][inside])) < 10


def test_nothing_of_objects_is_in_it_and_far_away_it_has_the_colour_of_the_table(
    rendered: Rendered, photo: tuple[RGBDFrame, TableFrame], tmp_path: Path
) -> None:
    texture = write(photo, rendered.labels > 0, tmp_path).astype(int)
    assert texture.shape == (1024, 1024, 3)
    assert (texture[..., 2] <= texture[..., 1] + 20).all()  # magenta objects have more blue than green
    corners = texture[[0, 0, -1, -1], [0, -1, 0, -1]]
    assert (corners == corners[0]).all() and abs(corners[0, 1] - (LIGHT + DARK) / 2) < 40


def test_the_twin_shows_it_as_the_photo_does(
    rendered: Rendered, photo: tuple[RGBDFrame, TableFrame], tmp_path: Path
) -> None:
    frame, table = photo
    name = write_table_texture(frame, table, rendered.labels > 0, tmp_path)
    lens = Lens(*(getattr(frame.camera, key) for key in ("fx", "fy", "cx", "cy", "width", "height")))
    props = Props((), table=InstanceTable(texture=name))
    drawn = render_from_camera(props, Library(*Library().roots, tmp_path), lens, np.asarray(table.T_robot_cam))
    shown = rendered.labels == 0
    green = np.stack([image[shown][:, 1].astype(float) for image in (frame.rgb, drawn.color)])
    assert np.corrcoef(green)[0, 1] > 0.8


def test_a_table_that_is_hardly_seen_has_none(
    rendered: Rendered, photo: tuple[RGBDFrame, TableFrame], tmp_path: Path
) -> None:
    assert write_table_texture(*photo, np.ones_like(rendered.labels, np.bool_), tmp_path) is None
    assert not list(tmp_path.iterdir())
