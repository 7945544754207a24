"""Open a run: all that can be known to be wrong is refused here, before anything ran and before a folder is made."""

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

from grs_agents import content
from grs_agents.config import Config, validated
from grs_agents.errors import ConfigError
from grs_agents.models import chat_model
from grs_agents.perception import check_source, scene_name
from grs_agents.policies import load_policy
from grs_agents.run.folder import held, new_folder, old_folder, refuse_used
from grs_agents.run.record import EXIT_STATUS, RunRecord, read_record, versions
from grs_agents.toolkit import load_tool

GIVEN = frozenset({"scene_path", "max_fixes", "fixes", "history"})
"""The fields of the state that a run begins with."""


@dataclass(frozen=True)
class Order:
    """What the user asked for.

    Attributes:
        command: ``run`` or ``scene``.
        source: the scene: a folder, a file, or ``bop:`` and an image of a data set.
        config: the effective configuration.
        out: the run folder, if named.
        resume: go on with the run in ``out``.
        given: fields of the state beside those that every run begins with.
        nested: the graph runs in a node of another, which is told of its steps and keeps the checkpoints.
    """

    command: str
    source: Path
    config: Config
    out: Path | None = None
    resume: bool = False
    given: Mapping[str, Any] = field(default_factory=dict[str, Any])
    nested: bool = False


@contextmanager
def open_run(order: Order) -> Generator[tuple[Path, RunRecord, Config]]:
    """Check the order, then make the run's folder or open the one to go on with, and keep other processes out of it.

    Yields:
        The folder, the record to write into it (of an ended run: the one that is there), the configuration.

    Raises:
        InputError: there is no such scene, or the run folder cannot be made or resumed, or another process runs in it.
        ConfigError: the configuration names what does not exist, or a graph that cannot do what was ordered.
    """
    if order.resume:
        folder, record = old_folder(order.out, order.source, order.command)
        config = validated(record.config)
        if record.status in EXIT_STATUS:
            yield folder, record, config
            return
        check_names(config, order.command, order.given)
        with held(folder):
            record = read_record(folder)  # another process may have written it before it let go
            if record.status not in EXIT_STATUS:
                update = {"status": "running", "reason": "", "exit_status": None, "attempts": record.attempts + 1}
                record = record.model_copy(update=update)
            yield folder, record, config
        return
    config = order.config
    check_source(order.source)
    check_names(config, order.command, order.given)
    folder = new_folder(scene_name(order.source), config.seed, order.out)
    record = RunRecord(
        id=folder.resolve().name,
        status="running",
        command=order.command,
        source=str(order.source),
        graph=config.graph,
        config=config.model_dump(mode="json"),
        versions=versions(),
        seeds=tuple(config.seed + step for step in range(config.audit.seeds)),
    )
    with held(folder):
        refuse_used(folder)  # another process may have been quicker
        yield folder, record, config


def check_names(config: Config, command: str, given: Mapping[str, Any]) -> None:
    """See that every graph, policy, tool, prompt and model that ``config`` names can be had.

    Raises:
        ConfigError: one of them cannot, or the graph cannot do what ``command`` promises.
    """
    graph = load_graph(config.graph)
    needs: Sequence[str] = getattr(graph, "NEEDS", ())
    missing = [name for name in needs if name not in GIVEN and name not in given]
    if missing:
        raise ConfigError(
            f"graph {config.graph!r} needs {' and '.join(missing)} in its state, and a run begins with a photo alone",
            "use graph=grs, or call the graph from your own program",
        )
    if command == "run" and not getattr(graph, "VERDICT", True):
        raise ConfigError(f"graph {config.graph!r} comes to no verdict", "use graph=grs, or `grs scene` for the scene")
    load_policy(config.policy)
    for name in config.tools.model_dump().values():
        load_tool(name)
    for name in config.prompts.model_dump().values():
        content.path("prompts", name)
    for spec in config.models.values():
        chat_model(spec, config.seed)


def load_graph(name: str) -> ModuleType:
    """The graph file ``name``.

    Raises:
        ConfigError: nothing has that name, or the file has no ``build``.
    """
    module = content.load_module("graphs", name)
    if not callable(getattr(module, "build", None)):
        raise ConfigError(f"graph {name!r} ({module.__file__}) has no build()", "define what is missing")
    return module
