"""Drop test of an asset: compiled in MuJoCo, dropped on a table and simulated for two seconds. ``grs assets verify``
runs it for a library, and checks its files and numbers."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.library.asset import Asset
from grs_agents.library.asset_rendering import read_texture
from grs_agents.library.importing.convex_decomposition import compute_convex_hull
from grs_agents.library.importing.types import Collider, ConvexHull, Floats, RefusedError
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import mesh_volume, read_vertices
from grs_agents.library.mujoco_shapes import add_shape_geom
from grs_agents.library.shapes import ObjectModel, matrix_from_quaternion, shape_bounds, shape_volume

SECONDS: Final = 2.0
_MAX_DRIFT, _MAX_TILT, _MAX_SPEED = 0.01, 5.0, 0.02
_STEP: Final = 0.002


@dataclass(frozen=True)
class DropResult:
    """Motion of an object in the two seconds after its release on a table."""

    drift: float  # horizontal way of its centre, m
    tilt: float  # degrees
    speed: float  # at the end, m/s

    @property
    def is_stable(self) -> bool:
        """True if position and orientation stay within the tolerances."""
        return self.drift <= _MAX_DRIFT and self.tilt <= _MAX_TILT and self.speed <= _MAX_SPEED

    def __str__(self) -> str:
        return f"after {SECONDS:g} s: moved {1000 * self.drift:.1f} mm, tilted {self.tilt:.1f} degrees"


def run_drop_test(colliders: Sequence[Collider], mass: float, friction: float) -> DropResult:
    """Put an object down in the orientation of its frame and simulate it; refused if MuJoCo fails."""
    from grs_agents.base.mujoco_import import mujoco

    if not colliders:
        raise InputError("nothing of it collides", "give it a collision shape")
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.integrator = _STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    floor = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 0.1))
    floor.friction = (friction, 0.01, 0.001)
    lowest = min(float(collider_bounds(collider)[0][2]) for collider in colliders)
    body = spec.worldbody.add_body(name="thing", pos=(0, 0, -lowest + 0.0005))
    body.add_freejoint()
    volumes = [max(collider_volume(collider), 1e-12) for collider in colliders]
    for number, (collider, share) in enumerate(zip(colliders, volumes, strict=True)):
        if isinstance(collider, ConvexHull):
            mesh = spec.add_mesh(name=f"part{number}", uservert=collider.vertices.ravel().tolist())
            mesh.userface, mesh.inertia = collider.faces.ravel().tolist(), mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH)
            geom.meshname = f"part{number}"
        else:
            geom = add_shape_geom(spec, body, collider, f"part{number}")
        geom.mass, geom.condim = max(mass * share / sum(volumes), 1e-6), 4
        geom.friction = (friction, 0.01, 0.001)
    try:
        model = spec.compile()
    except ValueError as error:
        raise RefusedError(f"MuJoCo cannot compile it: {str(error).splitlines()[0]}", "simplify it") from error
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    start = np.array(data.xipos[1])
    mujoco.mj_step(model, data, round(SECONDS / _STEP))
    if data.warning.number.any() or not np.isfinite(data.qpos).all():
        raise RefusedError("the simulation of it diverges", "check its mass and shape")
    upright = float(np.clip(np.asarray(data.xmat[1]).reshape(3, 3)[2, 2], -1, 1))
    drift = float(np.linalg.norm((np.asarray(data.xipos[1]) - start)[:2]))
    speed = float(np.linalg.norm(data.qvel[:3]) + 0.05 * np.linalg.norm(data.qvel[3:]))
    return DropResult(drift, float(np.rad2deg(np.arccos(upright))), speed)


def collider_bounds(collider: Collider) -> tuple[Floats, Floats]:
    """Lowest and highest corner, m."""
    if isinstance(collider, ConvexHull):
        return collider.vertices.min(axis=0), collider.vertices.max(axis=0)
    return shape_bounds(collider)


def collider_volume(collider: Collider) -> float:
    """m^3."""
    if isinstance(collider, ConvexHull):
        return abs(mesh_volume(collider.vertices, collider.faces))
    return shape_volume(collider)


_SIZE_TOLERANCE = 0.005
"""Tolerance between the sizes in manifest and file, m."""


class AssetVerdict(Frozen):
    """Result of the checks of an asset."""

    name: str
    ok: bool  # it can be used
    rests: bool | None  # passes the drop test; None for marks, which do not collide, and templates
    findings: tuple[str, ...] = ()  # faults and oddities


def verify_asset(library: Library, asset: Asset) -> AssetVerdict:
    """Check the files, the size and the rest of an asset."""
    findings: list[str] = []
    for name, digest in (asset.origin.files if asset.origin is not None else {}).items():
        path = next((root / name for root in reversed(library.roots) if (root / name).is_file()), None)
        if path is None:
            findings.append(f"{name} is missing")
        elif hashlib.sha256(path.read_bytes()).hexdigest() != digest:
            findings.append(f"{name} has been changed")
    broken = bool(findings)
    rests: bool | None = None
    try:
        model = library.load_object_model(asset.name)
        for shape in model.visuals:
            if shape.texture:
                read_texture(library.mesh_or_texture_path(shape.texture))
        if np.abs(np.subtract(model.size, asset.size)).max() > _SIZE_TOLERANCE:
            size = " x ".join(f"{100 * extent:.1f}" for extent in model.size)
            findings.append(f"its file says {size} cm")
        if model.colliders and asset.mass > 0:
            result = run_drop_test(build_asset_colliders(library, model), asset.mass, asset.friction)
            rests = result.is_stable
            findings += [] if rests else [f"does not rest as it stands: {result}"]
    except InputError as error:
        findings.append(error.message)
        broken = True
    return AssetVerdict(name=asset.name, ok=not broken, rests=rests, findings=tuple(findings))


def build_asset_colliders(library: Library, model: ObjectModel) -> list[Collider]:
    """Colliders of an asset of a library, meshes as their hulls."""
    colliders: list[Collider] = []
    for shape in model.colliders:
        if shape.mesh is None:
            colliders.append(shape)
        else:
            vertices = read_vertices(library.mesh_or_texture_path(shape.mesh)) * shape.size
            placed = vertices @ matrix_from_quaternion(shape.quaternion).T + shape.position
            colliders.append(compute_convex_hull(placed))
    return colliders
