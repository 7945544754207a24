"""Texture atlas: parts of several looks become a mesh with a single picture, plain colours single texels. Unused texels
take the colour of the nearest used texels, so that edges stay clean when the picture shrinks."""

from collections.abc import Sequence

import numpy as np

from grs_agents.base.geometry.raster import rasterise_triangles
from grs_agents.library.importing.textures import GREY
from grs_agents.library.importing.types import AtlasMesh, Floats, Image, Ints, MeshPart

_LARGEST = 2048
_SMALLEST = 4


def shrink_and_fill_texture(image: Image, uvs: Floats, edge: int) -> Image:
    """The texture, at most ``edge`` px; texels outside all triangles of ``uvs`` (F, 3, 2) are filled from their
    neighbours."""
    image = shrink_image(image, _LARGEST)
    height, width = image.shape[:2]
    if min(height, width) < 2 * _SMALLEST:
        return image
    corners = np.stack([uvs[:, :, 0] * width - 0.5, (1 - uvs[:, :, 1]) * height - 0.5], axis=2)
    used = rasterise_triangles(corners, np.zeros(corners.shape[:2]), width, height).triangle >= 0
    if used.all() or not used.any():
        return shrink_image(image, edge)
    color, weight = image * used[:, :, None].astype(np.float64), used.astype(np.float64)
    while max(color.shape[:2]) > edge:
        color, weight = _halve_resolution(color), _halve_resolution(weight[:, :, None])[:, :, 0]
    return np.rint(_fill_empty_texels(color, weight)).clip(0, 255).astype(np.uint8)


def shrink_image(image: Image, edge: int) -> Image:
    """The picture with its longer side at most ``edge`` px."""
    from PIL import Image as Pictures

    height, width = image.shape[:2]
    if max(height, width) <= edge:
        return image
    scale = edge / max(height, width)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(Pictures.fromarray(image).resize(size, Pictures.Resampling.LANCZOS), np.uint8)


def _halve_resolution(values: Floats) -> Floats:
    """Means over 2 x 2 texels; an odd last row or column counts twice."""
    high, wide = values.shape[:2]
    even = np.pad(values, ((0, high % 2), (0, wide % 2), (0, 0)), mode="edge")
    return even.reshape(even.shape[0] // 2, 2, even.shape[1] // 2, 2, -1).mean(axis=(1, 3))


def _fill_empty_texels(color: Floats, weight: Floats) -> Floats:
    """Colours over their weights; texels without weight come from the picture at half its size."""
    known = color / np.maximum(weight, 1e-9)[:, :, None]
    if (weight > 0).all() or min(weight.shape) < _SMALLEST:
        return known
    coarse = _fill_empty_texels(_halve_resolution(color), _halve_resolution(weight[:, :, None])[:, :, 0])
    larger = coarse.repeat(2, axis=0).repeat(2, axis=1)[: weight.shape[0], : weight.shape[1]]
    return np.where((weight > 0)[:, :, None], known, larger)


_GAP, _SWATCH, _PALETTE = 2, 4, 256
_WELD = 1e-6
"""Weld tolerance as a share of the mesh's extent."""


def merge_mesh_parts(parts: Sequence[MeshPart], edge: int) -> AtlasMesh:
    """Weld all parts into a mesh with a single picture of at most ``edge`` px: their pictures, then a palette of plain
    colours."""
    textured = [part.image is not None and part.uvs is not None for part in parts]
    palette, swatches = _build_color_swatches(
        [part for part, has_image in zip(parts, textured, strict=True) if not has_image]
    )
    part_uvs: list[Floats] = []
    pictures: list[Image] = []
    for part in parts:
        if part.image is not None and part.uvs is not None:
            middle = part.uvs.mean(axis=1, keepdims=True)
            outside = (part.uvs.min(axis=1) < -1e-6).any(axis=1) | (part.uvs.max(axis=1) > 1 + 1e-6).any(axis=1)
            part_uvs.append(np.clip(np.where(outside[:, None, None], part.uvs - np.floor(middle), part.uvs), 0, 1))
            pictures.append(shrink_and_fill_texture(part.image, part_uvs[-1], edge))
        else:
            index = swatches[: len(part.faces)]
            height, width = palette.shape[:2]
            u = (index % 16 + 0.5) * _SWATCH / width
            v = 1 - (index // 16 + 0.5) * _SWATCH / height
            part_uvs.append(np.repeat(np.stack([u, v], axis=1)[:, None], 3, axis=1))
            swatches = swatches[len(part.faces) :]
    sheet, boxes = _arrange_images_in_grid(pictures if all(textured) else [*pictures, palette], edge)
    places = iter(boxes)
    uvs = [
        box[:2] + coordinates * box[2:]
        for coordinates, has_image in zip(part_uvs, textured, strict=True)
        for box in [next(places) if has_image else boxes[-1]]
    ]
    vertices, faces = weld_vertices(*concatenate_mesh_parts(parts))
    return AtlasMesh(vertices, faces, np.concatenate(uvs), sheet)


def concatenate_mesh_parts(parts: Sequence[MeshPart]) -> tuple[Floats, Ints]:
    """The vertices and faces of all parts."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])[:-1]
    faces = [part.faces + start for part, start in zip(parts, starts, strict=True)]
    return np.concatenate([part.vertices for part in parts]), np.concatenate(faces)


def weld_vertices(vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Weld coincident vertices and drop unused vertices."""
    used = np.unique(faces)
    extent = float(np.ptp(vertices[used], axis=0).max()) or 1.0
    keys: Ints = np.rint((vertices[used] - vertices[used].min(axis=0)) / (extent * _WELD)).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    number = np.full(len(vertices), -1, np.int64)
    number[used] = inverse.ravel()
    return vertices[used][first], number[faces]


def _build_color_swatches(parts: Sequence[MeshPart]) -> tuple[Image, Ints]:
    """A picture of swatches, 16 in a row, and the number of the swatch of each face."""
    if not parts:
        return np.zeros((0, 0, 3), np.uint8), np.zeros(0, np.int64)
    grey = np.array([GREY], np.uint8)
    colors = np.concatenate(
        [np.repeat(grey, len(part.faces), 0) if part.colors is None else part.colors for part in parts]
    )
    step = 1
    levels, index = np.unique(colors, axis=0, return_inverse=True)
    while len(levels) > _PALETTE:
        step *= 2
        levels, index = np.unique(colors // step * step + (step - 1) // 2, axis=0, return_inverse=True)
    rows = -(-len(levels) // 16)
    swatches = np.zeros((rows * 16, 3), np.uint8)
    swatches[: len(levels)] = levels
    return swatches.reshape(rows, 16, 3).repeat(_SWATCH, axis=0).repeat(_SWATCH, axis=1), index.ravel()


def _arrange_images_in_grid(pictures: Sequence[Image], edge: int) -> tuple[Image, list[Floats]]:
    """Arrange pictures in a grid. Returns: sheet (H, W, 3), boxes (u, v, width, height) with the origin at the lower
    left."""
    if len(pictures) == 1:
        return shrink_image(pictures[0], edge), [np.array([0.0, 0.0, 1.0, 1.0])]
    columns = int(np.ceil(np.sqrt(len(pictures))))
    rows = -(-len(pictures) // columns)
    cell = max(4, edge // columns)
    small = [shrink_image(picture, cell - 2 * _GAP) for picture in pictures]
    cell = min(cell, max(max(picture.shape[:2]) for picture in small) + 2 * _GAP)
    sheet = np.full((rows * cell, columns * cell, 3), 128, np.uint8)
    boxes: list[Floats] = []
    for number, picture in enumerate(small):
        top, left = number // columns * cell, number % columns * cell
        high, wide = picture.shape[:2]
        framed = np.pad(picture, ((_GAP, _GAP), (_GAP, _GAP), (0, 0)), mode="edge")
        sheet[top : top + high + 2 * _GAP, left : left + wide + 2 * _GAP] = framed
        x, y = (left + _GAP) / sheet.shape[1], 1 - (top + _GAP + high) / sheet.shape[0]
        boxes.append(np.array([x, y, wide / sheet.shape[1], high / sheet.shape[0]]))
    return sheet, boxes
