"""Looks of a world beyond its shapes: textures of assets, the light and the table top of an instance."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.library.mujoco_shapes import add_texture_file
from grs_agents.library.shapes import ObjectModel
from grs_agents.sim.instance.task_instance import InstanceLight, InstanceObject, InstanceTable

TABLE_SIDE: Final = 2.4
"""Side of the square table top, metres."""
TABLE_CENTER: Final = (0.4, 0.0)
"""Centre of the table top, metres, robot frame."""
_UNSAID: Final = (0.5, 0.5, 0.5, 1.0)
"""Default colour of a geom: MuJoCo then takes the colour of its material."""
_SQUARE: Final = 0.1
"""Side of a square of a checkered table, metres."""
_SPECK, _SPECKS = 0.006, 0.2
"""Size of a speck of a speckled table, metres, and the share of the table that specks cover."""
_PIXELS: Final = 128
"""Side of the pattern's texture; in a speckled pattern each pixel is a speck."""


def add_textures(
    spec: Any, objects: Sequence[InstanceObject], models: Mapping[int, ObjectModel], library: Library
) -> None:
    """Texture the visual geoms ``object_<id>_visual_<n>`` as their shapes say; recoloured objects stay plain."""
    for item in objects:
        for index, shape in enumerate(models[item.id].visuals):
            if shape.texture and item.color is None:
                geom = spec.geom(f"object_{item.id}_visual_{index}")
                add_texture_file(spec, geom.name, library.mesh_or_texture_path(shape.texture))
                _apply_texture_to_geom(spec, geom)


def set_light_and_table(spec: Any, light: InstanceLight, table: InstanceTable, library: Library) -> None:
    """Set the light and the table top of an instance in a world of ``create_base_world_spec``.

    Raises ``InputError`` for a light that shines at itself, and for a texture that is unknown or too large.
    """
    direction = np.subtract(light.target, light.position)
    if not np.linalg.norm(direction) > 1e-6:
        raise InputError(f"the light at {light.position} shines at itself", "give it another target")
    lamp = spec.lights[0]
    lamp.pos, lamp.dir, lamp.diffuse = light.position, direction, light.diffuse
    spec.visual.headlight.ambient = light.ambient
    top = spec.geom("table")
    top.rgba = table.color
    if table.texture is not None:
        add_texture_file(spec, "table", library.mesh_or_texture_path(table.texture))
        _apply_texture_to_geom(spec, top, TABLE_SIDE)
    elif table.pattern != "plain":
        checkered = table.pattern == "checker"
        built = mujoco.mjtBuiltin.mjBUILTIN_CHECKER if checkered else mujoco.mjtBuiltin.mjBUILTIN_FLAT
        texture = spec.add_texture(name="table", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=built)
        texture.width = texture.height = _PIXELS
        texture.rgb1, texture.rgb2 = table.color[:3], table.second_color[:3]
        if not checkered:
            texture.mark, texture.markrgb = mujoco.mjtMark.mjMARK_RANDOM, table.second_color[:3]
            texture.random = _SPECKS
        _apply_texture_to_geom(spec, top, 2 * _SQUARE if checkered else _PIXELS * _SPECK)


def read_table_pattern(model: Any) -> tuple[npt.NDArray[np.uint8], float] | None:
    """Pattern of a compiled model's table.

    Returns: one period (H, W, 3), columns along x from the lowest x, rows against y from the greatest y, and its side
    (m); None for a plain table.
    """
    if int(model.geom("table").matid[0]) < 0:
        return None
    texture = model.texture("table")
    height, width, start = int(texture.height[0]), int(texture.width[0]), int(texture.adr[0])
    pixels = np.asarray(model.tex_data[start : start + height * width * 3], np.uint8).reshape(height, width, 3)
    return pixels, 2 / float(model.material("table").texrepeat[0])


def _apply_texture_to_geom(spec: Any, geom: Any, side: float = 0.0) -> None:
    """Apply the texture of a geom's name to it, repeated every ``side`` metres; 0 keeps the mesh's coordinates."""
    material = spec.add_material(name=str(geom.name))
    material.textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = str(geom.name)
    if side:
        material.texuniform, material.texrepeat = True, (2 / side, 2 / side)  # MuJoCo counts repeats in 2 m
    geom.material, geom.rgba = str(geom.name), _UNSAID
