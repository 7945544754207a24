"""Fewer faces for a closed mesh, by collapsing edges; it stays closed, and no edge gets more than two faces.

Cost and places by quadric error metrics (Garland and Heckbert, SIGGRAPH 1997). Many edges that are far enough apart
collapse at once. An edge collapses only if that keeps the surface a manifold (the link condition of Dey et al.,
"Topology preserving edge contraction", 1999) and turns no face over."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.perception.types import Array, Mask

Faces = npt.NDArray[np.int64]
_ROUNDS = 60  # half as many are enough for a tenth of the faces
_CHEAPEST = 0.3  # of the edges are looked at in a round
_MIXER, _LAST = 2_654_435_761, 2**32  # Knuth's multiplier for hashing mixes numbers, each once
_UPRIGHT = 0.2  # cosine between a face's normals before and after: below it, the face would be turned over
_HALF = np.array([[1.0, 0.5, 0.5], [0.5, 1.0, 0.5], [0.5, 0.5, 1.0]])
_STIFF = 1e-3  # how strongly a vertex is drawn to its edge's middle where the surface is flat


@dataclass
class _Work:
    """A mesh at work; vertices that have gone are in no face."""

    vertices: Array
    faces: Faces
    # (V, 10) squared distance from the planes around a vertex, as factors of xx, yy, zz, xy, xz, yz, x, y, z and 1
    quadrics: Array
    refused: Faces  # edges that may not collapse, as start * V + end, sorted
    costs: Array  # (F, 3) of collapsing the edge from each corner to the next, where that has the higher number

    def half_edges(self) -> tuple[Faces, Faces]:
        """(3 F,) where the edges along the faces start and end: each edge of the mesh once in each direction."""
        return self.faces.ravel(), self.faces[:, [1, 2, 0]].ravel()

    def middles(self, edges: Faces) -> Array:
        """(E, 3) of edges (E, 2)."""
        return (self.vertices[edges[:, 0]] + self.vertices[edges[:, 1]]) / 2

    def quadrics_of(self, edges: Faces) -> Array:
        """(E, 10) of both ends of edges (E, 2)."""
        return self.quadrics[edges[:, 0]] + self.quadrics[edges[:, 1]]

    def keys(self, edges: Faces) -> Faces:
        """(E,) one number for each edge (E, 2)."""
        return edges[:, 0] * len(self.vertices) + edges[:, 1]


def simplify_closed_mesh(vertices: Array, faces: Faces, most: int) -> tuple[Array, Faces]:
    """The closed mesh with at most about ``most`` faces, or as few as keep it closed."""
    quadrics = _quadric_error_matrices(vertices, faces)
    work = _Work(vertices.copy(), faces, quadrics, np.zeros(0, np.int64), np.full(faces.shape, np.inf))
    _update_costs(work, np.ones(len(vertices), np.bool_))
    for _ in range(_ROUNDS):
        spare = (len(work.faces) - most + 1) // 2
        if spare <= 0 or not _collapse_cheapest_edges(work, spare):
            break
    used, numbered = np.unique(work.faces, return_inverse=True)
    return work.vertices[used], numbered.reshape(-1, 3)


def _quadric_error_matrices(vertices: Array, faces: Faces) -> Array:
    """(V, 10) of the planes of the faces around each vertex, by area."""
    corners = vertices[faces]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(crosses, axis=1)
    x, y, z = (crosses / np.maximum(areas, 1e-15)[:, None]).T
    d = -(x * corners[:, 0, 0] + y * corners[:, 0, 1] + z * corners[:, 0, 2])
    planes = (x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, 2 * x * d, 2 * y * d, 2 * z * d, d * d)
    owners = faces.ravel()
    sums = [np.bincount(owners, weights=np.repeat(part * areas, 3), minlength=len(vertices)) for part in planes]
    return np.stack(sums, axis=1).astype(np.float64)


def _least_error_positions(quadrics: Array, middles: Array) -> Array:
    """(C, 3) where the quadrics (C, 10) are least; where that is anywhere on a plane or a line, near the middles."""
    halves = quadrics[:, [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(-1, 3, 3) * _HALF
    strength = _STIFF * quadrics[:, :3].sum(axis=1)[:, None] + 1e-12
    stiff = halves + strength[:, :, None] * np.eye(3)
    right = strength * middles - quadrics[:, 6:9] / 2
    return np.asarray(np.linalg.solve(stiff, right[:, :, None]), np.float64)[:, :, 0]


def _update_costs(work: _Work, moved: Mask) -> None:
    """Tell the costs of the edges of vertices that have ``moved`` (V,); those of the others stay."""
    starts, ends = work.half_edges()
    fresh = np.flatnonzero((moved[starts] | moved[ends]) & (starts < ends))
    edges = np.stack([starts[fresh], ends[fresh]], axis=1)
    middles = work.middles(edges)
    x, y, z = middles.T
    powers = np.stack([x * x, y * y, z * z, x * y, x * z, y * z, x, y, z, np.ones(len(x))], axis=1)
    costs = np.einsum("ij,ij->i", work.quadrics_of(edges), powers)
    along = work.vertices[edges[:, 0]] - work.vertices[edges[:, 1]]
    costs += 1e-9 * (along**2).sum(axis=1)  # of equals the shortest
    costs[_membership_mask(work.refused, work.keys(edges))] = np.inf
    work.costs.reshape(-1)[fresh] = costs


def _collapse_cheapest_edges(work: _Work, spare: int) -> bool:
    """Collapse the cheapest edges that are far enough apart, at most ``spare``; whether there were any."""
    starts, ends = work.half_edges()
    once = np.flatnonzero(starts < ends)
    edges, costs = np.stack([starts[once], ends[once]], axis=1), work.costs.reshape(-1)
    looked_at = max(_CHEAPEST * len(edges), 4 * spare)
    chosen = _select_independent_edges(len(work.vertices), edges, costs[once], looked_at)[:spare]
    if not len(chosen):
        return False
    picked = edges[chosen]
    places = _least_error_positions(work.quadrics_of(picked), work.middles(picked))
    good = _collapse_keeps_manifold_mask(work, picked) & _collapse_keeps_faces_upright_mask(work, picked, places)
    refused = np.sort(work.keys(picked[~good]))
    work.refused = np.sort(np.concatenate([work.refused, refused]))
    costs[once[_membership_mask(refused, work.keys(edges))]] = np.inf
    _collapse_edges(work, picked[good], places[good])
    return True


def _membership_mask(numbers: Faces, wanted: Faces) -> Mask:
    """(N,) which of the wanted are among sorted numbers."""
    if not len(numbers):
        return np.zeros(len(wanted), np.bool_)
    return np.asarray(numbers[np.minimum(np.searchsorted(numbers, wanted), len(numbers) - 1)] == wanted)


def _select_independent_edges(count: int, edges: Faces, costs: Array, most: float) -> Faces:
    """Of the ``most`` cheapest edges some of which no two touch each other's ends' neighbours; in mixed order, as
    neighbours cost about the same and few would be cheaper than all others around."""
    cheap = np.argsort(costs, kind="stable")[: int(most)]
    cheap = cheap[np.isfinite(costs[cheap])]
    rank = (np.arange(len(cheap)) * _MIXER) % _LAST
    least = np.full(count, _LAST)
    for end in edges[cheap].T:
        np.minimum.at(least, end, rank)
    around = least.copy()
    for end, other in (edges.T, edges.T[::-1]):
        np.minimum.at(around, end, least[other])
    return cheap[rank == np.minimum(around[edges[cheap, 0]], around[edges[cheap, 1]])]


def _collapse_keeps_manifold_mask(work: _Work, edges: Faces) -> Mask:
    """(C,) which edges (C, 2), no two of which have an end in common, have ends with exactly two neighbours in
    common."""
    starts, ends = work.half_edges()
    neighbors: list[Faces] = []
    for end in edges.T:
        owner = np.full(len(work.vertices), -1)
        owner[end] = np.arange(len(edges))
        mine = owner[starts]
        near = np.flatnonzero(mine >= 0)
        neighbors.append(mine[near] * len(work.vertices) + ends[near])
    common = neighbors[0][_membership_mask(np.sort(neighbors[1]), neighbors[0])]
    return np.asarray(np.bincount(common // len(work.vertices), minlength=len(edges)) == 2)


def _collapse_keeps_faces_upright_mask(work: _Work, edges: Faces, places: Array) -> Mask:
    """(C,) which edges (C, 2) may go to places (C, 3) without turning a face over."""
    owner = np.full(len(work.vertices), -1)
    for end in edges.T:
        owner[end] = np.arange(len(edges))
    owners = owner[work.faces]
    touched = np.flatnonzero((owners >= 0).sum(axis=1) == 1)  # faces with both ends vanish
    before = work.vertices[work.faces[touched]]
    mine = owners[touched]
    after = np.where((mine >= 0)[:, :, None], places[mine], before)
    one, two = (np.cross(part[:, 1] - part[:, 0], part[:, 2] - part[:, 0]) for part in (before, after))
    lengths = np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1)
    turned = (one * two).sum(axis=1) < _UPRIGHT * lengths
    return np.asarray(np.bincount(mine.max(axis=1)[turned], minlength=len(edges)) == 0)


def _collapse_edges(work: _Work, edges: Faces, places: Array) -> None:
    kept, gone = edges.T
    work.vertices[kept] = places
    work.quadrics[kept] += work.quadrics[gone]
    number = np.arange(len(work.vertices))
    number[gone] = kept
    faces = number[work.faces]
    a, b, c = faces.T
    stay = (a != b) & (b != c) & (c != a)
    work.faces, work.costs = faces[stay], work.costs[stay]
    moved = np.zeros(len(number), np.bool_)
    moved[kept] = True
    _update_costs(work, moved)
