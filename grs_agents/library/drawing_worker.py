"""The process that draws assets with OpenGL: ``python -m grs_agents.library.drawing_worker``.

It is a process of its own because MuJoCo decides when it is imported which graphics library it draws with. An order
(JSON) comes on stdin; for each asset ``NUMBER.npz`` with its views, or ``NUMBER.json`` with what is wrong with it, is
written to the folder that the order names.
"""

import importlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from grs_agents.errors import GrsError
from grs_agents.library.library import Library
from grs_agents.library.views import (
    FINER,
    AssetView,
    Painted,
    camera_axes,
    framed,
    painted_asset,
    unit_of,
    view_of_samples,
)

_AMBIENT = 0.55


def draw(order: dict[str, Any]) -> None:
    """Draw the ordered assets."""
    mujoco: Any = importlib.import_module("mujoco")
    library, folder = Library(*(Path(root) for root in order["roots"])), Path(order["folder"])
    for number, name in enumerate(order["names"]):
        try:
            views = _views(mujoco, painted_asset(library, name), order)
        except GrsError as error:
            (folder / f"{number}.json").write_text(json.dumps([error.message, error.remedy]), "utf-8")
        else:
            np.savez(
                folder / f"{number}.npz", rgba=[one.rgba for one in views], depth=[one.depth for one in views],
                directions=[one.direction for one in views], camera=(views[0].distance, views[0].focal),
            )  # fmt: skip


def _views(mujoco: Any, painted: Painted, order: dict[str, Any]) -> list[AssetView]:
    center, distance, focal = framed(painted, order["size"], order["field_of_view"])
    directions, edge = [unit_of(one) for one in order["directions"]], order["size"] * FINER
    spec = _scene(mujoco, painted, edge, distance, Path(order["folder"]))
    for number, direction in enumerate(directions):
        right, down, forward = camera_axes(direction)
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, np.stack([right, -down, -forward], axis=1).ravel())
        place = center + distance * direction
        spec.worldbody.add_camera(name=str(number), pos=place, quat=quaternion, fovy=order["field_of_view"])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    views: list[AssetView] = []
    with mujoco.Renderer(model, edge, edge) as renderer:
        for number, direction in enumerate(directions):
            renderer.update_scene(data, camera=str(number))
            color = renderer.render()
            renderer.enable_depth_rendering()
            depth = renderer.render().astype(np.float64)
            renderer.disable_depth_rendering()
            seen = depth < 2 * distance
            fine = np.concatenate([color / 255, np.ones((edge, edge, 1))], axis=2) * seen[:, :, None]
            views.append(view_of_samples(fine, depth * seen, direction, distance, focal))
    return views


def _scene(mujoco: Any, painted: Painted, edge: int, distance: float, folder: Path) -> Any:
    """The triangles, a mesh for each texture and colour, in the light that the z-buffer has."""
    from PIL import Image as Pictures

    spec = mujoco.MjSpec()
    spec.stat.extent, spec.stat.center = distance, painted.corners.mean(axis=(0, 1))
    spec.visual.global_.offwidth = spec.visual.global_.offheight = edge
    spec.visual.map.znear, spec.visual.map.zfar, spec.visual.quality.offsamples = 0.05, 4.0, 0
    light = spec.visual.headlight
    light.ambient, light.diffuse, light.specular = [_AMBIENT] * 3, [1 - _AMBIENT] * 3, [0.0] * 3
    for number, picture in enumerate(painted.textures):
        file = folder / f"texture_{number}.png"
        Pictures.fromarray(picture).save(file)
        spec.add_texture(name=f"texture_{number}", type=mujoco.mjtTexture.mjTEXTURE_2D, file=str(file))
    looks = np.column_stack([painted.texture, painted.colors])
    kinds, which = np.unique(looks, axis=0, return_inverse=True)
    for number, (texture, red, green, blue) in enumerate(kinds.tolist()):
        mine = which.ravel() == number
        material = spec.add_material(name=f"material_{number}", rgba=(red, green, blue, 1.0), specular=0.0)
        if texture >= 0:
            material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = f"texture_{int(texture)}"
        corners, uvs = painted.corners[mine].reshape(-1, 3), painted.uvs[mine].reshape(-1, 2)
        spec.add_mesh(
            name=f"mesh_{number}", uservert=corners.ravel().tolist(), userface=list(range(len(corners))),
            usertexcoord=(uvs * (1, -1) + (0, 1)).ravel().tolist(), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )  # fmt: skip
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"mesh_{number}", material=f"material_{number}",
            contype=0, conaffinity=0,
        )  # fmt: skip
    return spec


if __name__ == "__main__":
    draw(json.load(sys.stdin))
