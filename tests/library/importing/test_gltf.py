"""glTF and GLB: shape and base colour as the format says, anything else refused by name."""

import json
import struct
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import features

from grs_agents.library.importing.mesh_reader import read_mesh
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.texture_atlas import merge_mesh_parts
from grs_agents.library.importing.types import ImportOptions, MeshPart, RefusedError
from tests.cli.command import grs
from tests.library.importing.gltf_files import BLUE, GREEN, RED, SIZE, WHITE, GltfFile, box_arrays, quarters
from tests.needs import require

LIMITS = ImportOptions().limits
TRANSFORM, DRACO, MESHOPT = "KHR_texture_transform", "KHR_draco_mesh_compression", "EXT_meshopt_compression"
INSTANCING, QUANTIZATION, GLOSS = (
    "EXT_mesh_gpu_instancing",
    "KHR_mesh_quantization",
    "KHR_materials_pbrSpecularGlossiness",
)


def read(path: Path) -> Any:
    """The model of a file."""
    return read_mesh(SourceFolder(path.parent, LIMITS.bytes), path.name, LIMITS)


def points_of(parts: list[MeshPart]) -> Any:
    """(3 F, 3) the corners of all faces."""
    return np.concatenate([part.vertices[part.faces].reshape(-1, 3) for part in parts])


def volume_of(parts: list[MeshPart]) -> float:
    """The volume that the faces enclose; negative if they look inwards."""
    corners = np.concatenate([part.vertices[part.faces] for part in parts])
    return float(np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6)


def colors_of(parts: list[MeshPart]) -> set[tuple[int, ...]]:
    """The colours that are seen well inside the faces."""
    seen: set[tuple[int, ...]] = set()
    for part in parts:
        if part.image is None or part.uvs is None:
            assert part.colors is not None
            seen |= {tuple(color) for color in part.colors.tolist()}
            continue
        height, width = part.image.shape[:2]
        for weights in ((0.8, 0.1, 0.1), (0.1, 0.8, 0.1), (0.1, 0.1, 0.8)):
            u, v = np.einsum("c,fcx->xf", weights, part.uvs)
            assert u.min() >= 0 and u.max() <= 1 and v.min() >= 0 and v.max() <= 1
            columns, rows = (u * width).astype(int), ((1 - v) * height).astype(int)
            seen |= {tuple(color) for color in part.image[rows, columns].tolist()}
    return seen


def quantized(file: GltfFile) -> None:
    positions, _, _ = box_arrays((2.0, 2.0, 2.0))
    padded = np.zeros((24, 4), "i2")
    padded[:, :3] = np.rint(positions * 32767)
    file.primitive["attributes"]["POSITION"] = file.accessor(padded, normalized=True, type="VEC3")
    file.json["bufferViews"][-1]["byteStride"] = 8
    file.node["scale"] = [extent / 2 for extent in SIZE]
    file.require(QUANTIZATION)


def quantized_without_normalization(file: GltfFile) -> None:
    positions, _, _ = box_arrays((200.0, 200.0, 200.0))
    file.attribute("POSITION", (positions + 100).astype("u1"))
    file.node.update(scale=[extent / 200 for extent in SIZE], translation=[1, 2, 3])
    file.require(QUANTIZATION)


def sparse_alone(file: GltfFile) -> None:
    positions, _, _ = box_arrays()
    sparse = {
        "count": 24,
        "indices": {"bufferView": file.view(np.arange(24, dtype="u1").tobytes()), "componentType": 5121},
        "values": {"bufferView": file.view(positions.tobytes())},
    }
    file.attribute("POSITION", positions, sparse=sparse)
    del file.json["accessors"][-1]["bufferView"]


def sparse_over_others(file: GltfFile) -> None:
    positions, _, _ = box_arrays()
    wrong = positions.copy()
    wrong[[3, 17]] = 9.0
    sparse = {
        "count": 2,
        "indices": {"bufferView": file.view(np.array([17, 3], "u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": file.view(positions[[17, 3]].tobytes())},
    }
    file.attribute("POSITION", wrong, sparse=sparse)


def interleaved(file: GltfFile) -> None:
    positions, _, _ = box_arrays()
    rows = np.concatenate([np.full((24, 2), 7, "f4"), positions], axis=1)
    file.attribute("POSITION", rows.ravel(), byteOffset=8, count=24, type="VEC3")
    file.json["bufferViews"][-1]["byteStride"] = 20


def without_indices(file: GltfFile) -> None:
    positions, _, indices = box_arrays()
    del file.primitive["indices"]
    file.attribute("POSITION", positions[indices])


def strips(file: GltfFile) -> None:
    file.json["meshes"][0]["primitives"] = [
        {
            "attributes": file.primitive["attributes"],
            "mode": 5,
            "indices": file.accessor(np.array(order, "u4") + 4 * side),
        }
        for side in range(6)
        for order in [(0, 1, 3, 2)]
    ]


def fans(file: GltfFile) -> None:
    file.json["meshes"][0]["primitives"] = [
        {
            "attributes": file.primitive["attributes"],
            "mode": 6,
            "indices": file.accessor(np.arange(4, dtype="u1") + 4 * side),
        }
        for side in range(6)
    ]


def matrix_of_node(file: GltfFile) -> None:
    # 2 x larger, x to y, y to z, z to x; column by column
    file.node["matrix"] = [0, 2, 0, 0, 0, 0, 2, 0, 2, 0, 0, 0, 5, 5, 5, 1]


def chain_of_nodes(file: GltfFile) -> None:
    file.json["nodes"] = [
        {"children": [1], "scale": [2, 2, 2], "translation": [1, 0, 0]},
        {"children": [2], "rotation": [0, 0, 2**0.5 / 2, 2**0.5 / 2]},
        {"mesh": 0, "translation": [0, 3, 0]},
    ]


def mirrored(file: GltfFile) -> None:
    file.node["scale"] = [-1, 1, 1]


def two_nodes(file: GltfFile) -> None:
    file.json["nodes"] = [{"mesh": 0}, {"mesh": 0, "translation": [0.2, 0, 0]}]
    file.json["scenes"] = [{"nodes": [0, 1]}]


def second_scene(file: GltfFile) -> None:
    file.json["nodes"] = [{"mesh": 0, "scale": [9, 9, 9]}, {"mesh": 0}]
    file.json.update(scenes=[{"nodes": [0]}, {"nodes": [1]}], scene=1)


def hidden_node(file: GltfFile) -> None:
    hidden = {"KHR_node_visibility": {"visible": False}}
    file.json["nodes"] = [{"mesh": 0}, {"children": [2], "extensions": hidden}, {"mesh": 0, "translation": [9, 9, 9]}]
    file.json["scenes"] = [{"nodes": [0, 1]}]


def instanced(file: GltfFile) -> None:
    turned = np.array([[0, 0, 0, 1], [0, 0, 2**0.5 / 2, 2**0.5 / 2]], "f4")
    attributes = {
        "TRANSLATION": file.accessor(np.array([[0, 0, 0], [0.2, 0, 0]], "f4")),
        "ROTATION": file.accessor(np.rint(turned * 32767).astype("i2"), normalized=True),
        "SCALE": file.accessor(np.array([[1, 1, 1], [1, 1, 2]], "f4")),
    }
    file.node["extensions"] = {INSTANCING: {"attributes": attributes}}
    file.require(INSTANCING)


def morphed(file: GltfFile) -> None:
    positions, _, _ = box_arrays()
    wide = positions * np.array([2, 0, 0], "f4")
    file.primitive["targets"] = [{"POSITION": file.accessor(wide)}, {"POSITION": file.accessor(positions * 9)}]
    file.json["meshes"][0]["weights"] = [0.5, 0.0]


def morphed_by_node(file: GltfFile) -> None:
    morphed(file)
    file.node["weights"] = [1.0, 0.0]


def skinned(file: GltfFile) -> None:
    # The joint is 2 x larger than in the bind pose; the node's own transform counts for nothing.
    file.attribute("JOINTS_0", np.zeros((24, 4), "u1"))
    file.attribute("WEIGHTS_0", np.tile(np.array([255, 0, 0, 0], "u1"), (24, 1)), normalized=True)
    inverse = file.accessor(np.diag([0.5, 0.5, 0.5, 1]).astype("f4").reshape(1, 16))
    file.json["skins"] = [{"joints": [1], "inverseBindMatrices": inverse}]
    file.json["nodes"] = [{"mesh": 0, "skin": 0, "scale": [9, 9, 9]}, {"scale": [4, 4, 4]}]


def skinned_by_a_mirror(file: GltfFile) -> None:
    skinned(file)
    file.json["nodes"][1]["scale"] = [-4, 4, 4]


def compressed_by_draco(file: GltfFile) -> None:
    require("DracoPy")
    import DracoPy

    positions, uvs, indices = box_arrays()
    data = DracoPy.encode(
        positions, indices.reshape(-1, 3).astype("u4"), tex_coord=uvs.astype("f8"), quantization_bits=14
    )
    decoded = DracoPy.decode(data)
    numbers = {entry["attribute_type"]: entry["unique_id"] for entry in decoded.attributes}
    for accessor in file.json["accessors"]:
        accessor.pop("bufferView", None)
    file.json["accessors"][file.primitive["attributes"]["POSITION"]]["count"] = len(decoded.points)
    file.json["bufferViews"] = []
    attributes = {"POSITION": numbers[0], "TEXCOORD_0": numbers[3]}
    file.primitive["extensions"] = {DRACO: {"bufferView": file.view(data), "attributes": attributes}}
    file.require(DRACO)


def points_beside(file: GltfFile) -> None:
    far = {"attributes": {"POSITION": file.accessor(np.full((1, 3), 9, "f4"))}, "mode": 0}
    file.json["meshes"][0]["primitives"].append(far)


def as_it_is(file: GltfFile) -> None:
    pass


X, Y, Z = SIZE


@pytest.mark.parametrize(
    ("change", "size"),
    [
        (as_it_is, SIZE),
        (quantized, SIZE),
        (quantized_without_normalization, SIZE),
        (sparse_alone, SIZE),
        (sparse_over_others, SIZE),
        (interleaved, SIZE),
        (without_indices, SIZE),
        (strips, SIZE),
        (fans, SIZE),
        (matrix_of_node, (2 * Z, 2 * X, 2 * Y)),
        (chain_of_nodes, (2 * Y, 2 * X, 2 * Z)),
        (mirrored, SIZE),
        (two_nodes, (X + 0.2, Y, Z)),
        (second_scene, SIZE),
        (hidden_node, SIZE),
        (instanced, (X / 2 + 0.2 + Y / 2, X, 2 * Z)),
        (morphed, (2 * X, Y, Z)),
        (morphed_by_node, (3 * X, Y, Z)),
        (skinned, (2 * X, 2 * Y, 2 * Z)),
        (skinned_by_a_mirror, (2 * X, 2 * Y, 2 * Z)),
        (compressed_by_draco, SIZE),
        (points_beside, SIZE),
    ],
)
def test_every_way_to_say_a_shape_gives_its_size_and_its_outside(
    change: Callable[[GltfFile], None], size: tuple[float, float, float], tmp_path: Path
) -> None:
    file = GltfFile()
    change(file)
    model = read(file.write(tmp_path / "box.glb"))
    assert (model.unit, model.up) == ("m", "y")
    assert np.ptp(points_of(model.parts), axis=0) == pytest.approx(size, abs=2e-5)
    assert volume_of(model.parts) > 0.9 * X * Y * Z


@pytest.mark.parametrize("buffer", ["chunk", "data", "file"])
def test_buffers_are_chunks_data_uris_and_files_with_percent_codes(buffer: Any, tmp_path: Path) -> None:
    file = GltfFile()
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture()})
    path = file.write(tmp_path / ("box.glb" if buffer == "chunk" else "box.gltf"), buffer)
    model = read(path)
    assert np.ptp(points_of(model.parts), axis=0) == pytest.approx(SIZE, abs=1e-6)
    assert colors_of(model.parts) == {RED, GREEN, BLUE, WHITE}


def factor(file: GltfFile) -> None:
    file.paint(pbrMetallicRoughness={"baseColorFactor": [0.2, 0.2, 0.2, 1]})


def factor_times_picture(file: GltfFile) -> None:
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture(), "baseColorFactor": [0.2, 0, 0.2, 1]})


def vertex_colors(file: GltfFile) -> None:
    file.attribute("COLOR_0", np.tile(np.array([0.2, 0.0, 1.0], "f4"), (24, 1)))


def vertex_colors_of_bytes(file: GltfFile) -> None:
    file.attribute("COLOR_0", np.tile(np.array([51, 0, 255, 255], "u1"), (24, 1)))  # ``normalized`` is forgotten


def vertex_colors_times_factor(file: GltfFile) -> None:
    file.attribute("COLOR_0", np.tile(np.array([0.4, 1.0, 1.0], "f4"), (24, 1)))
    file.paint(pbrMetallicRoughness={"baseColorFactor": [0.5, 0, 1, 1]})


def vertex_colors_times_picture(file: GltfFile) -> None:
    halves = np.zeros((24, 3), "f4")
    halves[:12], halves[12:] = (1, 0, 0), (0, 0, 1)
    file.attribute("COLOR_0", halves)
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture()})


def glossy_factor(file: GltfFile) -> None:
    file.paint(extensions={GLOSS: {"diffuseFactor": [0.2, 0, 1, 1], "glossinessFactor": 0.3}})
    file.json["extensionsUsed"] = [GLOSS]


def glossy_picture(file: GltfFile) -> None:
    white = {"baseColorFactor": [1, 1, 1, 1]}
    file.paint(extensions={GLOSS: {"diffuseTexture": file.texture()}}, pbrMetallicRoughness=white)


def unlit(file: GltfFile) -> None:
    factor(file)
    file.json["materials"][0]["extensions"] = {"KHR_materials_unlit": {}}
    file.require("KHR_materials_unlit")


def glowing(file: GltfFile) -> None:
    black = {"baseColorFactor": [0, 0, 0, 1]}
    file.paint(pbrMetallicRoughness=black, emissiveFactor=[1, 1, 1], emissiveTexture=file.texture())


def second_coordinates(file: GltfFile) -> None:
    file.attribute("TEXCOORD_1", np.full((24, 2), 0.25, "f4"))
    file.paint(pbrMetallicRoughness={"baseColorTexture": {**file.texture(), "texCoord": 1}})


def coordinates_of_bytes(file: GltfFile) -> None:
    file.attribute("TEXCOORD_0", np.full((24, 2), 191, "u1"), normalized=True)
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture()})


def transformed(file: GltfFile, **transform: Any) -> None:
    file.paint(pbrMetallicRoughness={"baseColorTexture": {**file.texture(), "extensions": {TRANSFORM: transform}}})
    file.require(TRANSFORM)


def moved(file: GltfFile) -> None:
    transformed(file, offset=[0.55, 0.05], scale=[0.4, 0.4])


def turned(file: GltfFile) -> None:
    transformed(
        file, offset=[0.05, 0.95], rotation=np.pi / 2, scale=[0.4, 0.4]
    )  # the lower left, by the extension's text


def transformed_set(file: GltfFile) -> None:
    file.attribute("TEXCOORD_2", np.full((24, 2), 0.75, "f4"))
    transformed(file, texCoord=2, offset=[0, 0])


def repeated(file: GltfFile) -> None:
    transformed(file, scale=[2, 2])


def beyond_the_edge(file: GltfFile) -> None:
    transformed(file, offset=[7.05, -2.95], scale=[0.4, 0.4])


def clamped(file: GltfFile) -> None:
    _, uvs, _ = box_arrays()
    file.attribute("TEXCOORD_0", uvs + 5)
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture(wrapS=33071, wrapT=33071)})


def flipped(file: GltfFile) -> None:
    _, uvs, _ = box_arrays()
    file.attribute("TEXCOORD_0", (uvs * 0.4 + np.array([1.05, 0.05], "f4")).astype("f4"))
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture(wrapS=33648)})


def opaque_with_alpha(file: GltfFile) -> None:
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture(quarters(alpha=0))})


def transparent(file: GltfFile) -> None:
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture(quarters(alpha=0))}, alphaMode="BLEND")


def in_webp(file: GltfFile) -> None:
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture(quarters("WEBP"))})
    file.json["textures"] = [{"extensions": {"EXT_texture_webp": {"source": 0}}}]
    file.require("EXT_texture_webp")


def in_ktx2_and_png(file: GltfFile) -> None:
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture()})
    file.json["images"].append({"bufferView": file.view(b"\xabKTX 20\xbb" + bytes(80)), "mimeType": "image/ktx2"})
    file.json["textures"] = [{"source": 0, "extensions": {"KHR_texture_basisu": {"source": 1}}}]
    file.json["extensionsUsed"] = ["KHR_texture_basisu"]


def without_its_picture(file: GltfFile) -> None:
    info = file.texture()
    file.json["images"] = [{"uri": "lost.png"}]
    file.paint(pbrMetallicRoughness={"baseColorTexture": info, "baseColorFactor": [0.2, 0, 1, 1]})


def textured_draco(file: GltfFile) -> None:
    compressed_by_draco(file)
    moved(file)
    file.require(TRANSFORM, DRACO)


ALL = {RED, GREEN, BLUE, WHITE}


@pytest.mark.parametrize(
    ("change", "colors"),
    [
        (as_it_is, {WHITE}),
        (factor, {(124, 124, 124)}),
        (factor_times_picture, {(124, 0, 0), (0, 0, 0), (0, 0, 124), (124, 0, 124)}),
        (vertex_colors, {(124, 0, 255)}),
        (vertex_colors_of_bytes, {(124, 0, 255)}),
        (vertex_colors_times_factor, {(124, 0, 255)}),
        (vertex_colors_times_picture, {RED, BLUE, (0, 0, 0)}),
        (glossy_factor, {(124, 0, 255)}),
        (glossy_picture, ALL),
        (unlit, {(124, 124, 124)}),
        (glowing, ALL),
        (second_coordinates, {RED}),
        (coordinates_of_bytes, {WHITE}),
        (moved, {GREEN}),
        (turned, {BLUE}),
        (transformed_set, {WHITE}),
        (repeated, ALL),
        (beyond_the_edge, {RED}),
        (clamped, {WHITE}),
        (flipped, {GREEN}),
        (opaque_with_alpha, ALL),
        (transparent, {WHITE}),
        (in_webp, ALL),
        (in_ktx2_and_png, ALL),
        (without_its_picture, {(124, 0, 255)}),
        (textured_draco, {GREEN}),
    ],
)
def test_every_way_to_say_a_base_colour_gives_it(
    change: Callable[[GltfFile], None], colors: set[tuple[int, int, int]], tmp_path: Path
) -> None:
    file = GltfFile()
    change(file)
    model = read(file.write(tmp_path / "box.glb"))
    assert colors_of(model.parts) == colors
    assert np.ptp(points_of(model.parts), axis=0) == pytest.approx(SIZE, abs=1e-5)


def test_a_repeated_picture_shows_its_copies_where_they_are(tmp_path: Path) -> None:
    file = GltfFile()
    repeated(file)
    (part,) = read(file.write(tmp_path / "box.glb")).parts
    first = part.uvs[0]  # corners at (0, 1), (1, 1), (1, 0) of the side
    spots = {
        (0.15, 0.9): BLUE,
        (0.3, 0.9): WHITE,
        (0.6, 0.9): BLUE,
        (0.8, 0.9): WHITE,
        (0.8, 0.6): GREEN,
        (0.6, 0.6): RED,
    }
    height, width = part.image.shape[:2]
    for (u, v), color in spots.items():
        at = first[0] + u * (first[1] - first[0]) + (1 - v) * (first[2] - first[1])
        assert tuple(part.image[int((1 - at[1]) * height), int(at[0] * width)]) == color, (u, v)


def test_what_is_left_out_is_noted(tmp_path: Path) -> None:
    file = GltfFile()
    points_beside(file)
    file.paint(pbrMetallicRoughness={"baseColorFactor": [1, 1, 1, 1]})
    glass = {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0]}, "alphaMode": "BLEND"}
    file.json["materials"].append(glass)
    hidden = {**file.primitive, "material": 1, "attributes": {"POSITION": file.accessor(box_arrays((9, 9, 9))[0])}}
    file.json["meshes"][0]["primitives"].append(hidden)
    file.json["scenes"].append({"nodes": []})
    file.json["extensionsUsed"] = ["ACME_sparkle", "KHR_lights_punctual"]
    model = read(file.write(tmp_path / "box.glb"))
    assert np.ptp(points_of(model.parts), axis=0) == pytest.approx(SIZE, abs=1e-6)
    noted = " | ".join(model.notes)
    assert all(words in noted for words in ("points or lines", "transparent", "scene 0 of 2", "ACME_sparkle"))
    assert "KHR_lights_punctual" not in noted


def test_a_picture_that_is_given_stands_for_the_materials(tmp_path: Path) -> None:
    file = GltfFile()
    factor(file)
    path = file.write(tmp_path / "box.glb")
    (tmp_path / "label.png").write_bytes(quarters())
    model = read_mesh(SourceFolder(tmp_path, LIMITS.bytes), path.name, LIMITS, "label.png")
    assert colors_of(model.parts) == ALL


def test_more_pictures_than_a_texture_has_room_for_become_plain_colours(tmp_path: Path) -> None:
    file = GltfFile()
    moved(file)
    info = file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    factors = [[0, 0.5 + number / 600, 0, 1] for number in range(300)]
    file.json["materials"] = [
        {"pbrMetallicRoughness": {"baseColorTexture": info, "baseColorFactor": factor}} for factor in factors
    ]
    primitives = [{**file.primitive, "material": number} for number in range(300)]
    file.json["meshes"] = [{"primitives": primitives}]
    (part,) = read(file.write(tmp_path / "box.glb")).parts
    assert part.image is None and part.colors is not None
    assert part.colors[:, 1].min() == 188 and part.colors[:, 1].max() > 250 and not part.colors[:, [0, 2]].any()


def test_a_model_of_many_meshes_and_a_single_picture_is_a_single_part(tmp_path: Path) -> None:
    file = GltfFile()
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture()})
    file.json["nodes"] = [{"mesh": 0, "translation": [number, 0, 0]} for number in range(50)]
    file.json["scenes"] = [{"nodes": list(range(50))}]
    (part,) = read(file.write(tmp_path / "box.glb")).parts
    assert len(part.faces) == 600
    assert merge_mesh_parts([part], 64).image.shape == (16, 16, 3)


def with_accessor(**properties: Any) -> Callable[[GltfFile], None]:
    """Change the accessor of the positions."""
    return lambda file: file.json["accessors"][0].update(properties)


def with_json(**properties: Any) -> Callable[[GltfFile], None]:
    """Change the file's JSON."""
    return lambda file: file.json.update(properties)


def with_meshopt(file: GltfFile) -> None:
    for view in file.json["bufferViews"]:
        view["extensions"] = {
            MESHOPT: {"buffer": 0, "byteLength": 9, "byteStride": 4, "mode": "ATTRIBUTES", "count": 1}
        }
        view["buffer"] = 1
    file.json["buffers"] = [{}, {"byteLength": 9999, "extensions": {MESHOPT: {"fallback": True}}}]
    file.require(MESHOPT)


def with_ktx2(file: GltfFile) -> None:
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture(b"\xabKTX 20\xbb" + bytes(80))})
    file.json["textures"] = [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]
    file.require("KHR_texture_basisu")


def with_garbage_for_a_picture(file: GltfFile) -> None:
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture(b"no picture at all")})


def with_broken_avif(file: GltfFile) -> None:
    picture = bytearray(quarters("AVIF") if features.check("avif") else b"no decoder")
    picture[-40:] = b"\xff" * 40
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture(bytes(picture))})


def with_huge_picture(file: GltfFile) -> None:
    header = b"IHDR" + struct.pack(">II5B", 9000, 9000, 8, 2, 0, 0, 0)
    png = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    png += struct.pack(">I4s", 0, b"IDAT")
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture(png)})


def with_picture_elsewhere(file: GltfFile) -> None:
    file.paint(pbrMetallicRoughness={"baseColorTexture": file.texture()})
    file.json["images"] = [{"uri": "..%2f..%2f..%2fetc%2fpasswd"}]


def with_nan(file: GltfFile) -> None:
    positions, _, _ = box_arrays()
    positions[3, 1] = np.nan
    file.attribute("POSITION", positions)


def with_wild_index(file: GltfFile) -> None:
    file.primitive["indices"] = file.accessor(np.array([0, 1, 99], "u2"))


def with_million_instances(file: GltfFile) -> None:
    file.json["accessors"].append({"componentType": 5126, "count": 1_000_000, "type": "VEC3"})
    number = len(file.json["accessors"]) - 1
    file.node["extensions"] = {INSTANCING: {"attributes": {"TRANSLATION": number}}}


def with_zeros_without_end(file: GltfFile) -> None:
    file.json["accessors"].append({"componentType": 5126, "count": 10**11, "type": "VEC3"})
    file.primitive.update(attributes={"POSITION": len(file.json["accessors"]) - 1})
    del file.primitive["indices"]


def with_skin_without_joints(file: GltfFile) -> None:
    skinned(file)
    file.json["skins"][0]["joints"] = []


def with_sparse_out_of_range(file: GltfFile) -> None:
    sparse_over_others(file)
    file.json["accessors"][-1]["count"] = 10


def with_many_repeats(file: GltfFile) -> None:
    file.json["meshes"][0]["primitives"] *= 20_000
    file.json["nodes"] = [{"mesh": 0} for _ in range(20)]
    file.json["scenes"] = [{"nodes": list(range(20))}]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (with_meshopt, "EXT_meshopt_compression"),
        (with_ktx2, "KHR_texture_basisu"),
        (lambda file: file.require("ACME_splats", "KHR_lights_punctual"), "extension ACME_splats,"),
        (with_json(asset={"version": "1.0"}), "glTF 1.0"),
        (with_json(asset={"version": "2.1", "minVersion": "2.1"}), "glTF 2.1"),
        (with_json(asset={}), "asset.version"),
        (with_json(nodes=[{"mesh": 7}]), "mesh 7 of 1"),
        (with_json(nodes=[{"mesh": 0, "children": [0]}]), "below itself"),
        (with_json(nodes=[{"mesh": 0, "children": [4]}]), "node 4 of 1"),
        (with_json(nodes=[{"mesh": 0, "rotation": "round"}]), "rotation"),
        (with_json(scene=3), "scene 3 of 1"),
        (with_json(nodes=[{}]), "no faces"),
        (with_json(meshes=[{"primitives": [{"attributes": {}}]}]), "no faces"),
        (lambda file: file.primitive.update(mode=7), "mode"),
        (with_accessor(count=25), "accessor 0 ends at byte 300"),
        (with_accessor(byteOffset=4), "accessor 0 ends"),
        (with_accessor(type="SCALAR"), "3 numbers"),
        (with_accessor(componentType=5130), "componentType"),
        (with_accessor(bufferView=99), "bufferView 99"),
        (with_accessor(count=-1), "count"),
        (with_accessor(count=2**70), "count"),
        (with_json(bufferViews=[{"buffer": 0, "byteOffset": 1 << 30, "byteLength": 288}] * 3), "ends at byte"),
        (with_json(bufferViews=[{"buffer": 5, "byteLength": 288}] * 3), "buffer 5"),
        (with_garbage_for_a_picture, "no picture"),
        (with_broken_avif, "no picture"),
        (with_huge_picture, "9000 x 9000 px"),
        (with_picture_elsewhere, "leaves the source folder"),
        (with_nan, "not finite"),
        (with_wild_index, "vertex 99 of 24"),
        (with_million_instances, "12000000 faces"),
        (with_zeros_without_end, "33333333333 faces"),
        (with_many_repeats, "4800000 faces"),
        (with_skin_without_joints, "joint"),
        (with_sparse_out_of_range, "of 10"),
    ],
)
def test_what_cannot_be_read_as_it_is_meant_is_refused_by_name(
    change: Callable[[GltfFile], None], words: str, tmp_path: Path
) -> None:
    file = GltfFile()
    change(file)
    with pytest.raises(RefusedError) as caught:
        read(file.write(tmp_path / "box.glb"))
    assert words in caught.value.message and caught.value.message.startswith("box.glb")
    assert caught.value.remedy


def test_draco_without_its_package_is_refused_with_the_way_to_get_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = GltfFile()
    for accessor in file.json["accessors"]:
        del accessor["bufferView"]
    file.primitive["extensions"] = {DRACO: {"bufferView": 0, "attributes": {"POSITION": 0}}}
    file.require(DRACO)
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(RefusedError, match=rf"{DRACO}.*pip install"):
        read(file.write(tmp_path / "box.glb"))


def test_compressed_meshes_with_plain_ones_beside_need_no_package(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = GltfFile()
    file.primitive["extensions"] = {DRACO: {"bufferView": 0, "attributes": {"POSITION": 0}}}
    file.json["extensionsUsed"] = [DRACO, MESHOPT]
    for view in file.json["bufferViews"]:
        view["extensions"] = {
            MESHOPT: {"buffer": 0, "byteLength": 9, "byteStride": 4, "mode": "ATTRIBUTES", "count": 1}
        }
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    model = read(file.write(tmp_path / "box.glb"))
    assert np.ptp(points_of(model.parts), axis=0) == pytest.approx(SIZE, abs=1e-6)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"glTF" + bytes(range(200)), "version"),
        (b"glTF" + struct.pack("<II", 1, 100) + bytes(90), "glTF 1.0"),
        (b"glTF" + struct.pack("<IIII", 2, 100, 9999, 0x4E4F534A), "cut off"),
        (b"glTF" + struct.pack("<IIII", 2, 20, 0, 0x4E4F534A), "JSON"),
        (b"{", "JSON"),
        (b"[]", "object"),
        (b'{"asset": {"version": "1.0"}, "meshes": {"mesh_1": {}}}', "glTF 1.0"),
        (b'{"asset": {"version": "2.0"}, "nodes": ' + b"[" * 100_000, "JSON"),
        (b'{"asset": {"version": "2.0"}, "extras": [' + b"[]," * 2_000_000 + b"0]}", "are the most"),
        (b'{"asset": {"version": "2.0"}, "nodes": [{"scale": [NaN, 1, 1]}]}', "finite"),
        (b"\xff\xfe{}", "JSON"),
    ],
)
def test_broken_containers_are_refused(content: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "box.gltf"
    path.write_bytes(content)
    with pytest.raises(RefusedError, match=words):
        read(path)


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("https://example.org/box.bin", "no relative path"),
        ("/etc/passwd", "no relative path"),
        ("../box.bin", "leaves the source folder"),
        ("%2e%2e/box.bin", "leaves the source folder"),
        ("nowhere.bin", "does not exist"),
        ("a" * 5000, "aaa"),
        ("data:application/octet-stream;base64,*", "buffer 0|data: URI"),
        ("data:,", "buffer 0 has 0 of"),
        ("short.bin", "buffer 0 has 4 of"),
    ],
)
def test_buffers_that_cannot_be_had_are_refused(uri: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "box.bin").write_bytes(bytes(1000))
    (tmp_path / "inner" / "short.bin").write_bytes(b"four")
    path = GltfFile().write(tmp_path / "inner" / "box.gltf", "data")
    broken = json.loads(path.read_text())
    broken["buffers"][0]["uri"] = uri
    path.write_text(json.dumps(broken))
    with pytest.raises(RefusedError, match=words):
        read(path)


def test_mutated_files_are_read_or_refused(tmp_path: Path) -> None:
    """Bytes of whole files are changed, dropped and repeated at random; numbers of their JSON become others."""
    rng = np.random.default_rng(7)
    seeds: list[bytes] = []
    for changes in (
        (sparse_over_others, moved),
        (instanced, factor_times_picture),
        (morphed, beyond_the_edge),
        (skinned,),
    ):
        file = GltfFile()
        for change in changes:
            change(file)
        seeds.append(file.write(tmp_path / "seed.glb").read_bytes())
    path = tmp_path / "box.glb"
    states = {"read": 0, "refused": 0}
    for turn in range(240):
        path.write_bytes(mutate(seeds[turn % len(seeds)], rng))
        try:
            parts = read(path).parts
            states["read"] += 1
            assert all(np.isfinite(part.vertices).all() and part.faces.max() < len(part.vertices) for part in parts)
        except RefusedError:
            states["refused"] += 1
    assert min(states.values()) > 20, states


def mutate(data: bytes, rng: np.random.Generator) -> bytes:
    """A GLB file with a few changes of its JSON or its bytes."""
    length = struct.unpack_from("<I", data, 12)[0]
    text, chunk = bytearray(data[20 : 20 + length]), bytearray(data[28 + length :])
    for _ in range(rng.integers(1, 4)):
        kind = rng.integers(5)
        if kind == 0:
            chunk[rng.integers(len(chunk))] = rng.integers(256)
        elif kind == 1:
            start = int(rng.integers(len(chunk)))
            chunk[start : start + 4] = struct.pack("<f", rng.choice([np.nan, np.inf, -1e38, 1e30, 0.0]))
        elif kind == 2:
            text[rng.integers(len(text))] = rng.integers(32, 127)
        else:
            digits = [place for place, letter in enumerate(text) if chr(letter).isdigit()]
            place = int(rng.choice(digits))
            text[place : place + 1] = rng.choice([b"0", b"1", b"7", b"99", b"-1", b"65536", b"4294967295", b"1e30"])
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(chunk)) + struct.pack("<I4s", len(text), b"JSON")
    return head + text + struct.pack("<I4s", len(chunk), b"BIN\0") + chunk


def test_a_file_is_imported_again_when_a_buffer_beside_it_changes(tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    GltfFile().write(source / "box.gltf", "file")
    assert "1 imported" in grs("assets", "import", "source", folder=tmp_path).stdout
    (source / "my box.bin").write_bytes(bytes(GltfFile((0.1, 0.1, 0.2)).data))
    assert "1 imported" in grs("assets", "import", "source", folder=tmp_path).stdout
    (asset,) = json.loads(grs("assets", "list", "--json", folder=tmp_path).stdout)
    assert asset["size"] == pytest.approx((0.1, 0.2, 0.1), abs=1e-4)
