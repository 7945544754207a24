"""The assets of library folders, found by name."""

from collections.abc import Collection
from pathlib import Path, PurePosixPath

from grs_agents.base import content
from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.base.foreign.files import read_text
from grs_agents.base.foreign.run_folder import resolve_member_file
from grs_agents.library.asset import Asset, read_manifest
from grs_agents.library.colors import color_name_from_rgb
from grs_agents.library.formats.mjcf import read_mjcf
from grs_agents.library.formats.urdf import read_urdf
from grs_agents.library.shapes import ObjectModel
from grs_agents.library.urdf_templates import Value, Values, fill_template


class Library:
    """An overlay of library folders, each with a ``manifest.json``; later folders win.

    A URDF or MJCF file that no manifest lists is an asset too, by its name relative to its folder: it is read on
    demand, and never offered by `assets` and its callers.

    Args:
        roots: the folders; by default the library shipped with GRS, and the folders that ``--content`` lays over it.

    Raises:
        InputError: a folder does not exist or its manifest is faulty.
    """

    def __init__(self, *roots: Path) -> None:
        self.roots: tuple[Path, ...] = roots or tuple(reversed(content.all_content_paths("assets", "library")))
        self._assets: dict[str, Asset] = {}
        self._root_of: dict[str, Path] = {}
        self._models: dict[str, ObjectModel] = {}
        self._own: dict[str, Asset] = {}
        self._texts: dict[str, str] = {}
        self._filled: dict[tuple[str, str], ObjectModel] = {}
        self._files: dict[str, Path] = {}
        for root in self.roots:
            for asset in read_manifest(root).assets:
                self._assets[asset.name] = asset
                self._root_of[asset.name] = root

    def asset_names(self) -> list[str]:
        """Every asset's name and every description file's, sorted."""
        files = ((root, path) for root in self.roots for suffix in MODEL_SUFFIXES for path in root.rglob(f"*{suffix}"))
        names = {path.relative_to(root).as_posix() for root, path in files}
        return sorted({*self._assets, *filter(self.__contains__, names)})

    def assets(self) -> tuple[Asset, ...]:
        """Every asset that a manifest lists, by name."""
        return tuple(self._assets[name] for name in sorted(self._assets))

    def template_names(self) -> tuple[str, ...]:
        """The names of the assets that have placeholders."""
        return tuple(asset.name for asset in self.assets() if asset.template)

    def asset(self, name: str) -> Asset:
        """The asset called ``name``.
        Raises UnknownNameError: nothing has that name; the message gives the nearest names.
        Raises InputError: its file is faulty or not there."""
        if name in self._assets:
            return self._assets[name]
        if name not in self._own:
            self._own[name] = build_user_model_asset(name, self.load_object_model(name))
        return self._own[name]

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and (name in self._assets or self._find_user_model_root(name) is not None)

    def asset_path(self, name: str) -> Path:
        """The URDF or MJCF file of an asset. Errors as `asset`."""
        return resolve_member_file(self._require_root_of_asset(name), name)

    def load_object_model(self, name: str) -> ObjectModel:
        """Load the asset's file; a template is filled with its defaults. Errors as `asset`."""
        if name not in self._models:
            if name in self._assets and self._assets[name].template:
                self._models[name] = self.load_filled_template(name, {})
            else:
                root = self._require_root_of_asset(name)
                path = resolve_member_file(root, name)
                self._models[name] = (read_mjcf if path.suffix.lower() == ".xml" else read_urdf)(path, root)
        return self._models[name]

    def template_defaults(self, name: str) -> dict[str, tuple[Value, ...]]:
        """The documented default values of a template's placeholders; empty for an ordinary asset."""
        return dict(self.asset(name).template)

    def fill_template(self, name: str, replace: Values) -> str:
        """The URDF text of a template with ``replace`` filled in, see `fill_template`."""
        if name not in self._texts:
            self._texts[name] = read_text(self.asset_path(name), "restore the template")
        return fill_template(self._texts[name], replace, self.asset(name).template)

    def load_filled_template(self, name: str, replace: Values) -> ObjectModel:
        """Load a template filled with ``replace`` and its defaults; errors as `fill_template`."""
        key = (name, self.fill_template(name, replace))
        if key not in self._filled:
            self._filled[key] = read_urdf(key[1], self._require_root_of_asset(name), Path(name).parent.as_posix())
        return self._filled[key]

    def mesh_or_texture_path(self, name: str) -> Path:
        """The file of a library-relative mesh or texture name; an `InputError` if no root has it."""
        if name in self._files:
            return self._files[name]
        for root in reversed(self.roots):
            path = (root / name).resolve()
            if path.is_file() and path.is_relative_to(root.resolve()):
                self._files[name] = path
                return path
        raise InputError(f"library file {name!r} does not exist", f"put it below {self.roots[-1]}")

    def copy_with_overlay_root(self, root: Path) -> "Library":
        """A new library with ``root`` laid over this library; an `InputError` if its manifest is faulty."""
        over = Library(*self.roots, root)
        over._models = {
            key: model
            for key, model in self._models.items()
            if over._find_root_of_asset(key) == self._find_root_of_asset(key)
        }
        return over

    def keep_unchanged(self, earlier: "Library", changed: Collection[str]) -> None:
        """Take over what another library has read from the same folders, but for files of the names ``changed``."""

        def is_unchanged(name: str, model: ObjectModel) -> bool:
            parts = {part for shape in (*model.visuals, *model.colliders) for part in (shape.mesh, shape.texture)}
            return parts.isdisjoint(changed) and name not in changed

        self._files = {name: path for name, path in earlier._files.items() if name not in changed}
        self._models |= {name: model for name, model in earlier._models.items() if is_unchanged(name, model)}

    def everyday_assets(self) -> tuple[Asset, ...]:
        """The assets of a real table: no templates, no marks, no parts of a published task."""
        return tuple(asset for asset in self.assets() if asset.everyday and not asset.template and asset.mass > 0)

    def _find_root_of_asset(self, name: str) -> Path | None:
        return self._root_of.get(name) or self._find_user_model_root(name)

    def _find_user_model_root(self, name: str) -> Path | None:
        return next((root for root in reversed(self.roots) if find_user_model_path(root, name) is not None), None)

    def _require_root_of_asset(self, name: str) -> Path:
        root = self._find_root_of_asset(name)
        if root is None:
            raise UnknownNameError("asset", name, self.asset_names())
        return root


MODEL_SUFFIXES = (".urdf", ".xml")
"""Suffixes of files that are assets without a manifest: URDF or MJCF of a single rigid object."""


def find_user_model_path(root: Path, name: str) -> Path | None:
    """The file called ``name`` below ``root``, None if it does not exist or the name leaves the folder."""
    pure = PurePosixPath(name)
    if pure.suffix.lower() not in MODEL_SUFFIXES or "\0" in name or pure.as_posix() != name:
        return None
    if pure.is_absolute() or ".." in pure.parts:
        return None
    path = (root / name).resolve()
    return path if path.is_relative_to(root.resolve()) and path.is_file() else None


def build_user_model_asset(name: str, model: ObjectModel) -> Asset:
    """The entry that a manifest would have for a file that says ``model``."""
    colors = [shape.color for shape in model.visuals if shape.color is not None]
    color = color_name_from_rgb(colors[0][:3]) if colors else "gray"
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
