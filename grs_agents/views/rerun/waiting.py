"""Placeholders in the panes before their first content, and the table top of the rollout world."""

from functools import lru_cache

import numpy as np
import numpy.typing as npt
import rerun as rr
from PIL import Image, ImageDraw, ImageFont

from grs_agents.sim.instance.task_instance import InstanceTable
from grs_agents.sim.world.appearance import TABLE_CENTER, TABLE_SIDE
from grs_agents.views.rerun.recording import Paths, RerunRecording

NOT_YET = "*Not yet.*"
"""Placeholder of a document."""
_PLACEHOLDER_TEXT = NOT_YET.strip("*")
_SIZE = (640, 480)
"""Width and height of placeholder pictures, pixels."""
_GROUND, _INK = 48, 170
_TABLE = ((0.5, 0.0, -0.011), (0.62, 1.1, 0.02))  # centre, size
_TOP = -0.0005
"""Height of the texture, m: above the box of the table, below marks on the table."""
_ABOVE_TABLE = (0.45, 0.0, 0.1)
_PICTURES = (Paths.PHOTO, Paths.DEPTH, Paths.TWIN_PICTURE, Paths.COVERAGE, Paths.IMAGE)


def placeholder_path(path: str) -> str:
    """Path of the placeholder of ``path``: an entity holds pictures of a single kind and size."""
    return f"{path}/not_yet"


def log_placeholders(recording: RerunRecording) -> None:
    """Log placeholders in all picture panes and 3D views."""
    picture = rr.Image(_draw_placeholder())  # not encoded: the viewer shows encoded images as video and ignores Clear
    for path in _PICTURES:
        recording.log(placeholder_path(path), picture)
    lens = rr.Pinhole(
        focal_length=float(_SIZE[0]), resolution=_SIZE, camera_xyz=rr.ViewCoordinates.RDF, image_plane_distance=0.25
    )
    recording.log(Paths.CAMERA, lens)
    log_table_top(recording, InstanceTable())
    label = rr.Points3D(
        [_ABOVE_TABLE], labels=[_PLACEHOLDER_TEXT], show_labels=True, radii=[0.001], colors=[(_INK,) * 3]
    )
    recording.log(placeholder_path(Paths.WORLD), label)


def clear_placeholder(recording: RerunRecording, path: str) -> None:
    """Clear the placeholder of ``path`` before its first content."""
    recording.log(placeholder_path(path), rr.Clear(recursive=False))


def log_table_top(
    recording: RerunRecording, looks: InstanceTable, texture: npt.NDArray[np.uint8] | None = None
) -> None:
    """The table top of the rollout world; ``texture`` (N, N, 3) covers the whole simulated table."""
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
    """The placeholder text centred in a grey picture (H, W)."""
    image = Image.new("L", _SIZE, _GROUND)
    middle = (_SIZE[0] / 2, _SIZE[1] / 2)
    ImageDraw.Draw(image).text(middle, _PLACEHOLDER_TEXT, _INK, ImageFont.load_default(32), anchor="mm")
    return np.asarray(image)
