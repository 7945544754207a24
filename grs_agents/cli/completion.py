"""Shell completion; without a function here, the shell completes file names itself."""

from collections.abc import Iterable
from pathlib import Path


def complete_scene(incomplete: str) -> list[str]:
    """Sample scenes, and files and folders."""
    from grs_agents.base import content

    head, slash, _ = incomplete.rpartition("/")
    folder = Path(head + slash)
    paths = sorted(f"{head}{slash}{path.name}" for path in folder.iterdir()) if folder.is_dir() else []
    return _filter_by_start([*content.sample_scenes(), *paths], incomplete)


def complete_run_folder(incomplete: str) -> list[str]:
    """The word ``latest`` and the runs below ``runs/``."""
    folders = sorted(str(file.parent) for file in Path("runs").glob("*/run.json"))
    return _filter_by_start(["latest", *folders], incomplete)


def complete_graph(incomplete: str) -> list[str]:
    """Names of graphs."""
    from grs_agents.base import content

    return _filter_by_start(content.content_names("graphs"), incomplete)


def complete_experiment(incomplete: str) -> list[str]:
    """Names of experiments."""
    from grs_agents.base import content

    return _filter_by_start(content.content_names("evals"), incomplete)


def complete_cassette(incomplete: str) -> list[str]:
    """Names of shipped cassettes."""
    from grs_agents.base import content

    return _filter_by_start(content.shipped_cassettes(), incomplete)


def complete_setting(incomplete: str) -> list[str]:
    """Configuration keys, each with its ``=``."""
    from grs_agents.base.config.load import flatten_tree
    from grs_agents.base.config.schema import Config

    keys = flatten_tree(Config().model_dump(mode="json"))
    return _filter_by_start([f"{key}=" for key in keys], incomplete)


def _filter_by_start(words: Iterable[str], incomplete: str) -> list[str]:
    return [word for word in words if word.startswith(incomplete)]
