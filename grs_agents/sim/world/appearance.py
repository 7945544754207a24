"""How a world looks beyond its shapes: textures of assets, and the light and the table top of an instance."""

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
"""Of the square top of the table, metres."""
TABLE_CENTER: Final = (0.4, 0.0)
"""The middle of that top, metres in the robot frame."""
_UNSAID: Final = (0.5, 0.5, 0.5, 1.0)
"""The colour of a geom that has none of its own: MuJoCo takes that of its material."""
_SQUARE: Final = 0.1
"""Metres of a square of a checkered table."""
_SPECK, _SPECKS = 0.006, 0.2
"""Metres of a speck of a speckled table, and the share of it that specks cover."""
_PIXELS: Final = 128
"""Of a side of the pattern; those of a speckled one are its specks."""


def add_textures(
    spec: Any, objects: Sequence[InstanceObject], models: Mapping[int, ObjectModel], library: Library
) -> None:
    """Cover the visual geoms ``object_<id>_visual_<n>`` with the textures of their shapes; an object's own colour is
    laid over all of it, so it stays plain."""
    for item in objects:
        for index, shape in enumerate(models[item.id].visuals):
            if shape.texture and item.color is None:
                geom = spec.geom(f"object_{item.id}_visual_{index}")
                add_texture_file(spec, geom.name, library.mesh_or_texture_path(shape.texture))
                _apply_texture_to_geom(spec, geom)


def set_light_and_table(spec: Any, light: InstanceLight, table: InstanceTable, library: Library) -> None:
    """Give a world that ``create_base_world_spec`` made the light and the table top of an instance.
    Raises ``InputError`` for a light that shines at itself, and for a texture that the library does
    not have or that is too large."""
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
        _add_pattern(spec, table)
        _apply_texture_to_geom(spec, top, 2 * _SQUARE if table.pattern == "checker" else _PIXELS * _SPECK)


def read_table_pattern(model: Any) -> tuple[npt.NDArray[np.uint8], float] | None:
    """One period of the pattern (H, W, 3) on a compiled model's table and its side, m; None for a plain table.
    Columns go along x from the table's lowest x on, rows against y from its greatest y on."""
    if int(model.geom("table").matid[0]) < 0:
        return None
    texture = model.texture("table")
    height, width, start = int(texture.height[0]), int(texture.width[0]), int(texture.adr[0])
    pixels = np.asarray(model.tex_data[start : start + height * width * 3], np.uint8).reshape(height, width, 3)
    return pixels, 2 / float(model.material("table").texrepeat[0])


def _add_pattern(spec: Any, table: InstanceTable) -> None:
    checkered = table.pattern == "checker"
    built = mujoco.mjtBuiltin.mjBUILTIN_CHECKER if checkered else mujoco.mjtBuiltin.mjBUILTIN_FLAT
    texture = spec.add_texture(name="table", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=built)
    texture.width = texture.height = _PIXELS
    texture.rgb1, texture.rgb2 = table.color[:3], table.second_color[:3]
    if not checkered:
        texture.mark, texture.markrgb, texture.random = mujoco.mjtMark.mjMARK_RANDOM, table.second_color[:3], _SPECKS


def _apply_texture_to_geom(spec: Any, geom: Any, side: float = 0.0) -> None:
    """Cover a geom with the texture of its name, repeated every ``side`` metres; 0: as the mesh says."""
    material = spec.add_material(name=str(geom.name))
    material.textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = str(geom.name)
    if side:
        material.texuniform, material.texrepeat = True, (2 / side, 2 / side)  # MuJoCo counts repeats in 2 m
    geom.material, geom.rgba = str(geom.name), _UNSAID
