"""Triangle meshes of a robot's looks, a mesh per body, for viewers that do not draw MuJoCo models."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.rendering.stage import add_robot
from grs_agents.sim.world.geom_triangles import geom_triangles_and_normals


@dataclass(frozen=True)
class RobotMesh:
    """Visible surface of a body, in its frame: N vertices of M triangles."""

    vertices: FloatArray  # (N, 3) metres
    normals: FloatArray  # (N, 3) unit length, outwards
    triangles: npt.NDArray[np.int64]  # (M, 3), counterclockwise from outside
    colors: npt.NDArray[np.uint8]  # (N, 4) red, green, blue, opacity


def build_robot_meshes(arm: Arm, push: bool = False) -> dict[str, RobotMesh]:
    """Meshes by body name, "world" for the fixed base; with the spatula to ``push``."""
    spec = mujoco.MjSpec()
    add_robot(spec, arm, push)
    model: Any = spec.compile()
    parts: dict[str, list[RobotMesh]] = {}
    for geom in np.flatnonzero(model.geom_rgba[:, 3] > 0).tolist():
        solid = geom_triangles_and_normals(model, geom)
        if solid is None:
            continue
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        turn, (corners, normals) = turn.reshape(3, 3), solid
        count = len(corners)
        material = int(model.geom_matid[geom])
        rgba = np.array(model.geom_rgba[geom] if material < 0 else model.mat_rgba[material], np.float64)
        color = np.tile(np.round(255 * rgba).astype(np.uint8), (count, 1))
        mesh = RobotMesh(
            corners @ turn.T + model.geom_pos[geom], normals @ turn.T, np.arange(count).reshape(-1, 3), color
        )
        parts.setdefault(str(model.body(model.geom_bodyid[geom]).name), []).append(mesh)
    meshes: dict[str, RobotMesh] = {}
    for name, pieces in parts.items():
        vertices, normals, colors = (
            np.concatenate([getattr(mesh, field) for mesh in pieces]) for field in ("vertices", "normals", "colors")
        )
        meshes[name] = RobotMesh(vertices, normals, np.arange(len(vertices)).reshape(-1, 3), colors)
    return meshes
