"""``grs assets describe`` and ``grs assets index``."""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from grs_agents import terminal
from grs_agents.agents.asset_describer import describe_assets, plan, with_words
from grs_agents.cli.assets_import import chosen_assets, library_root
from grs_agents.config import Config
from grs_agents.errors import ConfigError, InputError
from grs_agents.library import Asset
from grs_agents.library.asset import read_manifest
from grs_agents.library.importing.journal import write_entries
from grs_agents.models import chat_model
from grs_agents.terminal import say, say_json

ROLE = "describe"


def describe_library(
    library: Path | None, names: Sequence[str], config: Config, again: bool, yes: bool, as_json: bool
) -> int:
    """Describe the user's own assets with the model of the role ``describe``; what it takes is said first.

    Returns:
        0, or 1 where the model gave no usable reply for one.

    Raises:
        InputError: there are no assets of one's own, or a model that may cost money is not confirmed.
    """
    root = library_root(library)
    known, chosen = chosen_assets(library, names, False)
    mine = {asset.name for asset in read_manifest(root).assets} if root.is_dir() else set[str]()
    assets = [asset for asset in chosen if asset.name in mine]
    if not assets:
        raise InputError(
            "none of these assets is your own; those that GRS ships have their descriptions",
            "import some: grs assets import SOURCE",
        )
    spec = config.model_for(ROLE)
    model = chat_model(spec, config.seed)
    todo = plan(root, assets, spec.model, again)
    say(
        f"{len(todo.todo)} of {len(assets)} assets to describe with {spec.model}: about {todo.input_tokens} tokens in "
        f"(3 pictures each) and {todo.output_tokens} out",
        error=True,
    )
    if spec.model == "offline":
        say("the offline model tells names and measurements, it does not look at the pictures", error=True)
    elif todo.todo and not yes:
        _confirm()
    entries: list[Asset] = [with_words(_of(assets, one.asset), one.words) for one in todo.done]
    silent, told = 0, [one.model_dump(mode="json") for one in todo.done]
    try:
        for asset, found in describe_assets(root, known, todo.todo, model, spec.model, _complain):
            silent += found is None
            entries.append(asset)
            if found is not None:
                told.append(found.model_dump(mode="json"))
                if not as_json:
                    say(f"{asset.name}: {asset.description}")
    finally:
        write_entries(root, entries)
    if as_json:
        say_json(told)
    return 1 if silent else 0


def _of(assets: Sequence[Asset], name: str) -> Asset:
    return next(asset for asset in assets if asset.name == name)


def _complain(text: str) -> None:
    say(text, error=True)


def _confirm() -> None:
    """Ask before money may be spent.

    Raises:
        ConfigError: the answer is no, or there is nobody to ask.
    """
    if not sys.stdin.isatty():
        raise ConfigError("this model may cost money and nobody can be asked", "give --yes")
    say("go on? [y/N] ", end="", error=True, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise ConfigError("not confirmed, nothing was asked", "give --yes")


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
    from grs_agents.perception.matching.feature_matcher import matchable_assets

    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is no folder", "name a new folder, or one that holds an index")
    library, index = Library(), AssetIndex(folder)
    assets = {asset.name: asset for asset in matchable_assets(library)}
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
