"""Where one part is seen over the upper edge of another: the inside of a hollow object, or an object behind an object.

Along the edge of a hollow object what is seen lies deep in the middle and comes up to the rim at both ends, where the
near wall meets the far one. An object behind an object stays as deep, or goes on down beside it."""

import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import Index, Labels
from grs_agents.perception.segmentation.configuration import Segmentation
from grs_agents.perception.types import Array

NOWHERE: Index = np.zeros(0, np.intp)


class OcclusionEdges:
    """The upper edges of the parts of an (H, W) label image, and how deep lies the next part that is seen over them."""

    def __init__(self, labels: Labels, points: Array, config: Segmentation = DEFAULT.segmentation) -> None:
        self.config, self.deep = config.rim, config.hollow.deep
        rows, columns = np.nonzero((labels[1:] != labels[:-1]) & (labels[1:] > 0))
        numbers = np.arange(len(labels))[:, None]
        at = np.maximum.accumulate(np.where(labels > 0, numbers, -1), axis=0)[rows, columns]
        seen = at >= 0
        rows, at, self.columns = rows[seen] + 1, at[seen], columns[seen]
        self.edges, self.seen = points[rows, self.columns], points[at, self.columns]
        count = int(labels.max()) + 1
        pairs = labels[rows, self.columns].astype(np.int64) * count + labels[at, self.columns]
        order = np.argsort(pairs, kind="stable")
        kinds, first = np.unique(pairs[order], return_index=True)
        members = np.split(order, first)[1:]
        self.pairs = {divmod(int(kind), count): own for kind, own in zip(kinds, members, strict=True)}

    def relabel_part(self, old: int, new: int) -> None:
        """Part ``old`` has become a piece of ``new``."""
        for near, far in [pair for pair in self.pairs if old in pair]:
            pair = (new if near == old else near), (new if far == old else far)
            renamed = self.pairs.pop((near, far))
            self.pairs[pair] = np.sort(np.concatenate([self.pairs.get(pair, NOWHERE), renamed]))

    def is_far_label_seen_over_edge(self, near: int, far: int, width: int) -> bool:
        """Whether ``far`` is seen over most of the edge of ``near``; the narrower of them is ``width`` columns wide.
        What stands in a hollow object has its far wall behind it, and a whole hollow object its own inside: these are
        no edges of a wall."""
        pair = self._edge_indices_of_pair(near, far)
        if len(pair) < max(self.config.span * width, self.config.fewest):
            return False
        own = np.isin(self.columns[pair], self.columns[self._edge_indices_of_pair(near, near)]).sum()
        return max(int(own), len(self._edge_indices_of_pair(far, near))) <= self.config.span * len(pair)

    def _edge_indices_of_pair(self, near: int, far: int) -> Index:
        return self.pairs.get((near, far), NOWHERE)

    def reaches_rim_at_ends(self, near: int, far: int, top: float) -> bool:
        """Whether what is seen of ``far`` over ``near`` comes up at both ends to about ``top``, their height (m)."""
        pairs = self._edge_indices_of_pair(near, far)
        pairs = pairs[np.argsort(self.columns[pairs], kind="stable")]
        edges, seen = self.edges[pairs], self.seen[pairs]
        known = np.isfinite(edges[:, 2]) & np.isfinite(seen[:, 2])
        edges, seen = edges[known], seen[known]
        if len(edges) < self.config.fewest:
            return False
        heights = np.minimum(edges[:, 2], seen[:, 2])
        apart = np.linalg.norm(edges - seen, axis=1)
        end = max(1, round(self.config.end * len(edges)))
        middle = float(np.percentile(heights[end:-end], 10))
        risen = min(float(heights[:end].max()), float(heights[-end:].max()))
        farthest = max(float(apart[:end].min()), float(apart[-end:].min()))
        width = float(np.linalg.norm(edges[0] - edges[-1]))
        return risen > max(self.config.risen * top, middle + self.deep) and farthest < self.config.closed * width
