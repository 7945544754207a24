"""Pieces of one thing, as a describer tells them, put together and measured anew."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from grs_agents.base.errors import InputError
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.types import Aabb, Candidate, Mask, RGBDFrame, TableFrame

ADJOINING = 0.03
"""Segments whose boxes are at most so far apart (m) adjoin each other; only what adjoins is put together."""


def gap_between_boxes(one: Aabb, other: Aabb) -> float:
    """How far two boxes are apart, m."""
    return float(
        np.linalg.norm(np.maximum(0, np.maximum(np.subtract(one.low, other.high), np.subtract(other.low, one.high))))
    )


def group_pieces_of_one_object(part_of: Mapping[int, int], boxes: Mapping[int, Aabb]) -> list[tuple[int, ...]]:
    """The numbers of the segments that are one thing, each group and the list of them in order.

    Args:
        part_of: for the segments that are pieces the segment that they are said to be a part of.
        boxes: of all segments; a piece that does not adjoin the rest of its thing stays on its own.
    """
    wholes: dict[int, list[int]] = {}
    for number in sorted(boxes):
        chain = [number]
        while (following := part_of.get(chain[-1])) is not None and following not in chain:
            chain.append(following)
        whole = chain[-1] if part_of.get(chain[-1]) is None else min(chain[chain.index(part_of[chain[-1]]) :])
        wholes.setdefault(whole, []).append(number)
    groups = (_find_members_adjoining_whole(whole, members, boxes) for whole, members in sorted(wholes.items()))
    return [group for group in groups if len(group) > 1]


def _find_members_adjoining_whole(whole: int, members: Sequence[int], boxes: Mapping[int, Aabb]) -> tuple[int, ...]:
    """Those members that hang together with the whole."""
    reached, rest = [whole], [number for number in members if number != whole]
    for one in reached:
        near = [number for number in rest if gap_between_boxes(boxes[one], boxes[number]) <= ADJOINING]
        reached += near
        rest = [number for number in rest if number not in near]
    return tuple(sorted(reached))


def merge_pieces(
    number: int, group: Collection[int], masks: Mapping[int, Mask], frame: RGBDFrame, table: TableFrame
) -> Candidate | None:
    """The candidate that the segments of a group are together, measured; None where it is too large for an object.

    ``masks`` (H, W) are those of all segments, by number: it may stand on another.
    """
    whole = np.any([masks[one] for one in group], axis=0)
    labels = np.zeros(frame.depth.shape, np.int32)
    for label, (one, mask) in enumerate(masks.items(), 2):
        labels[mask] = 0 if one in group else label
    labels[whole] = 1
    try:
        first = measure_candidates(frame, table, labels)[0]
    except InputError:
        return None
    return replace(first, id=number) if np.array_equal(first.mask, whole) else None
