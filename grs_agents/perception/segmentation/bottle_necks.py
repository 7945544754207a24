"""What is centred on shoulders that slope away is the neck or the cap of what is below: nothing can stand there."""

import cv2
import numpy as np

from grs_agents.perception.image_geometry import Labels, compute_percentiles, mask_bounding_slices
from grs_agents.perception.segmentation.configuration import BottleNeck
from grs_agents.perception.types import Array, Mask


class NeckTest:
    """Tells whether the upper one of two pieces is the neck of the lower one."""

    def __init__(self, labels: Labels, points: Array, eye: Array, config: BottleNeck) -> None:
        self.labels, self.points, self.eye, self.config = labels, points, eye, config
        self.clouds: dict[int, Array] = {}

    def is_one_object(self, one: int, other: int) -> bool:
        """Whether of two labels, which touch, the higher one is the neck of the other."""
        first, second = self._cloud(one), self._cloud(other)
        if min(len(first), len(second)) < self.config.fewest:
            return False
        if np.median(first[:, 2]) < np.median(second[:, 2]):
            one, other, first, second = other, one, second, first
        (foot, top), (bottom, shoulder) = (compute_percentiles(cloud[:, 2], (3, 97)) for cloud in (first, second))
        if abs(foot - shoulder) > self.config.apart or top - foot > self.config.tallest * (shoulder - bottom):
            return False
        return self._are_centered(first, second) and self._slopes_away(one, other)

    def _cloud(self, label: int) -> Array:
        if label not in self.clouds:
            known = self.points[self.labels == label]
            self.clouds[label] = known[np.isfinite(known[:, 2])]
        return self.clouds[label]

    def _are_centered(self, neck: Array, body: Array) -> bool:
        """Whether the middles of neck and body, left and right in the camera's view, are above each other."""
        away_x, away_y = (neck.mean(axis=0) - self.eye)[:2]
        across = np.array([-away_y, away_x]) / np.hypot(away_x, away_y)
        one, other = (compute_percentiles(cloud[:, :2] @ across, (3, 97)).mean() for cloud in (neck, body))
        return bool(abs(one - other) < self.config.off)

    def _slopes_away(self, neck: int, body: int) -> bool:
        """Whether the body's surface around the neck is lower than their border."""
        window = mask_bounding_slices((self.labels == neck) | (self.labels == body))
        labels, heights = self.labels[window], self.points[window][..., 2]
        upper, lower = labels == neck, labels == body
        border = (upper & _grown(lower, 1)) | (lower & _grown(upper, 1))
        around = heights[lower & _grown(border, self.config.around)]
        around, seam = around[np.isfinite(around)], heights[border]
        if len(around) < self.config.fewest or not np.isfinite(seam).any():
            return False
        middle, highest = compute_percentiles(around, (50, 80))
        level = float(np.nanmedian(seam))
        return bool(level - middle > self.config.slope[0] and level - highest > self.config.slope[1])


def _grown(mask: Mask, by: int) -> Mask:
    return cv2.dilate(mask.astype(np.uint8), np.ones((2 * by + 1,) * 2, np.uint8)) > 0
