"""Whether an asset rests on a table: compiled, dropped and simulated in MuJoCo for two seconds.
``grs assets verify`` checks a library so, and whether its files and numbers are whole."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

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
from grs_agents.library.shapes import ObjectModel, Shape, matrix_from_quaternion, shape_bounds, shape_volume

SECONDS: Final = 2.0
_MAX_DRIFT, _MAX_TILT, _MAX_SPEED = 0.01, 5.0, 0.02
_STEP: Final = 0.002


@dataclass(frozen=True)
class DropResult:
    """How an object stood after two seconds on a table."""

    drift: float  # horizontal way of its centre, m
    tilt: float  # degrees
    speed: float  # at the end, m/s

    @property
    def is_stable(self) -> bool:
        """Whether it still stands where and how it was put down."""
        return self.drift <= _MAX_DRIFT and self.tilt <= _MAX_TILT and self.speed <= _MAX_SPEED

    def __str__(self) -> str:
        return f"after {SECONDS:g} s: moved {1000 * self.drift:.1f} mm, tilted {self.tilt:.1f} degrees"


def run_drop_test(colliders: Sequence[Collider], mass: float, friction: float) -> DropResult:
    """Put an object down as its frame says and simulate it; refused where MuJoCo cannot."""
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
        geom = _add_collider_geom(spec, body, collider, f"part{number}")
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


def _add_collider_geom(spec: Any, body: Any, collider: Collider, name: str) -> Any:
    from grs_agents.base.mujoco_import import mujoco

    if isinstance(collider, ConvexHull):
        mesh = spec.add_mesh(name=name, uservert=collider.vertices.ravel().tolist())
        mesh.userface, mesh.inertia = collider.faces.ravel().tolist(), mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH)
        geom.meshname = name
        return geom
    return add_shape_geom(spec, body, collider, name)


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
"""Most that the size in the manifest may differ from what the file says, m."""


class AssetVerdict(Frozen):
    """What was found of one asset."""

    name: str
    ok: bool  # it can be used
    rests: bool | None  # it stands where it was put; None for marks, which do not collide, and templates
    findings: tuple[str, ...] = ()  # what is wrong or odd


def verify_asset(library: Library, asset: Asset) -> AssetVerdict:
    """Check one asset."""
    findings = list(_describe_changed_files(library, asset))
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
    """What of a library's asset collides, meshes as their hulls."""
    return [shape if shape.mesh is None else _compute_mesh_hull(library, shape) for shape in model.colliders]


def _compute_mesh_hull(library: Library, shape: Shape) -> ConvexHull:
    vertices = read_vertices(library.mesh_or_texture_path(shape.mesh or "")) * shape.size
    return compute_convex_hull(vertices @ matrix_from_quaternion(shape.quaternion).T + shape.position)


def _describe_changed_files(library: Library, asset: Asset) -> Iterator[str]:
    """What is wrong with the files of an imported asset: missing, or not as they were written."""
    for name, digest in (asset.origin.files if asset.origin is not None else {}).items():
        path = next((root / name for root in reversed(library.roots) if (root / name).is_file()), None)
        if path is None:
            yield f"{name} is missing"
        elif hashlib.sha256(path.read_bytes()).hexdigest() != digest:
            yield f"{name} has been changed"
