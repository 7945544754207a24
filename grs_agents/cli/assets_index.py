"""``grs assets index``."""

from pathlib import Path

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from grs_agents import terminal
from grs_agents.terminal import say, say_json


def index_assets(folder: Path, again: bool, as_json: bool) -> int:
    """Bring an index in a folder up to date with the library: add what is new, forget what is gone.

    Args:
        folder: of the index; made if it is not there.
        again: look at every asset again, not at new ones alone.
        as_json: print figures as JSON.

    Returns:
        0; 1 if an asset could not be looked at.

    Raises:
        InputError: the folder holds something else, or faiss is not installed.
    """
    from grs_agents.errors import GrsError, InputError
    from grs_agents.library import Library
    from grs_agents.perception.matching.asset_appearance import appearance_of
    from grs_agents.perception.matching.asset_index import AssetIndex, Vectors, embed
    from grs_agents.perception.matching.feature_matcher import offered

    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is no folder", "name a new folder, or one that holds an index")
    library, index = Library(), AssetIndex(folder)
    assets = {asset.name: asset for asset in offered(library)}
    known = set(index.names())
    wanted = [name for name in assets if again or name not in known]
    gone = sorted(known - set(assets))
    vectors: dict[str, Vectors] = {}
    broken: dict[str, str] = {}
    columns = (TextColumn("indexing"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=terminal.console(error=True)) as progress:
        for name in progress.track(wanted):
            try:
                look = appearance_of(name, library).views.mean(axis=0)
                vectors[name] = embed(assets[name].description, look, assets[name].size)
            except GrsError as error:
                broken[name] = str(error)
    if vectors:
        index.add(list(vectors), np.stack(list(vectors.values())))
    index.remove(gone)
    if index.crowded:
        index.compact()
    told = {"folder": str(folder), "assets": len(index), "added": len(vectors), "removed": len(gone), "broken": broken}
    if as_json:
        say_json(told)
    else:
        say(f"{folder}: {len(index)} assets, {len(vectors)} added, {len(gone)} removed")
        for name, reason in broken.items():
            say(f"  {name}: {reason}")
    return 1 if broken else 0
