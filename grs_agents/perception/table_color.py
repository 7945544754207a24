"""The colour of the table in a photo."""

from typing import Final

import numpy as np

from grs_agents.base import Vec3
from grs_agents.perception.table_finding import pixels_to_robot_frame
from grs_agents.perception.types import RGBDFrame, TableFrame, X, Y

_MOST_PIXELS: Final = 20_000
"""So many pixels, evenly spread over the photo, are looked at."""
_FEWEST_PIXELS: Final = 50
_OFF_PLANE: Final = 0.01
"""Metres above or below the table top at which a pixel still shows the table."""


def measure_table_color(frame: RGBDFrame, table: TableFrame) -> Vec3 | None:
    """The median colour (sRGB, 0..1) of the photo's table pixels in the workspace; None where hardly any is seen.

    What lies flat on the table, shadows and highlights hardly move the median.
    """
    step = max(1, int(np.ceil(np.sqrt(frame.depth.size / _MOST_PIXELS))))
    rows, columns = np.nonzero(frame.depth[::step, ::step] > 0)
    rows, columns = rows * step, columns * step
    x, y, z = pixels_to_robot_frame(frame, table, rows, columns).T
    shown = (np.abs(z) < _OFF_PLANE) & (x > X[0]) & (x < X[1]) & (y > Y[0]) & (y < Y[1])
    if np.count_nonzero(shown) < _FEWEST_PIXELS:
        return None
    red, green, blue = np.median(frame.rgb[rows[shown], columns[shown]], axis=0) / 255
    return (round(float(red), 4), round(float(green), 4), round(float(blue), 4))
