"""What stands in the panes at the first moment, until there is what they are for: no pane is empty."""

from functools import lru_cache

import numpy as np
import numpy.typing as npt
import rerun as rr
from PIL import Image, ImageDraw, ImageFont

from grs_agents.sim.instance.task_instance import InstanceTable
from grs_agents.sim.world.appearance import TABLE_CENTER, TABLE_SIDE
from grs_agents.views.rerun.recording import Paths, Recording

NOT_YET = "*Not yet.*"
"""Stands in a document until there is one."""
_WORDS = NOT_YET.strip("*")
_SIZE = (640, 480)
"""Width and height of the pictures, pixels."""
_GROUND, _INK = 48, 170
_TABLE = ((0.5, 0.0, -0.011), (0.62, 1.1, 0.02))  # centre, size
_TOP = -0.0005
"""Height of the texture, m: above the box of the table, below the marks that lie on it."""
_ABOVE_TABLE = (0.45, 0.0, 0.1)
_PICTURES = (Paths.PHOTO, Paths.DEPTH, Paths.TWIN_PICTURE, Paths.COVERAGE, Paths.IMAGE)


def placeholder_path(path: str) -> str:
    """Where the words stand until there is something at ``path``: one path holds pictures of one kind and size."""
    return f"{path}/not_yet"


def log_placeholders(recording: Recording) -> None:
    """Say in every picture and in the worlds that there is nothing yet."""
    picture = rr.Image(_draw_placeholder())  # of encoded ones the viewer makes a film, from which nothing is cleared
    for path in _PICTURES:
        recording.log(placeholder_path(path), picture)
    lens = rr.Pinhole(
        focal_length=float(_SIZE[0]), resolution=_SIZE, camera_xyz=rr.ViewCoordinates.RDF, image_plane_distance=0.25
    )
    recording.log(Paths.CAMERA, lens)
    log_table_top(recording, InstanceTable())
    words = rr.Points3D([_ABOVE_TABLE], labels=[_WORDS], show_labels=True, radii=[0.001], colors=[(_INK,) * 3])
    recording.log(placeholder_path(Paths.WORLD), words)


def clear_placeholder(recording: Recording, path: str) -> None:
    """Take the words away: now there is something at ``path``."""
    recording.log(placeholder_path(path), rr.Clear(recursive=False))


def log_table_top(recording: Recording, looks: InstanceTable, texture: npt.NDArray[np.uint8] | None = None) -> None:
    """The table top in the world of the rollouts; ``texture`` (N, N, 3) covers all of the simulated one."""
    recording.log(Paths.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    (center, size), color = _TABLE, [round(255 * channel) for channel in looks.color]
    recording.log(f"{Paths.WORLD}/table", rr.Boxes3D(centers=[center], sizes=[size], colors=[color], fill_mode="solid"))
    if texture is None:
        return
    x, y = (center[0] - size[0] / 2, center[0] + size[0] / 2), (center[1] - size[1] / 2, center[1] + size[1] / 2)
    corners = np.array([(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])])
    low, high = ((np.array((x, y)).T - TABLE_CENTER) / TABLE_SIDE + 0.5) * len(texture)
    (left, bottom), (right, top) = np.rint(low).astype(int), np.rint(high).astype(int)
    shown = texture[len(texture) - top : len(texture) - bottom, left:right]
    cover = rr.Mesh3D(
        vertex_positions=np.column_stack([corners, np.full(4, _TOP)]),
        vertex_normals=np.tile((0.0, 0.0, 1.0), (4, 1)),
        vertex_texcoords=[(0, 1), (1, 1), (1, 0), (0, 0)],
        triangle_indices=[(0, 1, 2), (0, 2, 3)],
        albedo_texture=np.ascontiguousarray(shown),
    )
    recording.log(f"{Paths.WORLD}/table_top", cover)


@lru_cache(maxsize=1)
def _draw_placeholder() -> npt.NDArray[np.uint8]:
    """The words in the middle of a grey picture (H, W)."""
    image = Image.new("L", _SIZE, _GROUND)
    middle = (_SIZE[0] / 2, _SIZE[1] / 2)
    ImageDraw.Draw(image).text(middle, _WORDS, _INK, ImageFont.load_default(32), anchor="mm")
    return np.asarray(image)
