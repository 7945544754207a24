"""Assets that a user's folder holds without a manifest: any URDF or MJCF of one rigid object, found by its name."""

from pathlib import Path, PurePosixPath

from grs_agents.library.asset import Asset
from grs_agents.library.colors import color_name
from grs_agents.library.formats.mjcf import read_mjcf
from grs_agents.library.formats.urdf import read_urdf
from grs_agents.library.shapes import ObjectModel

SUFFIXES = (".urdf", ".xml")


def user_model_path(root: Path, name: str) -> Path | None:
    """The file called ``name`` below ``root``, None where there is none or the name leaves the folder."""
    pure = PurePosixPath(name)
    if pure.suffix.lower() not in SUFFIXES or "\0" in name or pure.as_posix() != name:
        return None
    if pure.is_absolute() or ".." in pure.parts:
        return None
    path = (root / name).resolve()
    return path if path.is_relative_to(root.resolve()) and path.is_file() else None


def user_model_names(root: Path) -> list[str]:
    """The name of every URDF and MJCF file below ``root``, sorted."""
    files = (path for suffix in SUFFIXES for path in root.rglob(f"*{suffix}"))
    names = (path.relative_to(root).as_posix() for path in files)
    return sorted(name for name in names if user_model_path(root, name) is not None)


def read_model_file(path: Path, root: Path) -> ObjectModel:
    """What a description file says, whichever of the two formats it is.

    Raises:
        InputError: it is not one rigid object that we can trust.
    """
    return read_mjcf(path, root) if path.suffix.lower() == ".xml" else read_urdf(path, root)


def user_model_asset(name: str, model: ObjectModel) -> Asset:
    """The entry that a manifest would have for a file that says ``model``."""
    colors = [shape.color for shape in model.visuals if shape.color is not None]
    color = color_name(colors[0][:3]) if colors else "gray"
    stem = PurePosixPath(name).stem
    x, y, z = (round(extent, 5) for extent in model.size)
    return Asset(
        name=name,
        kind=stem,
        category="object",
        size=(x, y, z),
        mass=model.mass,
        friction=model.friction,
        color=color,
        description=f"{stem}, {100 * x:.3g} x {100 * y:.3g} x {100 * z:.3g} cm, from a file of the user's own",
        everyday=False,
    )
