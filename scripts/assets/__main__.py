"""Write ``assets/library`` again: ``python -m scripts.assets``."""

from pathlib import Path

from evals.synthesis.built_asset import BuiltAsset
from evals.synthesis.packages import build_package
from grs_agents.base import content
from grs_agents.base.files import write_json
from grs_agents.base.terminal import print_escaped
from grs_agents.library.asset import MANIFEST, AssetManifest
from scripts.assets.fixtures import build_fixtures
from scripts.assets.grocery_table import GROCERIES
from scripts.assets.household import build_household
from scripts.assets.kitting import build_kitting
from scripts.assets.marks import build_marks
from scripts.assets.templates import build_templates
from scripts.assets.toys import build_toys


def build_all() -> list[BuiltAsset]:
    """All assets, in the order of their families."""
    everyday = [*map(build_package, GROCERIES), *build_household()]
    return [*everyday, *build_toys(), *build_fixtures(), *build_templates(), *build_marks(), *build_kitting()]


def write_library(root: Path) -> AssetManifest:
    """Write every asset and the manifest below ``root`` and remove all other files there.

    The same code and the same version of OpenCV write the same bytes.
    """
    built = build_all()
    for asset in built:
        asset.write(root)
    manifest = AssetManifest(assets=tuple(sorted((asset.asset for asset in built), key=lambda asset: asset.name)))
    write_json(root / MANIFEST, manifest.model_dump(mode="json"))
    ours = {root / MANIFEST, *(root / name for asset in built for name in asset.files())}
    for stray in {file for file in root.rglob("*") if file.is_file()} - ours:
        stray.unlink()
    return manifest


def main() -> None:
    """Replace the shipped library."""
    folder = content.content_root() / "assets" / "library"
    manifest = write_library(folder)
    print_escaped(f"{len(manifest.assets)} assets in {folder}")


if __name__ == "__main__":
    main()
