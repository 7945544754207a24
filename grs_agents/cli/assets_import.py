"""``grs assets import`` (from files or ``objaverse:WORDS``), ``list``, ``show`` and ``verify``."""

import shlex
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from rich.table import Table
from rich.text import Text

from grs_agents.base import content, terminal
from grs_agents.base.errors import InputError
from grs_agents.base.files import resolve_output_file, write_bytes
from grs_agents.base.terminal import VERBOSITY, print_escaped, print_json
from grs_agents.library.asset import Asset
from grs_agents.library.importing.archives import ImportSource, open_import_source
from grs_agents.library.importing.asset_discovery import slugify_name
from grs_agents.library.importing.importer import ImportRun
from grs_agents.library.importing.objaverse import (
    download_objects,
    load_objaverse_package,
    search_objaverse,
)
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.types import ImportOptions, ImportOutcome, SourceItem
from grs_agents.library.library import Library

DEFAULT = Path("grs-content")
_NAMED = 20
"""Unread files listed for each reason; ``--json`` lists all of them."""


def user_content_folder(library: Path | None) -> Path:
    """The content folder of the user's assets: ``library``, else that of ``--content``, else ``grs-content``."""
    overlays = content.content_search_roots()[:-1]
    return library or (overlays[0] if overlays else DEFAULT)


def user_library_root(library: Path | None) -> Path:
    """The library in the user's content folder."""
    return user_content_folder(library) / "assets" / "library"


def import_source(
    source: str,
    library: Path | None,
    name: str | None,
    options: ImportOptions,
    *,
    jobs: int,
    again: bool,
    as_json: bool,
) -> int:
    """Import a source, reporting each outcome. Returns: exit status, 1 if an asset was refused."""
    with open_import_source(source, options) as source_items:
        collection = slugify_name(name) if name is not None else source_items.collection
        if not source_items.items and not source_items.refused:
            unread = [f"{outcome.source}: {outcome.reason}" for outcome in source_items.unread[:_NAMED]]
            remedy = f"it holds {' | '.join(unread)}" if unread else "name a folder that does"
            raise InputError(f"{source} holds no mesh, URDF, SDF or MJCF", remedy)
        shipped = frozenset(asset.name for asset in Library(content.content_root() / "assets" / "library").assets())
        order = ImportRun(user_library_root(library), collection, options, Library().assets(), again, jobs, shipped)
        progress = ImportProgress(len(source_items.items) + len(source_items.refused), as_json)
        return print_import_report([*order.run(source_items, progress), *source_items.unread], library, as_json)


class ImportProgress:
    """Prints a line for each outcome on standard error."""

    def __init__(self, count: int, quiet: bool) -> None:
        self._count, self._quiet, self._done = count, quiet or VERBOSITY.get() == "quiet", 0

    def __call__(self, outcome: ImportOutcome, old: bool) -> None:
        self._done += 1
        if self._quiet:
            return
        status = f"{outcome.status}{' before' if old else ''}"
        asset = outcome.asset
        name, detail = (outcome.item, outcome.reason) if asset is None else (asset.name, asset.description)
        print_escaped(f"[{self._done}/{self._count}] {name}: {status}: {detail}", error=True)
        for note in outcome.notes if not old else ():
            print_escaped(f"    {note}", error=True)


def print_import_report(outcomes: Sequence[ImportOutcome], library: Path | None, as_json: bool) -> int:
    """Print the report of an import. Returns: exit status."""
    refused = [outcome for outcome in outcomes if outcome.status == "refused"]
    if as_json:
        print_json([outcome.model_dump(mode="json") for outcome in outcomes])
        return 1 if refused else 0
    counts = Counter(outcome.status for outcome in outcomes)
    folder = user_content_folder(library)
    summary = f"{counts['imported']} imported, {counts['duplicate']} duplicates, {counts['refused']} refused"
    summary += f", {counts['unread']} not read" if counts["unread"] else ""
    print_escaped(f"{summary}; in {folder}")
    for outcome in refused:
        print_escaped(f"refused {outcome.source}: {outcome.reason}")
    by_reason: dict[str, list[str]] = {}
    for outcome in outcomes:
        if outcome.status == "unread":
            by_reason.setdefault(outcome.reason, []).append(outcome.source)
    for reason, files in by_reason.items():
        rest = f" and {len(files) - _NAMED} more" if len(files) > _NAMED else ""
        print_escaped(f"not read {', '.join(files[:_NAMED])}{rest}: {reason}")
    show = shlex.join(["grs", "assets", "show", "--library", str(folder)])
    print_escaped(f"look: {show}   use: {shlex.join(['grs', '--content', str(folder), 'run'])} SCENE")
    return 1 if refused else 0


def select_assets(library: Path | None, names: Sequence[str], shipped: bool) -> tuple[Library, list[Asset]]:
    """Returns: library with the user's assets; assets of these names or collections, by default the user's own."""
    root, merged = user_library_root(library), Library()
    user_assets: Sequence[Asset] = ()
    if root.is_dir():
        user_assets = Library(root).assets()
        if root.resolve() not in [path.resolve() for path in merged.roots]:
            merged = merged.copy_with_overlay_root(root)
    elif library is not None:
        raise InputError(f"there is no asset library in {library}", "import one: grs assets import SOURCE")
    if not names:
        return merged, list(merged.assets() if shipped or not user_assets else user_assets)
    selected: list[Asset] = []
    for name in names:
        collection = [asset for asset in merged.assets() if asset.name.startswith(f"{name.rstrip('/')}/")]
        selected += collection or [merged.asset(name)]
    return merged, selected


_WIDE = 120
"""Width from which a terminal has room for the description, columns."""


def list_library(library: Path | None, names: Sequence[str], shipped: bool, as_json: bool) -> None:
    """Print assets as a table or JSON."""
    _, assets = select_assets(library, names, shipped)
    if as_json:
        print_json([asset.model_dump(mode="json") for asset in assets])
        return
    console = terminal.make_console()
    columns = ["name", "size (cm)", "mass", "from"]
    columns += ["licence"] if any(asset.origin is not None for asset in assets) else []
    columns += ["what it is"] if console.width >= _WIDE else []
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    for column in columns:
        table.add_column(column, overflow="fold", no_wrap=column in ("size (cm)", "mass"))
    for asset in assets:
        mass = asset.physics_or_defaults().mass
        cells = {
            "name": asset.name,
            "size (cm)": "x".join(f"{100 * extent:.1f}" for extent in asset.size),
            "mass": f"{1000 * mass.value:.0f} g",
            "from": mass.provenance,
            "licence": asset.origin.license if asset.origin is not None else "",
            "what it is": asset.description,
        }
        table.add_row(*(Text(cells[column]) for column in columns))
    console.print(table)


def write_contact_sheets(
    library: Path | None, names: Sequence[str], shipped: bool, out: Path, views: int, as_json: bool
) -> int:
    """Write a contact sheet. Returns: exit status, 1 if an asset cannot be rendered."""
    from grs_agents.library.contact_sheets import MAX_ASSETS, draw_contact_sheet
    from grs_agents.library.mesh_files import encode_png

    known, assets = select_assets(library, names, shipped)
    sheets = [assets[start : start + MAX_ASSETS] for start in range(0, len(assets), MAX_ASSETS)]
    broken: dict[str, str] = {}
    written: dict[str, int] = {}
    for number, part in enumerate(sheets):
        picture, failed = draw_contact_sheet(known, part, views)
        path = out if len(sheets) == 1 else out.with_stem(f"{out.stem}-{number + 1}")
        write_bytes(resolve_output_file(path), encode_png(picture))
        written[str(path)] = len(part)
        broken |= failed
    if as_json:
        print_json({"files": written, "broken": broken})
        return 1 if broken else 0
    for path, count in written.items():
        print_escaped(f"{count} assets in {path}")
    for name, reason in broken.items():
        print_escaped(f"{name}: {reason}", error=True)
    return 1 if broken else 0


def verify_library(library: Path | None, names: Sequence[str], shipped: bool, as_json: bool) -> int:
    """Check assets. Returns: exit status, 1 if an asset is broken."""
    from grs_agents.library.importing.drop_testing import verify_asset

    known, assets = select_assets(library, names, shipped)
    verdicts = [verify_asset(known, asset) for asset in assets]
    broken = [verdict for verdict in verdicts if not verdict.ok]
    if as_json:
        print_json([verdict.model_dump(mode="json") for verdict in verdicts])
        return 1 if broken else 0
    table = Table("asset", "state", "rests", "findings", box=None, pad_edge=False, header_style="bold")
    for verdict in verdicts:
        rests = "" if verdict.rests is None else "yes" if verdict.rests else "no"
        table.add_row(*map(Text, (verdict.name, "ok" if verdict.ok else "broken", rests, "; ".join(verdict.findings))))
    terminal.make_console().print(table)
    print_escaped(f"{len(verdicts) - len(broken)} of {len(verdicts)} are whole")
    return 1 if broken else 0


COLLECTION = "objaverse"
PREFIX = "objaverse:"
"""Prefix of a search in Objaverse as a source."""


def import_objaverse(words: str, library: Path | None, options: ImportOptions, count: int, as_json: bool) -> int:
    """List the matches of a search; with ``count``, download and import that many. Returns: exit status."""
    package = load_objaverse_package()
    matches = search_objaverse(package, words)
    if not matches:
        raise InputError(f"nothing in Objaverse matches {words!r}", "use fewer or other words")
    if count == 0 and as_json:
        print_json([match.model_dump(mode="json") for match in matches])
        return 0
    if count == 0:
        table = Table("uid", "title", "author", "licence", "faces", box=None, pad_edge=False, header_style="bold")
        for match in matches:
            table.add_row(*map(Text, (match.uid, match.title, match.author, match.license, str(match.faces or ""))))
        terminal.make_console().print(table)
        print_escaped(
            f"{len(matches)} matches, nothing downloaded; --download N fetches and imports the first N", error=True
        )
        return 0
    with tempfile.TemporaryDirectory(prefix="grs-objaverse-") as name:
        files = download_objects(package, matches[:count], Path(name))
        items = tuple(
            SourceItem(kind="mesh", name=Path(file).stem, file=file, license=entry.license)
            for file, entry in files.items()
        )
        if not items:
            raise InputError(f"none of {count} matches could be downloaded", "try again, or other words")
        source = ImportSource(SourceFolder(Path(name), options.limits.bytes), items, COLLECTION)
        progress = ImportProgress(len(items), as_json)
        outcomes = ImportRun(user_library_root(library), COLLECTION, options).run(source, progress)
        return print_import_report(outcomes, library, as_json)
