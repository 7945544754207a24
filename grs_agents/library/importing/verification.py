"""Whether the assets of a library are whole: files, numbers, MuJoCo, and two seconds on a table."""

import hashlib
from collections.abc import Iterator

from grs_agents.base import Frozen
from grs_agents.errors import InputError
from grs_agents.library.asset import Asset
from grs_agents.library.asset_views import read_texture
from grs_agents.library.importing.drop_test import colliders_of, rest
from grs_agents.library.library import Library

_SIZE = 0.005
"""Most that the size in the manifest may differ from what the file says, m."""


class Verdict(Frozen):
    """What was found of one asset.

    Attributes:
        name: of the asset.
        ok: it can be used.
        rests: it stands where it was put for two seconds; None for marks, which do not collide, and templates.
        findings: what is wrong or odd.
    """

    name: str
    ok: bool
    rests: bool | None
    findings: tuple[str, ...] = ()


def verify(library: Library, asset: Asset) -> Verdict:
    """Check one asset."""
    findings = list(_changed(library, asset))
    broken = bool(findings)
    rests: bool | None = None
    try:
        model = library.model(asset.name)
        for shape in model.visuals:
            if shape.texture:
                read_texture(library.mesh_path(shape.texture))
        if max(abs(one - other) for one, other in zip(model.size, asset.size, strict=True)) > _SIZE:
            told = " x ".join(f"{100 * extent:.1f}" for extent in model.size)
            findings.append(f"its file says {told} cm")
        if model.colliders and asset.mass > 0:
            standing = rest(colliders_of(library, model), asset.mass, asset.friction)
            rests = standing.stable
            findings += [] if rests else [f"does not rest as it stands: {standing}"]
    except InputError as error:
        findings.append(error.message)
        broken = True
    return Verdict(name=asset.name, ok=not broken, rests=rests, findings=tuple(findings))


def _changed(library: Library, asset: Asset) -> Iterator[str]:
    """Files of an imported asset that are not what was written."""
    for name, digest in (asset.origin.files if asset.origin is not None else {}).items():
        path = next((root / name for root in reversed(library.roots) if (root / name).is_file()), None)
        if path is None:
            yield f"{name} is missing"
        elif hashlib.sha256(path.read_bytes()).hexdigest() != digest:
            yield f"{name} has been changed"
