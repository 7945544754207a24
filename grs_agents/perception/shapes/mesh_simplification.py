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

    def edges(self) -> Faces:
        """(E, 2) each edge once, the lower number first."""
        halves = self.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        return halves[halves[:, 0] < halves[:, 1]]

    def keys(self, edges: Faces) -> Faces:
        """(E,) one number for each edge (E, 2)."""
        return edges[:, 0] * len(self.vertices) + edges[:, 1]


def simplify_closed_mesh(vertices: Array, faces: Faces, most: int) -> tuple[Array, Faces]:
    """The closed mesh with at most about ``most`` faces, or as few as keep it closed."""
    work = _Work(vertices.copy(), faces, _quadric_error_matrices(vertices, faces), np.zeros(0, np.int64))
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


def _collapse_cheapest_edges(work: _Work, spare: int) -> bool:
    """Collapse the cheapest edges that are far enough apart, at most ``spare``; whether there were any."""
    edges = work.edges()
    a, b = edges.T
    middles = (work.vertices[a] + work.vertices[b]) / 2
    quadrics = work.quadrics[a] + work.quadrics[b]
    x, y, z = middles.T
    powers = np.stack([x * x, y * y, z * z, x * y, x * z, y * z, x, y, z, np.ones(len(x))], axis=1)
    costs = np.einsum("ij,ij->i", quadrics, powers)
    costs += 1e-9 * ((work.vertices[a] - work.vertices[b]) ** 2).sum(axis=1)  # of equals the shortest
    costs[_membership_mask(work.refused, work.keys(edges))] = np.inf
    chosen = _select_independent_edges(len(work.vertices), edges, costs, max(_CHEAPEST * len(edges), 4 * spare))[:spare]
    if not len(chosen):
        return False
    places = _least_error_positions(quadrics[chosen], middles[chosen])
    good = _collapse_keeps_manifold_mask(work, edges, chosen) & _collapse_keeps_faces_upright_mask(
        work, edges[chosen], places
    )
    work.refused = np.sort(np.concatenate([work.refused, work.keys(edges[chosen[~good]])]))
    _collapse_edges(work, edges[chosen[good]], places[good])
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
    rank = np.full(len(edges), _LAST)
    rank[cheap] = (np.arange(len(cheap)) * _MIXER) % _LAST
    least = np.full(count, _LAST)
    for end in edges.T:
        np.minimum.at(least, end, rank)
    around = least.copy()
    for end, other in (edges.T, edges.T[::-1]):
        np.minimum.at(around, end, least[other])
    return cheap[rank[cheap] == np.minimum(around[edges[cheap, 0]], around[edges[cheap, 1]])]


def _collapse_keeps_manifold_mask(work: _Work, edges: Faces, chosen: Faces) -> Mask:
    """(C,) which chosen edges have ends with exactly two neighbours in common."""
    owner, neighbors = _vertex_neighbor_lists(edges, len(work.vertices), edges[chosen, 0])
    far = edges[chosen, 1][owner]
    pairs = np.stack([np.minimum(neighbors, far), np.maximum(neighbors, far)], axis=1)
    common = _membership_mask(np.sort(work.keys(edges)), work.keys(pairs))
    return np.asarray(np.bincount(owner[common], minlength=len(chosen)) == 2)


def _vertex_neighbor_lists(edges: Faces, count: int, vertices: Faces) -> tuple[Faces, Faces]:
    """The neighbours of vertices (N,), one after the other, and to which of those each belongs."""
    wanted = np.full(count, -1)
    wanted[vertices] = np.arange(len(vertices))
    both = np.concatenate([edges, edges[:, ::-1]])
    mine = both[wanted[both[:, 0]] >= 0]
    return wanted[mine[:, 0]], mine[:, 1]


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
    work.faces = faces[(a != b) & (b != c) & (c != a)]
