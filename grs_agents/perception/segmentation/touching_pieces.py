"""Join the pieces of one object that touch: a crease between them may be its own, as at the neck of a bottle."""

import numpy as np

from grs_agents.perception.image_geometry import Labels
from grs_agents.perception.segmentation.bottle_necks import NeckTest
from grs_agents.perception.segmentation.configuration import Segmentation
from grs_agents.perception.segmentation.patch_cutting import find_depth_jumps, measure_label_borders
from grs_agents.perception.segmentation.piece_colors import PlainColorTest
from grs_agents.perception.types import Array, RGBDFrame, TableFrame


def join_touching_pieces(
    labels: Labels, frame: RGBDFrame, points: Array, table: TableFrame, config: Segmentation
) -> Labels:
    """(H, W) labels, 1..N, with the touching pieces of each object joined; ``points`` are (H, W, 3) in the robot frame.
    The rules are "plain_color" and "neck"."""
    below, right = find_depth_jumps(frame.depth)
    length, jumps = measure_label_borders(labels, np.zeros(labels.shape), below, right, 1.0)
    touching = length - jumps >= np.maximum(config.touching.shortest, config.touching.open * length)
    tests = {
        "plain_color": PlainColorTest(labels, frame.rgb, config.plain),
        "neck": NeckTest(labels, points, np.asarray(table.T_robot_cam)[:3, 3], config.neck),
    }
    active = [test for rule, test in tests.items() if rule in config.rules]
    numbers = np.arange(int(labels.max()) + 1, dtype=np.int32)
    for one, other in np.argwhere(np.triu(touching, 1)).tolist():
        if any(test.is_one_object(one, other) for test in active):
            numbers[numbers == numbers[other]] = numbers[one]
    return np.unique(numbers, return_inverse=True)[1].astype(np.int32)[labels]
