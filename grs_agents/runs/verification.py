"""``grs verify``: check that an ended run is unchanged and its audit reproducible.

The audit is repeated, and both records are compared value by value, without knowledge of the single checks.
"""

import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from grs_agents.agents.agent import Agents
from grs_agents.agents.recorded import MissingReply, collect_model_replies
from grs_agents.base.config.load import flatten_tree
from grs_agents.base.config.schema import Config, ModelConfig
from grs_agents.base.foreign.files import read_bytes, read_json
from grs_agents.base.foreign.run_folder import check_run_folder
from grs_agents.base.trace.events import Prompt
from grs_agents.base.trace.log import read_events
from grs_agents.library.library import Library
from grs_agents.models.factory import is_offline
from grs_agents.runs.hashes import list_changed_files
from grs_agents.runs.program_check import CheckOrder, check_user_program, find_recorded_robot
from grs_agents.runs.record import RunRecord, installed_versions, read_record

if TYPE_CHECKING:
    from langchain_core.language_models.chat_models import BaseChatModel

_AUDIT, _INSTANCES = "audit.json", "instances"
_KEYS = ("check", "seed")
"""Fields that identify the items of a list in ``audit.json``."""
_MAX_VALUE = 160
"""Characters of a value in a line of the report; the files hold both values."""


@dataclass(frozen=True)
class Verification:
    """The result of a verification."""

    folder: Path
    verdict: str  # of the run's record
    differences: tuple[str, ...]  # lines that begin with the name of a file
    recomputed: bool  # whether the audit was repeated; not if files were changed or there is no audit
    note: str = ""  # a reason for honest differences

    @property
    def holds(self) -> bool:
        """True without differences."""
        return not self.differences


def verify_run(folder: Path, local: Config, show: Callable[[str], None] = lambda _: None) -> Verification:
    """Compare the files of a run with their hashes; if all match, repeat its audit.

    Args:
        folder: the run, which may be foreign.
        local: configuration of this machine, for the isolation of generated code.
        show: receives a progress text.

    Raises:
        InputError: the folder holds no ended run, or the sandbox is unavailable.
    """
    check_run_folder(folder)
    show("comparing the files with their hashes")
    if changed := list_changed_files(folder):
        return Verification(folder, "unknown", changed, recomputed=False)
    record = read_record(folder)
    if not (folder / _AUDIT).is_file():
        judged = record.status == "accepted" and record.command != "scene"
        missing = (f"{_AUDIT}: an accepted run has one",) if judged else ()
        return Verification(folder, record.status, missing, recomputed=False)
    show("making the audit again")
    with tempfile.TemporaryDirectory(prefix="grs-verify-") as temporary:
        differences = tuple(_recompute_audit(folder, record, local, Path(temporary)))
    here = installed_versions()
    changes = [
        f"{name} {was} (here {here.get(name)})" for name, was in record.versions.items() if here.get(name) != was
    ]
    limits = flatten_tree({"limits": local.limits.model_dump()})
    recorded = flatten_tree(record.config.as_json())
    changes += [f"{key} {recorded[key]} (here {limits[key]})" for key in limits if recorded.get(key) != limits[key]]
    note = f"the run was made with {', '.join(changes)}" if differences and changes else ""
    return Verification(folder, record.status, differences, recomputed=True, note=note)


def _recompute_audit(folder: Path, record: RunRecord, local: Config, temporary: Path) -> Iterator[str]:
    """Differences between the audit in ``folder`` and its repetition in ``temporary``."""
    events = read_events(folder / "events.jsonl")
    pictured = frozenset(event.role for event in events if isinstance(event, Prompt) and event.images)
    replies = collect_model_replies(events)
    recorded = read_json(folder / _AUDIT, "restore the file")
    # The run's portable settings over those of this machine, with the names of its models, which are not called.
    config = record.config.over(local)
    models = {role: ModelConfig(model=name) for role, name in record.config.model_names().items()}
    judge = flatten_tree(record.config.as_json()).get("audit.judge")
    changes: dict[str, Any] = {
        "robot": local.robot if local.robot != Config().robot else find_recorded_robot(folder, record.config),
        "models": {**config.models, **models},
        "policy": local.policy,
        "audit": config.audit.model_copy(update={"judge": None if judge is None else str(judge)}),
    }
    order = CheckOrder(
        simulation=folder / "simulation.py",
        tests=folder / "test_simulation.py",
        config=config.model_copy(update=changes),
        folder=temporary,
        task=folder / "task.json",
        scene=folder / "scene.json",
        assets=folder.resolve() / "assets",
    )
    try:
        result = check_user_program(order, partial(_AgentsOfRecord, earlier=replies, pictured=pictured))
    except MissingReply as error:
        yield f"events.jsonl: {error.message}"
        return
    audit, accepted = result.audit, result.accepted and result.tests is not None
    yield from _list_differences(recorded, audit.model_dump(mode="json"), f"{_AUDIT}:")
    # A run that restored its best version has only the instances of that version.
    for file in sorted((folder / _INSTANCES).glob("*")):
        repeated, name = temporary / _INSTANCES / file.name, f"{_INSTANCES}/{file.name}"
        if not repeated.is_file():
            yield f"{name}: it was not made again"
        elif file.suffix == ".json":
            yield from _list_differences(read_json(file, "restore it"), read_json(repeated, ""), f"{name}:")
        elif file.suffix == ".npz" and read_bytes(file) != read_bytes(repeated):
            yield f"{name}: the motion came out otherwise"
    if record.status == "accepted":
        repeated_files = (temporary / _INSTANCES).glob("*")
        lost = sorted(file.name for file in repeated_files if not (folder / _INSTANCES / file.name).is_file())
        yield from (f"{_INSTANCES}/{name}: an accepted run has it" for name in lost)
    library = Library()
    for file in sorted((folder / "assets").rglob("*")):  # a run's own assets never have names of the library
        name = file.relative_to(folder / "assets").as_posix()
        if file.is_file() and name in library:
            yield f"assets/{name}: it stands in place of the library's asset of that name"
    if (record.status == "accepted") != accepted:
        yield f"run.json: status: recorded {record.status}, recomputed {'accepted' if accepted else 'rejected'}"
    if record.rewards != audit.rewards:
        yield f"run.json: rewards: recorded {record.rewards}, recomputed {audit.rewards}"


class _AgentsOfRecord(Agents):
    """Agents that answer from the record, and never call a model whose reply could differ."""

    def chat_model_for_role(self, role: str) -> "BaseChatModel":
        """The offline model. Raises MissingReply: ``role`` has another model, and the record lacks its reply."""
        model = self.config.model_for_role(role).model
        if not is_offline(model):
            raise MissingReply(f"{model} ({role}) was not asked in the run what it is to be asked now")
        return super().chat_model_for_role(role)


def _list_differences(recorded: Any, recomputed: Any, path: str) -> Iterator[str]:
    """A line for each differing value of two JSON values, with its path."""
    if isinstance(recorded, dict) and isinstance(recomputed, dict):
        before, now = cast("dict[str, Any]", recorded), cast("dict[str, Any]", recomputed)
        for key in dict.fromkeys((*before, *now)):
            yield from _list_differences(before.get(key), now.get(key), f"{path} {key}")
    elif isinstance(recorded, list) and isinstance(recomputed, list):
        before, now = _index_by_key(cast("list[Any]", recorded)), _index_by_key(cast("list[Any]", recomputed))
        for key in dict.fromkeys((*before, *now)):
            yield from _list_differences(before.get(key), now.get(key), f"{path} {key}")
    elif json.dumps(recorded) != json.dumps(recomputed):  # distinguishes 1 from True
        yield f"{path}: recorded {_format_shortened_value(recorded)}, recomputed {_format_shortened_value(recomputed)}"


def _index_by_key(items: Sequence[Any]) -> dict[str, Any]:
    """The items by their identifying field, else by their position."""
    keyed: dict[str, Any] = {}
    for number, item in enumerate(items):
        fields = cast("dict[str, Any]", item) if isinstance(item, dict) else {}
        named = next((f"{fields[key]}" for key in _KEYS if key in fields), str(number))
        keyed[named if named not in keyed else f"{named} ({number})"] = item
    return keyed


def _format_shortened_value(value: Any) -> str:
    text = "nothing" if value is None else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _MAX_VALUE else f"{text[:_MAX_VALUE]}..."
