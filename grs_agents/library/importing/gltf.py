"""Reading glTF and GLB: the default scene in its initial pose as triangles with base colours and pictures.
Morph weights and skins are applied. Lights, cameras, animations and gloss have no part in an asset."""

import io
import math
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from grs_agents.library.importing.gltf_document import (
    GltfDocument,
    Material,
    Primitive,
    SceneNode,
    TextureTransform,
    scale_integers,
)
from grs_agents.library.importing.mesh_simplification import lay_out_face_squares
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.types import Floats, Image, ImportLimits, Ints, MeshPart, RefusedError, SourceModel

_EDGE: Final = 2048
"""Longest side of a picture, px; an asset's texture has fewer."""
_PAINTED: Final = 1024
"""Side of a repainted picture, px."""
_PICTURES: Final = 8
"""Most pixels of all pictures together, as a multiple of the limit of a single picture."""
_TILE: Final = 1e-3
"""Share of a picture by which texture coordinates may pass its edge: quantised coordinates are not exact."""
_MOST_PICTURES: Final = 256
"""Most combinations of picture and colour; beyond it each is too small in an asset's texture, and faces get a flat
colour."""
_MOST_PAINTED: Final = 50_000
"""Most faces of a repainted picture; beyond it each would have too few texels and gets a flat colour."""
_SMALL: Final = 0.05
"""Share of a picture that a face may show across its edge and still be clipped: repainting it takes more room."""
_FARTHEST: Final = 1e6
"""Texture coordinates beyond it are taken for broken."""
_CHUNK: Final = 500_000
"""Texels that are painted at a time."""
_FORMATS: Final = ("PNG", "JPEG", "WEBP", "DDS", "BMP", "GIF", "AVIF")
"""Formats that Pillow may try: PNG and JPEG are glTF's, WebP, DDS and AVIF those of extensions."""
_DECODER_ERRORS: Final = (
    *(OSError, EOFError, ValueError, TypeError, SyntaxError, LookupError, ArithmeticError, RuntimeError),
    *(struct.error, zlib.error),
)
"""Errors of Pillow's decoders on broken pictures; the AVIF decoder raises RuntimeError."""
_KTX2: Final = b"\xabKTX"
_SHARES: Final = ("COLOR", "WEIGHTS")
"""Attributes whose integers are shares, even if an exporter forgot to say so."""
_GIVEN: Final = -1
"""Number of the picture that is not of the file."""

Rgb = tuple[float, float, float]
_Wrap = Literal["repeat", "mirror", "clamp"]
_WRAPS: Final[dict[int, _Wrap]] = {33071: "clamp", 33648: "mirror"}


def read_gltf(folder: SourceFolder, name: str, limits: ImportLimits, picture: Image | None = None) -> SourceModel:
    """Read the parts of a glTF or GLB file: a part for each picture as it is shown, and a part for all plain colours.

    Args:
        folder: the source that the file and all that it names lie in.
        name: of the file, relative to the source.
        limits: on its cost.
        picture: (H, W, 3) shown on all of it in place of its own materials.

    Returns:
        The model in metres with y up; notes name the omissions.

    Raises:
        RefusedError: the file is broken, has no triangles, costs too much, or needs an unsupported feature.
    """
    document = GltfDocument(folder, name, limits)
    looks = _Looks(document, picture)
    with np.errstate(all="ignore"):  # an overflow gives vertices that are refused below
        for instances, primitives in _find_instances(document):
            for primitive in primitives:
                look = looks.find_look(primitive)
                if look is not None:
                    for vertices, faces, attribute in _read_triangles(document, primitive, instances):
                        looks.add_triangles(look, vertices, faces, attribute)
        parts = looks.build_parts()
    if not parts:
        raise document.refuse("it has no faces that are seen", "export the surface, not its points or lines")
    if not all(np.isfinite(part.vertices).all() for part in parts):
        raise document.refuse("it has vertices that are not finite numbers (NaN or infinity)")
    return SourceModel(parts, unit="m", up="y", notes=list(dict.fromkeys(document.notes)))


Attribute = Callable[[str, int], Floats | None]
"""Gives (F, 3, width) values of an attribute at the corners of the faces, None if it is absent."""


@dataclass(frozen=True)
class _Instances:
    """Places at which a mesh is shown."""

    matrices: Floats  # (K, 4, 4) mesh to scene
    weights: Sequence[float]  # of the morph targets
    joints: Floats | None = None  # (J, 4, 4) bind pose to scene, of a skinned mesh


def _find_instances(document: GltfDocument) -> Iterator[tuple[_Instances, list[Primitive]]]:
    """Each mesh of the default scene with all its places; triangles are counted before any is read."""
    gltf = document.gltf
    globals_ = _compute_global_matrices(document)
    groups: dict[tuple[int, int | None, tuple[float, ...]], list[int]] = {}
    for number in _find_visible_nodes(document):
        node = gltf.nodes[number]
        if node.mesh is not None:
            weights = document.find(gltf.meshes, node.mesh, "mesh").weights if node.weights is None else node.weights
            groups.setdefault((node.mesh, node.skin, tuple(weights)), []).append(number)
    total, left_out = 0, 0
    for (mesh, skin, _), numbers in groups.items():
        places = sum(1 if skin is not None else _count_instances(document, gltf.nodes[number]) for number in numbers)
        for primitive in gltf.meshes[mesh].primitives:
            if primitive.mode < 4:
                left_out += 1
            elif "POSITION" in primitive.attributes:
                total += places * _count_faces(document, primitive)
    if total > document.limits.faces:
        raise document.refuse(f"it has {total} faces, {document.limits.faces} are the most", "simplify it")
    if left_out:
        document.notes.append(f"{left_out} primitives of points or lines are left out")
    for (mesh, skin, weights), numbers in groups.items():
        if skin is not None:  # its joints alone place a skinned mesh
            joints = _compute_joint_matrices(document, skin, globals_)
            instances = _Instances(np.tile(np.eye(4), (len(numbers), 1, 1)), weights, joints)
        else:
            places = [globals_[number] @ _read_instances(document, gltf.nodes[number]) for number in numbers]
            instances = _Instances(np.concatenate(places), weights)
        yield instances, gltf.meshes[mesh].primitives


def _find_visible_nodes(document: GltfDocument) -> Iterator[int]:
    """The nodes of the default scene, else of the first scene, else all, in the order of the tree."""
    gltf = document.gltf
    if gltf.scenes:
        roots = document.find(gltf.scenes, gltf.scene or 0, "scene").nodes
    else:
        children = {child for node in gltf.nodes for child in node.children}
        roots = [number for number in range(len(gltf.nodes)) if number not in children]
    if len(gltf.scenes) > 1:
        document.notes.append(f"scene {gltf.scene or 0} of {len(gltf.scenes)} is read")
    stack, seen = list(reversed(roots)), set[int]()
    while stack:
        number = stack.pop()
        node = document.find(gltf.nodes, number, "node")
        if number not in seen and node.extensions.visibility.visible:
            seen.add(number)
            stack += reversed(node.children)
            yield number


_INSTANCE: Final = {"TRANSLATION": (0.0, 0.0, 0.0), "ROTATION": (0.0, 0.0, 0.0, 1.0), "SCALE": (1.0, 1.0, 1.0)}
"""Attributes of EXT_mesh_gpu_instancing that place an instance, with their defaults."""


def _count_instances(document: GltfDocument, node: SceneNode) -> int:
    if node.extensions.instancing is None:
        return 1
    attributes = node.extensions.instancing.attributes
    counts = {document.accessor(attributes[name]).count for name in _INSTANCE if name in attributes}
    if len(counts) != 1:
        raise document.refuse(f"{sorted(counts)} instances of EXT_mesh_gpu_instancing, a single number is needed")
    return counts.pop()


def _read_instances(document: GltfDocument, node: SceneNode) -> Floats:
    """(K, 4, 4) places of EXT_mesh_gpu_instancing relative to a node; the node's own without the extension."""
    if node.extensions.instancing is None:
        return np.eye(4)[None]
    attributes, count = node.extensions.instancing.attributes, _count_instances(document, node)
    values = {
        name: document.read_rows(attributes[name], width=len(default), normalized=name == "ROTATION")
        if name in attributes
        else np.tile(np.array(default), (count, 1))
        for name, default in _INSTANCE.items()
    }
    return _compose_matrices(values["TRANSLATION"], values["ROTATION"], values["SCALE"])


def _count_faces(document: GltfDocument, primitive: Primitive) -> int:
    index = primitive.attributes["POSITION"] if primitive.indices is None else primitive.indices
    corners = document.accessor(index).count
    return corners // 3 if primitive.mode == 4 else max(0, corners - 2)


_TRS: Final = ("translation", "rotation", "scale")


def _compute_global_matrices(document: GltfDocument) -> Floats:
    """(N, 4, 4) node to scene, for every node; a node with several parents has the transform of the first."""
    nodes = document.gltf.nodes
    if not nodes:
        return np.zeros((0, 4, 4))
    local = _compose_matrices(*(np.array([getattr(node, name) for node in nodes]) for name in _TRS))
    for number, node in enumerate(nodes):
        if node.matrix is not None:
            local[number] = np.array(node.matrix).reshape(4, 4).T
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.children:
            document.find(nodes, child, "node")
            parents.setdefault(child, number)
    matrices, placed = local.copy(), len(nodes) - len(parents)
    level = [number for number in range(len(nodes)) if number not in parents]
    while level:
        below: list[int] = [child for parent in level for child in nodes[parent].children if parents[child] == parent]
        level = list(dict.fromkeys(below))
        placed += len(level)
        matrices[level] = matrices[[parents[child] for child in level]] @ local[level]
    if placed < len(nodes):
        raise document.refuse("a node is below itself")
    return matrices


def _compose_matrices(translations: Floats, rotations: Floats, scales: Floats) -> Floats:
    """(N, 4, 4) from translations (N, 3), quaternions (N, 4) as x, y, z, w, and scales (N, 3)."""
    lengths = np.linalg.norm(rotations, axis=1, keepdims=True)
    x, y, z, w = np.where(lengths > 0, rotations / np.where(lengths > 0, lengths, 1), (0.0, 0.0, 0.0, 1.0)).T
    turns = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    matrices = np.tile(np.eye(4), (len(translations), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = turns * scales[:, None], translations
    return matrices


def _compute_joint_matrices(document: GltfDocument, index: int, globals_: Floats) -> Floats:
    """(J, 4, 4) transforms of the joints from the bind pose to the scene."""
    skin = document.find(document.gltf.skins, index, "skin")
    if skin.joints:
        document.find(document.gltf.nodes, max(skin.joints), "node")
    joints = globals_[np.array(skin.joints, np.int64)]
    if skin.inverse_bind_matrices is None or not len(joints):
        return joints
    count = document.accessor(skin.inverse_bind_matrices).count
    if count < len(joints):
        raise document.refuse(f"skin {index} has {len(joints)} joints and {count} inverse bind matrices")
    inverse = document.read_rows(skin.inverse_bind_matrices, np.arange(len(joints)), width=16)
    return joints @ inverse.reshape(-1, 4, 4).transpose(0, 2, 1)


def _read_triangles(
    document: GltfDocument, primitive: Primitive, instances: _Instances
) -> Iterator[tuple[Floats, Ints, Attribute]]:
    """The triangles of a primitive in the scene: vertices (N, 3), faces (F, 3) and the attributes of the corners."""
    if primitive.mode < 4 or "POSITION" not in primitive.attributes:
        return
    faces, rows = _read_faces_and_rows(document, primitive)
    if not len(faces):
        return
    used, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, 3).astype(np.int64)
    points = rows("POSITION", used, 3)
    if points is None:
        return
    for weight, target in zip(instances.weights, primitive.targets, strict=False):
        if weight and "POSITION" in target:
            points = points + weight * document.read_rows(target["POSITION"], used, width=3)
    if instances.joints is not None:
        points = _apply_skin(document, points, instances.joints, lambda name: rows(name, used, 4))
    matrices = instances.matrices
    placed = np.einsum("kij,nj->kni", matrices[:, :3, :3], points) + matrices[:, None, :3, 3]
    mirrored = np.linalg.det(matrices[:, :3, :3]) < 0
    if instances.joints is not None and len(instances.joints):
        mirrored ^= bool(np.median(np.linalg.det(instances.joints[:, :3, :3])) < 0)
    for turned in (False, True):
        chosen = placed[mirrored == turned]
        if len(chosen):
            order = faces[:, ::-1] if turned else faces
            every = (np.arange(len(chosen))[:, None, None] * len(points) + order).reshape(-1, 3)

            def attribute(name: str, width: int, order: Ints = order, count: int = len(chosen)) -> Floats | None:
                values = rows(name, used, width)
                return None if values is None else np.tile(values[order], (count, 1, 1))

            yield chosen.reshape(-1, 3), every, attribute


def _read_faces_and_rows(
    document: GltfDocument, primitive: Primitive
) -> tuple[Ints, Callable[[str, Ints, int], Floats | None]]:
    """Faces (F, 3) of a primitive, and a function that gives rows of its attributes as floats."""

    def stored_rows(name: str, rows: Ints, width: int) -> Floats | None:
        if name not in primitive.attributes:
            return None
        index = primitive.attributes[name]
        return document.read_rows(index, rows, width=width, normalized=name.startswith(_SHARES))

    draco, positions = primitive.extensions.draco, primitive.attributes["POSITION"]
    plain = document.has_plain_data(positions) and (
        primitive.indices is None or document.has_plain_data(primitive.indices)
    )
    if draco is not None and not plain:
        faces, arrays = document.decode_draco(draco)
        expected = _count_faces(document, primitive)
        if len(faces) > expected:
            raise document.refuse(f"KHR_draco_mesh_compression holds {len(faces)} faces, {expected} are declared")

        def decoded_rows(name: str, rows: Ints, width: int) -> Floats | None:
            if name not in arrays or name not in primitive.attributes:
                return stored_rows(name, rows, width)
            data = arrays[name]
            if data.shape[1] < width or not 0 <= int(rows.min()) <= int(rows.max()) < len(data):
                message = f"{name} of KHR_draco_mesh_compression has {len(data)} rows of {data.shape[1]} numbers"
                raise document.refuse(f"{message}, a face names row {rows.max()}")
            normalized = document.accessor(primitive.attributes[name]).normalized or name.startswith(_SHARES)
            return scale_integers(data[rows, :width], normalized)

        return faces, decoded_rows
    if primitive.indices is None:
        corners = np.arange(document.accessor(positions).count)
    else:
        corners = document.read_indices(primitive.indices)
    if primitive.mode == 4:
        faces = corners[: len(corners) // 3 * 3].reshape(-1, 3)
    elif primitive.mode == 5:
        odd = np.arange(max(0, len(corners) - 2)) % 2 == 1
        first, second, third = corners[:-2], corners[1:-1], corners[2:]
        faces = np.stack([first, np.where(odd, third, second), np.where(odd, second, third)], axis=1)
    else:
        faces = np.stack([corners[1:-1], corners[2:], np.repeat(corners[:1], max(0, len(corners) - 2))], axis=1)

    return faces, stored_rows


def _apply_skin(
    document: GltfDocument, points: Floats, joints: Floats, attribute: Callable[[str], Floats | None]
) -> Floats:
    """Linear blend skinning. Returns: vertices (N, 3) in the scene; those without weights stay."""
    blended, total = np.zeros((len(points), 3, 4)), np.zeros(len(points))
    for number in range(8):
        names, weights = attribute(f"JOINTS_{number}"), attribute(f"WEIGHTS_{number}")
        if names is None or weights is None:
            break
        if not ((names >= 0) & (names < len(joints))).all():
            raise document.refuse(f"a vertex names a joint beyond the {len(joints)} of its skin")
        for column in range(4):
            blended += weights[:, column, None, None] * joints[names[:, column].astype(np.int64), :3]
            total += weights[:, column]
    bound = total > 0
    moved = np.einsum("nij,nj->ni", blended[:, :, :3], points) + blended[:, :, 3]
    return np.where(bound[:, None], moved / np.where(bound, total, 1.0)[:, None], points)


@dataclass(frozen=True)
class _Look:
    """Look of a primitive: a picture times a colour, or the colour alone."""

    color: Rgb = (1.0, 1.0, 1.0)  # linear
    image: int | None = None
    opaque: bool = True  # the picture's transparency counts for nothing
    wraps: tuple[_Wrap, _Wrap] = ("repeat", "repeat")
    coordinates: str = "TEXCOORD_0"
    transform: TextureTransform | None = None


@dataclass
class _Piece:
    """Triangles of a look."""

    vertices: Floats  # (N, 3)
    faces: Ints  # (F, 3)
    uvs: Floats  # (F, 3, 2) glTF's: origin at the upper left
    tints: Floats | None  # (F, 3, 3) linear colours of the corners that multiply the picture


@dataclass
class _Group:
    """Pieces that share a picture and its colour."""

    look: _Look
    pieces: list[_Piece] = field(default_factory=list[_Piece])


class _Looks:
    """Triangles sorted by their looks."""

    def __init__(self, document: GltfDocument, picture: Image | None) -> None:
        self._document, self._picture = document, picture
        self._looks: dict[int | None, _Look | None] = {}
        self._groups: dict[tuple[Any, ...], _Group] = {}
        self._plain: list[tuple[Floats, Ints, Floats]] = []
        self._pictures: dict[int, Image | None] = {}
        self._pixels = _PICTURES * document.limits.pixels

    def find_look(self, primitive: Primitive) -> _Look | None:
        """The look of a primitive; None if it is invisible."""
        index = primitive.material
        if self._picture is not None and "TEXCOORD_0" in primitive.attributes:
            return _Look(image=_GIVEN)
        if index not in self._looks:
            materials = self._document.gltf.materials
            material = Material() if index is None else self._document.find(materials, index, "material")
            self._looks[index] = self._read_look(material)
        return self._looks[index]

    def add_triangles(self, look: _Look, vertices: Floats, faces: Ints, attribute: Attribute) -> None:
        """Sort in the triangles of a primitive."""
        color, uvs = look.color, None
        if look.image is not None:
            uvs = attribute(look.coordinates, 2)
            if uvs is not None and look.transform is not None:
                cosine, sine = math.cos(look.transform.rotation), math.sin(look.transform.rotation)
                # The extension's matrix has the opposite sign; its words, its test model and all viewers agree on this.
                turn = np.array([[cosine, sine], [-sine, cosine]])
                uvs = uvs * look.transform.scale @ turn.T + look.transform.offset
            if uvs is None or not (np.abs(uvs) < _FARTHEST).all():
                state = "missing" if uvs is None else "not finite"
                self._document.notes.append(f"{look.coordinates} is {state}: its picture is not shown")
                uvs = None
        tints = attribute("COLOR_0", 3) if look.image != _GIVEN else None
        if tints is not None:
            tints = np.clip(np.nan_to_num(tints), 0, 1)
            if np.ptp(tints.reshape(-1, 3), axis=0).max() < 1 / 512:
                red, green, blue = (round(float(share), 4) for share in tints[0, 0])
                color, tints = (color[0] * red, color[1] * green, color[2] * blue), None
        if uvs is None:
            shares = np.ones((len(faces), 3)) if tints is None else tints.mean(axis=1)
            self._plain.append((vertices, faces, shares * color))
            return
        key = (look.image, look.opaque, look.wraps, color)
        group = self._groups.setdefault(key, _Group(_Look(color, look.image, look.opaque, look.wraps)))
        group.pieces.append(_Piece(vertices, faces, uvs, tints))

    def build_parts(self) -> list[MeshPart]:
        """Build a part for each picture and colour, a second part if it has to be repainted, and a part of plain
        colours."""
        parts: list[MeshPart] = []
        edge = _EDGE
        if self._groups:  # in the asset's texture each has the smaller a place the more there are
            edge = max(16, min(_EDGE, math.isqrt(self._document.limits.pixels // len(self._groups))))
        for group in self._groups.values():
            look = group.look
            image = self._picture if look.image == _GIVEN else self._load_picture(look, edge)
            pieces = group.pieces
            starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
            vertices = np.concatenate([piece.vertices for piece in pieces])
            faces = np.concatenate([piece.faces + start for piece, start in zip(pieces, starts, strict=False)])
            uvs = np.concatenate([piece.uvs for piece in pieces])
            tints = None
            if any(piece.tints is not None for piece in pieces):
                white = [np.ones((len(piece.faces), 3, 3)) if piece.tints is None else piece.tints for piece in pieces]
                tints = np.concatenate(white)
            if image is None:
                color = np.tile(look.color, (len(faces), 1)) if tints is None else tints.mean(axis=1) * look.color
                self._plain.append((vertices, faces, color))
                continue
            uvs, fits = _move_into_picture(uvs, look.wraps)
            fits &= tints is None
            if len(self._groups) > _MOST_PICTURES:
                fits[:] = False
            rest = ~fits
            if fits.any():
                flipped = np.stack([uvs[fits, :, 0], 1 - uvs[fits, :, 1]], axis=2)
                parts.append(MeshPart(vertices, faces[fits], flipped, image))
            colors = None if tints is None else tints[rest]
            if len(self._groups) > _MOST_PICTURES or int(rest.sum()) > _MOST_PAINTED:
                shares = _LINEAR[_sample_picture(image, uvs[rest].mean(axis=1), look.wraps)]
                self._plain.append((vertices, faces[rest], shares if colors is None else shares * colors.mean(axis=1)))
            elif rest.any():
                painted, places = _paint_faces(image, uvs[rest], look.wraps, colors, min(edge, _PAINTED))
                parts.append(MeshPart(vertices, faces[rest], places, painted))
        if self._plain:
            starts = np.cumsum([0, *(len(vertices) for vertices, _, _ in self._plain)])
            faces = np.concatenate([faces + start for (_, faces, _), start in zip(self._plain, starts, strict=False)])
            colors = _linear_to_srgb(np.concatenate([colors for _, _, colors in self._plain]))
            parts.append(MeshPart(np.concatenate([vertices for vertices, _, _ in self._plain]), faces, colors=colors))
        return parts

    def _read_look(self, material: Material) -> _Look | None:
        """The base colour of metallic-roughness, specular-glossiness and unlit materials."""
        gloss = material.extensions.specular_glossiness
        pbr = material.pbr_metallic_roughness
        factor, info = pbr.base_color_factor, pbr.base_color_texture
        if gloss is not None:
            factor, info = gloss.diffuse_factor, gloss.diffuse_texture
        alpha = factor[3] if len(factor) > 3 else 1.0
        hidden = {"BLEND": alpha <= 0, "MASK": alpha < material.alpha_cutoff}.get(material.alpha_mode, False)
        if hidden:
            self._document.notes.append("faces of transparent materials are left out")
            return None
        color = _clip_color(factor[:3])
        if any(glow := _clip_color(material.emissive_factor)):
            if not any(color):  # emissive texture, without shading
                color, info = glow, material.emissive_texture
            elif info is None and material.emissive_texture is None:
                color = _clip_color([base + more for base, more in zip(color, glow, strict=True)])
            else:
                self._document.notes.append("the light that its materials emit is not shown")
        if info is None:
            return _Look(color)
        gltf, transform = self._document.gltf, info.extensions.transform
        texture = self._document.find(gltf.textures, info.index, "texture")
        image = texture.image()
        if image is None:
            self._document.notes.append(f"texture {info.index} has no picture: its material's colour alone is shown")
            return _Look(color)
        wraps: tuple[_Wrap, _Wrap] = ("repeat", "repeat")
        if texture.sampler is not None:
            sampler = self._document.find(gltf.samplers, texture.sampler, "sampler")
            wraps = (_WRAPS.get(sampler.wrap_s, "repeat"), _WRAPS.get(sampler.wrap_t, "repeat"))
        number = info.tex_coord
        if transform is not None and transform.tex_coord is not None:
            number = transform.tex_coord
        return _Look(color, image, material.alpha_mode not in ("MASK", "BLEND"), wraps, f"TEXCOORD_{number}", transform)

    def _load_picture(self, look: _Look, edge: int) -> Image | None:
        """The picture of a look times its colour, at most ``edge`` px; None if its file does not exist."""
        index = look.image
        if index is None:
            return None
        if index not in self._pictures:
            data = self._document.read_picture(index)
            self._pictures[index] = None if data is None else self._decode_picture(index, data, edge)
        rgba = self._pictures[index]
        if rgba is None:
            return None
        table = _linear_to_srgb(_LINEAR[:, None] * look.color)
        rgb = np.stack([table[rgba[:, :, channel], channel] for channel in range(3)], axis=2)
        if look.opaque:
            return rgb
        alpha = rgba[:, :, 3:].astype(np.uint16)
        return ((rgb * alpha + 255 * (255 - alpha) + 127) // 255).astype(np.uint8)

    def _decode_picture(self, index: int, data: bytes, edge: int) -> Image:
        """(H, W, 4) the picture, at most ``edge`` px."""
        from PIL import Image as Pictures

        if data[:4] == _KTX2:
            message = f"image {index} is a KTX2 picture of KHR_texture_basisu, which is not read"
            raise self._document.refuse(message, "export it with PNG or JPEG textures")
        limit = self._document.limits.pixels
        try:
            opened: Any = Pictures.open(io.BytesIO(data), formats=_FORMATS)
            width, height = opened.size
            if width * height > limit or min(width, height) < 1:
                message = f"image {index} has {width} x {height} px, {limit} are the most"
                raise self._document.refuse(message, "make it smaller")
            self._pixels -= width * height
            if self._pixels < 0:
                message = f"its pictures have more than {_PICTURES * limit} px together"
                raise self._document.refuse(message, "make them smaller")
            if opened.mode.startswith("I"):  # 16 bits of grey
                values = np.asarray(opened, np.float64)
                opened = Pictures.fromarray((values / 257).clip(0, 255).astype(np.uint8))
            if opened.mode not in ("L", "LA", "RGB", "RGBA"):
                opened = opened.convert("RGBA")
            if (longest := max(width, height)) > edge:
                size = (max(1, round(width * edge / longest)), max(1, round(height * edge / longest)))
                opened = opened.resize(size, Pictures.Resampling.LANCZOS, reducing_gap=3.0)
            return np.asarray(opened.convert("RGBA"), np.uint8)
        except RefusedError:
            raise
        except (*_DECODER_ERRORS, Pictures.DecompressionBombError) as error:
            message = f"image {index} is no picture: {str(error)[:120]}"
            raise self._document.refuse(message, "convert it to PNG") from error


def _clip_color(values: Sequence[float]) -> Rgb:
    red, green, blue = (min(max(float(value), 0.0), 1.0) for value in values)
    return red, green, blue


def _move_into_picture(uvs: Floats, wraps: tuple[_Wrap, _Wrap]) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Wrap coordinates (F, 3, 2) into the picture, for faces that show a single copy of it.

    Returns:
        The coordinates, and (F,) which faces are in the picture; the others keep their coordinates.
    """
    moved, fits = uvs.copy(), np.ones(len(uvs), np.bool_)
    for axis, wrap in enumerate(wraps):
        values = uvs[:, :, axis]
        low, high = values.min(axis=1), values.max(axis=1)
        small = high - low <= _SMALL
        inside = low + _TILE
        inside[small] = (low[small] + high[small]) / 2
        copy = np.zeros(len(uvs)) if wrap == "clamp" else np.floor(inside)
        local = values - copy[:, None]
        if wrap == "mirror":
            local = np.where(copy[:, None] % 2 == 1, 1 - local, local)
        fits &= small | ((local >= -_TILE) & (local <= 1 + _TILE)).all(axis=1)
        moved[:, :, axis] = np.clip(local, 0, 1)
    return np.where(fits[:, None, None], moved, uvs), fits


def _paint_faces(
    image: Image, uvs: Floats, wraps: tuple[_Wrap, _Wrap], tints: Floats | None, edge: int
) -> tuple[Image, Floats]:
    """A picture in which each face has a place of its own, painted as the picture repeats there, times the tints.

    Args:
        image: (H, W, 3).
        uvs: (F, 3, 2) origin at the upper left.
        wraps: how the picture continues along u and v.
        tints: (F, 3, 3) linear colours of the corners.
        edge: about the side of the result, px.

    Returns:
        The picture, and (F, 3, 2) the coordinates of the corners in it, origin at the lower left.
    """
    squares = lay_out_face_squares(len(uvs), edge)
    painted = np.zeros((squares.side**2, 3), np.uint8)
    for start in range(0, len(squares.face), _CHUNK):
        part = slice(start, start + _CHUNK)
        face, weights = squares.face[part], squares.weights[part]
        texels = _sample_picture(image, np.einsum("ij,ijk->ik", weights, uvs[face]), wraps)
        if tints is not None:
            shares = np.einsum("ij,ijk->ik", weights, tints[face])
            texels = _linear_to_srgb(_LINEAR[texels] * shares)
        painted[squares.texel[part]] = texels
    return painted.reshape(squares.side, squares.side, 3), squares.uvs


def _sample_picture(image: Image, points: Floats, wraps: tuple[_Wrap, _Wrap]) -> Image:
    """(N, 3) colours of a picture at coordinates (N, 2), origin at the upper left, also beyond its edges."""
    cells: list[Ints] = []
    for axis, (wrap, count) in enumerate(zip(wraps, (image.shape[1], image.shape[0]), strict=True)):
        local = points[:, axis]
        if wrap == "repeat":
            local = local - np.floor(local)
        elif wrap == "mirror":
            local = 1 - np.abs(local % 2 - 1)
        cells.append(np.clip(local * count, 0, count - 1).astype(np.int64))
    return image[cells[1], cells[0]]


_SRGB: Final = np.arange(256) / 255
_LINEAR: Final[Floats] = np.where(_SRGB <= 0.04045, _SRGB / 12.92, ((_SRGB + 0.055) / 1.055) ** 2.4)
"""Linear shares of the 256 values of a picture."""


def _linear_to_srgb(values: Floats) -> Image:
    """sRGB as 8 bits of linear shares."""
    shares = np.clip(values, 0, 1)
    curved = np.where(shares <= 0.0031308, 12.92 * shares, 1.055 * shares ** (1 / 2.4) - 0.055)
    return np.rint(curved * 255).astype(np.uint8)
