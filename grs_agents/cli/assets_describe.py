"""``grs assets describe`` and ``grs assets index``."""

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from grs_agents.agents.asset_describer import describe_assets, replace_asset_description, select_assets_to_describe
from grs_agents.base import terminal
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import ConfigError, GrsError, InputError
from grs_agents.base.terminal import print_escaped, print_json
from grs_agents.cli.assets_import import select_assets, user_library_root
from grs_agents.library.asset import read_manifest
from grs_agents.library.importing.journal import update_manifest_entries
from grs_agents.library.library import Library
from grs_agents.models.factory import make_chat_model, takes_pictures

ROLE = "describe"


def describe_library(
    library: Path | None, names: Sequence[str], config: Config, again: bool, yes: bool, as_json: bool
) -> int:
    """Describe the user's own assets after stating the cost. Returns: exit status, 1 after an unusable reply."""
    root = user_library_root(library)
    known, chosen = select_assets(library, names, False)
    listed = {asset.name for asset in read_manifest(root).assets} if root.is_dir() else set[str]()
    assets = [asset for asset in chosen if asset.name in listed]
    if not assets:
        remedy = "import some: grs assets import SOURCE"
        raise InputError("none of these assets is your own; those that GRS ships have their descriptions", remedy)
    spec = config.model_for_role(ROLE)
    model = make_chat_model(spec, config.seed)
    if not takes_pictures(spec, model):
        remedy = f"name another with models.{ROLE}, or set models.{ROLE}.pictures=true if it does"
        raise ConfigError(f"model {spec.model!r} takes no pictures, which assets are described by", remedy)
    todo = select_assets_to_describe(root, assets, spec.model, again)
    count = f"{len(todo.todo)} of {len(assets)} assets to describe with {spec.model}"
    if spec.model == "offline":
        cost = "it costs nothing, tells names and measurements, and does not look at pictures"
        print_escaped(f"{count}: {cost}", error=True)
    else:
        cost = f"about {todo.input_tokens} tokens in (3 pictures each) and {todo.output_tokens} out"
        print_escaped(f"{count}: {cost}", error=True)
        if todo.todo and not yes:
            if not sys.stdin.isatty():
                raise ConfigError("this model may cost money and nobody can be asked", "give --yes")
            print_escaped("go on? [y/N] ", end="", error=True, flush=True)
            if sys.stdin.readline().strip().lower() not in ("y", "yes"):
                raise ConfigError("not confirmed, nothing was asked", "give --yes")
    by_name = {asset.name: asset for asset in assets}
    entries = [replace_asset_description(by_name[described.asset], described.words) for described in todo.done]
    records = list(todo.done)
    unanswered = 0
    try:
        for asset, described in describe_assets(
            root, known, todo.todo, model, spec, partial(print_escaped, error=True)
        ):
            entries.append(asset)
            if described is None:
                unanswered += 1
                continue
            records.append(described)
            if not as_json:
                print_escaped(f"{asset.name}: {asset.description}")
    finally:
        update_manifest_entries(root, entries)
    if as_json:
        print_json([described.model_dump(mode="json") for described in records])
    return 1 if unanswered else 0


def update_asset_index(folder: Path, again: bool, as_json: bool) -> int:
    """Bring an index in a folder up to date with the library. Returns: exit status, 1 if an asset could not be
    embedded."""
    from grs_agents.perception.matching.asset_appearance import load_appearance
    from grs_agents.perception.matching.asset_index import AssetIndex, Vectors, embed_object
    from grs_agents.perception.matching.feature_matcher import matchable_assets

    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is no folder", "name a new folder, or one that holds an index")
    library, index = Library(), AssetIndex(folder)
    assets = {asset.name: asset for asset in matchable_assets(library)}
    known = set(index.names())
    pending = [name for name in assets if again or name not in known]
    gone = sorted(known - set(assets))
    vectors: dict[str, Vectors] = {}
    broken: dict[str, str] = {}
    columns = (TextColumn("indexing"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=terminal.make_console(error=True)) as progress:
        for name in progress.track(pending):
            asset = assets[name]
            try:
                appearance = load_appearance(name, library).views.mean(axis=0)
                vectors[name] = embed_object(asset.description, appearance, asset.size)
            except GrsError as error:
                broken[name] = str(error)
    if vectors:
        index.add(list(vectors), np.stack(list(vectors.values())))
    added = len(vectors)
    index.remove(gone)
    if index.needs_compaction:
        index.compact()
    if as_json:
        figures = {"assets": len(index), "added": added, "removed": len(gone), "broken": broken}
        print_json({"folder": str(folder), **figures})
    else:
        print_escaped(f"{folder}: {len(index)} assets, {added} added, {len(gone)} removed")
        for name, reason in broken.items():
            print_escaped(f"  {name}: {reason}")
    return 1 if broken else 0
