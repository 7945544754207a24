"""Mending meshes: faces without area, faces twice, faces inside out, small holes."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from grs_agents.library.importing.types import Floats, Ints, Solid

_LONGEST_HOLE = 200
"""Edges; what is larger is an opening that the thing has."""


@dataclass(frozen=True)
class Mended:
    """A mesh after repair.

    Attributes:
        solid: the mesh.
        watertight: every edge has exactly two faces that agree on the outside.
        notes: what was done.
    """

    solid: Solid
    watertight: bool
    notes: tuple[str, ...]


def mend(solid: Solid) -> Mended:
    """Drop faces without area and doubles, turn faces the same way out, close holes."""
    notes: list[str] = []
    faces, uvs, dropped = _without_waste(solid)
    if dropped:
        notes.append(f"{dropped} faces without area or twice dropped")
    turned, count = _turned(faces)
    uvs = np.where((turned != faces).any(axis=1)[:, None, None], uvs[:, ::-1], uvs)
    if count:
        notes.append(f"{count} faces turned the right way out")
    filled, patches = _filled(turned)
    if patches:
        notes.append(f"{patches} holes closed")
        uvs = np.concatenate([uvs, _uvs_at(turned, uvs, filled[len(turned) :])])
    if volume(solid.vertices, filled) < 0:
        filled, uvs = filled[:, ::-1], uvs[:, ::-1]
        notes.append("it was inside out")
    tight = is_watertight(filled)
    if not tight:
        notes.append("not watertight: its volume is that of its convex parts")
    return Mended(Solid(solid.vertices, filled, uvs, solid.image), tight, tuple(notes))


def is_watertight(faces: Ints) -> bool:
    """Whether each directed edge occurs once, and once the other way."""
    if not len(faces):
        return False
    edges = _edges(faces)
    forth, back = (np.sort(_codes(one)) for one in (edges, edges[:, ::-1]))
    return bool((np.diff(forth) > 0).all() and (forth == back).all())


def volume(vertices: Floats, faces: Ints) -> float:
    """m^3 of a closed mesh; its sign tells whether the faces look out."""
    a, b, c = (vertices[faces[:, corner]] - vertices.mean(axis=0) for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def area(vertices: Floats, faces: Ints) -> float:
    """m^2."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _without_waste(solid: Solid) -> tuple[Ints, Floats, int]:
    faces = solid.faces
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 0] != faces[:, 2])
    kept = np.flatnonzero(distinct)
    _, first = np.unique(np.sort(faces[kept], axis=1), axis=0, return_index=True)
    kept = kept[np.sort(first)]
    return faces[kept], solid.uvs[kept], len(faces) - len(kept)


def _edges(faces: Ints) -> Ints:
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _codes(edges: Ints) -> Ints:
    return edges[:, 0] * (int(edges.max(initial=0)) + 1) + edges[:, 1]


def _turned(faces: Ints) -> tuple[Ints, int]:
    """Faces that agree with their neighbours on which side is out, and how many were turned."""
    count = len(faces)
    owner, edges = np.tile(np.arange(count), 3), _edges(faces)
    low, high = edges.min(axis=1), edges.max(axis=1)
    forward = edges[:, 0] == low
    code = low * (int(edges.max(initial=0)) + 1) + high
    order = np.argsort(code, kind="stable")
    same = np.flatnonzero(code[order][1:] == code[order][:-1])
    left, right = order[same], order[same + 1]
    odd = forward[left] == forward[right]
    if not odd.any():
        return faces, 0
    neighbours: list[list[tuple[int, bool]]] = [[] for _ in range(count)]
    for one, other, unlike in zip(owner[left].tolist(), owner[right].tolist(), odd.tolist(), strict=True):
        neighbours[one].append((other, unlike))
        neighbours[other].append((one, unlike))
    flip = _flips(neighbours)
    if 2 * int(flip.sum()) > count:
        flip = ~flip
    return np.where(flip[:, None], faces[:, ::-1], faces), int(flip.sum())


def _flips(neighbours: list[list[tuple[int, bool]]]) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which faces differ from the first of their piece."""
    flip, seen = np.zeros(len(neighbours), np.bool_), np.zeros(len(neighbours), np.bool_)
    for start in range(len(neighbours)):
        if seen[start]:
            continue
        seen[start], queue = True, deque([start])
        while queue:
            face = queue.popleft()
            for other, unlike in neighbours[face]:
                if not seen[other]:
                    seen[other], flip[other] = True, flip[face] ^ unlike
                    queue.append(other)
    return flip


def _filled(faces: Ints) -> tuple[Ints, int]:
    """The faces and fans over holes of at most 200 edges, and how many holes those were."""
    edges: list[list[int]] = _edges(faces).tolist()
    known = {(a, b) for a, b in edges}
    after: dict[int, list[int]] = {}
    for a, b in known:
        if (b, a) not in known:
            after.setdefault(b, []).append(a)  # the hole's own direction, against its border's
    patches: list[tuple[int, int, int]] = []
    holes = 0
    while after:
        ring = _ring(after)
        if 3 <= len(ring) <= _LONGEST_HOLE:
            holes += 1
            patches += [(ring[0], ring[number], ring[number + 1]) for number in range(1, len(ring) - 1)]
    return np.concatenate([faces, np.array(patches, dtype=np.int64).reshape(-1, 3)]), holes


def _ring(after: dict[int, list[int]]) -> list[int]:
    """Take one closed walk out of ``after``; empty where it does not close."""
    start = next(iter(after))
    walk = [start]
    while True:
        here = walk[-1]
        choices = after.get(here)
        if not choices:
            return []
        following = choices.pop()
        if not choices:
            del after[here]
        if following in walk:
            return walk[walk.index(following) :]
        walk.append(following)


def _uvs_at(faces: Ints, uvs: Floats, patches: Ints) -> Floats:
    """Texture coordinates of patches: those that a neighbouring face has at the patch's first corner."""
    at = np.zeros((int(max(faces.max(initial=0), patches.max(initial=0))) + 1, 2))
    at[faces.ravel()] = uvs.reshape(-1, 2)
    return np.repeat(at[patches[:, 0]][:, None], 3, axis=1)
