"""``grs assets import objaverse:WORDS``."""

import tempfile
from pathlib import Path

from rich.table import Table
from rich.text import Text

from grs_agents import terminal
from grs_agents.cli.assets_import import Progress, library_root, tell_import
from grs_agents.errors import InputError
from grs_agents.library.importing.archives import Opened
from grs_agents.library.importing.importer import Importing
from grs_agents.library.importing.objaverse import Entry, download, load_package, matching
from grs_agents.library.importing.source_folder import Folder
from grs_agents.library.importing.types import ImportOptions, Item
from grs_agents.terminal import say, say_json

COLLECTION = "objaverse"
PREFIX = "objaverse:"
"""Of a source that is searched for in Objaverse."""


def import_objaverse(words: str, library: Path | None, options: ImportOptions, count: int, as_json: bool) -> int:
    """List what matches words; with ``count``, download the first so many and import them.

    Raises:
        ConfigError: the package is not installed.
        InputError: nothing matches, or Objaverse cannot be reached.
    """
    door = load_package()
    found = matching(door, words)
    if not found:
        raise InputError(f"nothing in Objaverse matches {words!r}", "use fewer or other words")
    if count == 0:
        _list(found, as_json)
        return 0
    with tempfile.TemporaryDirectory(prefix="grs-objaverse-") as name:
        named = download(door, found[:count], Path(name))
        items = tuple(
            Item(kind="mesh", name=Path(file).stem, file=file, license=entry.license) for file, entry in named.items()
        )
        if not items:
            raise InputError(f"none of {count} matches could be downloaded", "try again, or other words")
        source = Opened(Folder(Path(name), options.limits.bytes), items, COLLECTION)
        outcomes = Importing(library_root(library), COLLECTION, options).run(source, Progress(len(items), as_json))
        return tell_import(outcomes, library, as_json)


def _list(found: list[Entry], as_json: bool) -> None:
    if as_json:
        say_json([one.model_dump(mode="json") for one in found])
        return
    table = Table("uid", "title", "author", "licence", "faces", box=None, pad_edge=False, header_style="bold")
    for one in found:
        table.add_row(*map(Text, (one.uid, one.title, one.author, one.license, str(one.faces or ""))))
    terminal.console().print(table)
    say(f"{len(found)} matches, nothing downloaded; --download N fetches and imports the first N", error=True)
