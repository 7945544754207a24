"""Merging of segments that a describer names as pieces of the same object."""

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from grs_agents.perception.segmentation.candidates import measure_beside_others
from grs_agents.perception.types import Aabb, Candidate, Mask, RGBDFrame, TableFrame

ADJOINING = 0.03
"""Largest gap between the boxes of adjoining segments, m; only adjoining segments are merged."""


def gap_between_boxes(first: Aabb, second: Aabb) -> float:
    """Distance between two boxes, m."""
    apart = np.maximum(np.subtract(first.low, second.high), np.subtract(second.low, first.high))
    return float(np.linalg.norm(np.maximum(0, apart)))


def group_pieces_of_one_object(part_of: Mapping[int, int], boxes: Mapping[int, Aabb]) -> list[tuple[int, ...]]:
    """Groups of segments that form an object, by number, in order.

    Args:
        part_of: for segments that are pieces, the segment of which they are a part.
        boxes: of all segments; a piece that does not adjoin the rest of its object stays single.
    """
    wholes: dict[int, list[int]] = {}
    for number in sorted(boxes):
        chain = [number]
        while (following := part_of.get(chain[-1])) is not None and following not in chain:
            chain.append(following)
        whole = chain[-1] if part_of.get(chain[-1]) is None else min(chain[chain.index(part_of[chain[-1]]) :])
        wholes.setdefault(whole, []).append(number)
    groups: list[tuple[int, ...]] = []
    for whole, members in sorted(wholes.items()):
        reached, rest = [whole], [number for number in members if number != whole]
        for member in reached:  # grows while segments adjoin it
            near = [number for number in rest if gap_between_boxes(boxes[member], boxes[number]) <= ADJOINING]
            reached += near
            rest = [number for number in rest if number not in near]
        if len(reached) > 1:
            groups.append(tuple(sorted(reached)))
    return groups


def merge_pieces(
    number: int, group: Collection[int], masks: Mapping[int, Mask], frame: RGBDFrame, table: TableFrame
) -> Candidate | None:
    """Merge a group of segments to a candidate and measure it; ``None`` if it is too large for an object.

    ``masks`` (H, W) are those of all segments, by number: the candidate may stand on another.
    """
    whole = np.any([masks[member] for member in group], axis=0)
    others = [mask for segment, mask in masks.items() if segment not in group]
    measured = measure_beside_others(frame, table, [whole], others)
    return replace(measured[0], id=number) if measured else None
