"""``grs assets``: import 3D models into a library of the user's own, and inspect them."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from grs_agents.cli.options import (
    ConfigFile,
    Json,
    Models,
    Settings,
    VerbGroup,
    add_model_setting,
    load_effective_config,
)

assets_app = typer.Typer(
    name="assets",
    cls=VerbGroup,
    help="Import, list, show, describe and verify 3D assets.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
_FOLDER = "The content folder of your assets; that of --content, else ./grs-content."
LibraryFolder = Annotated[Path | None, typer.Option("--library", help=_FOLDER, metavar="DIR")]
Names = Annotated[list[str] | None, typer.Argument(help="Assets or collections, e.g. ycb/024_bowl.urdf or ycb.")]
Shipped = Annotated[bool, typer.Option("--all", help="The assets that GRS ships, too.")]


@assets_app.command("import")
def import_assets(
    source: Annotated[
        str, typer.Argument(help="A folder, mesh, URDF, MJCF or archive; hope; or objaverse:WORDS.", metavar="SOURCE")
    ],
    library: LibraryFolder = None,
    name: Annotated[str | None, typer.Option("--name", help="The collection; the source's name by default.")] = None,
    unit: Annotated[
        Literal["auto", "m", "cm", "mm", "in"], typer.Option("--unit", help="Of meshes that do not say theirs.")
    ] = "auto",
    up: Annotated[
        Literal["auto", "x", "y", "z"], typer.Option("--up", help="Axis that points up, where a mesh does not say.")
    ] = "auto",
    license_: Annotated[str | None, typer.Option("--license", help="Of all of the source.")] = None,
    faces: Annotated[int, typer.Option("--faces", help="Most triangles of what is seen.", min=100)] = 12_000,
    jobs: Annotated[int, typer.Option("--jobs", help="Processes.", min=1, max=64)] = 1,
    again: Annotated[bool, typer.Option("--again", help="Import what was imported before, too.")] = False,
    download: Annotated[
        int, typer.Option("--download", help="Objaverse: fetch so many of the matches; none by default.", min=0)
    ] = 0,
    json: Json = False,
) -> None:
    """Import 3D models; broken ones are refused by name.

    The rest goes on. Exit status 1 if one was refused.
    """
    from grs_agents.cli.assets_import import PREFIX, import_objaverse, import_source
    from grs_agents.library.importing.types import ImportOptions

    options = ImportOptions(unit=unit, up=up, license=license_ or "unknown", faces=faces)
    if source.startswith(PREFIX):
        sys.exit(import_objaverse(source.removeprefix(PREFIX), library, options, download, json))
    sys.exit(import_source(source, library, name, options, jobs=jobs, again=again, as_json=json))


@assets_app.command("list")
def list_assets(
    names: Names = None, library: LibraryFolder = None, shipped: Shipped = False, json: Json = False
) -> None:
    """List assets with size, mass, source of the mass and licence."""
    from grs_agents.cli.assets_import import list_library

    list_library(library, names or [], shipped, json)


@assets_app.command("show")
def show_assets(
    names: Names = None,
    library: LibraryFolder = None,
    shipped: Shipped = False,
    out: Annotated[Path, typer.Option("--out", help="The picture to write.", metavar="FILE")] = Path("assets.png"),
    views: Annotated[int, typer.Option("--views", help="Pictures of each.", min=1, max=12)] = 3,
    json: Json = False,
) -> None:
    """Write a contact sheet: a picture of the assets from several sides."""
    from grs_agents.cli.assets_import import write_contact_sheets

    sys.exit(write_contact_sheets(library, names or [], shipped, out, views, json))


@assets_app.command("verify")
def verify_assets(
    names: Names = None, library: LibraryFolder = None, shipped: Shipped = False, json: Json = False
) -> None:
    """Check files, sizes and MuJoCo, and that each stands on a table.

    Each must stand for two seconds. Exit status 1 if one is broken.
    """
    from grs_agents.cli.assets_import import verify_library

    sys.exit(verify_library(library, names or [], shipped, json))


@assets_app.command("describe")
def describe_assets(
    names: Names = None,
    library: LibraryFolder = None,
    config: ConfigFile = None,
    settings: Settings = None,
    models: Models = None,
    again: Annotated[bool, typer.Option("--again", help="Those described before, too.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before a model that may cost money is used.")] = False,
    json: Json = False,
) -> None:
    """Describe views of each asset with the configured model, once.

    The views are three at random. The possible cost is said first.
    """
    from grs_agents.cli.assets_describe import describe_library

    chosen = load_effective_config(config, add_model_setting(settings, models)).config
    sys.exit(describe_library(library, names or [], chosen, again, yes, json))


@assets_app.command("index")
def index_assets(
    folder: Annotated[Path, typer.Argument(help="The folder of the index; made if it is not there.")],
    again: Annotated[bool, typer.Option("--again", help="Look at every asset again, not at new ones alone.")] = False,
    json: Json = False,
) -> None:
    """Bring an index of assets up to date.

    An index is for matching in a library too large to compare everything; see match.index.
    """
    from grs_agents.cli.assets_describe import update_asset_index as update

    sys.exit(update(folder, again, json))
