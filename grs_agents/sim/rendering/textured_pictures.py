"""Pictures by rays of props with their textures, light and table: the same on every machine, without OpenGL."""

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.asset_rendering import Lens
from grs_agents.library.library import Library
from grs_agents.sim.rendering.ray_painter import RayPainter
from grs_agents.sim.rendering.stage import Props, Stage
from grs_agents.sim.rendering.views import Picture


def render_from_camera(props: Props, library: Library, lens: Lens, pose: FloatArray) -> Picture:
    """What a camera sees of props through ``lens`` from ``pose``, T_robot_cam (4, 4), OpenCV axes, m.
    Raises ``InputError`` for meshes and textures that MuJoCo does not take."""
    painter = RayPainter(Stage(props, library), lens.height, lens.width)
    painter.prepare_view(lens, pose, arm=props.arm is not None)
    return Picture(painter.draw_color(), *painter.draw_depth_and_owner())
