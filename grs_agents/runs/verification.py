"""``grs verify``: whether an ended run is what it was, and whether its audit comes out the same once more.

No check is known here by name: the audit is made again, and the two records are compared value by value.
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
"""What tells the items of a list in ``audit.json`` from each other."""
_MOST_WORDS = 160
"""Of a value in a line that says what differs; both values are in the files."""


@dataclass(frozen=True)
class Verification:
    """What was compared, and what differs."""

    folder: Path
    verdict: str  # what the record of the run says
    differences: tuple[str, ...]  # one line each, which begins with the file that differs
    recomputed: bool  # whether the audit was made again; it is not where files were changed or no audit was made
    note: str = ""  # why an honest run may differ here

    @property
    def holds(self) -> bool:
        """Whether nothing differs."""
        return not self.differences


def verify_run(folder: Path, local: Config, show: Callable[[str], None] = lambda _: None) -> Verification:
    """Compare the files of a run with their hashes; where none was changed, audit it again.

    Args:
        folder: the run, which may come from somebody else.
        local: says how generated code is isolated here.
        show: is told what is done next.

    Raises:
        InputError: the folder holds no ended run, or the sandbox cannot be had.
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
    others = [f"{name} {was} (here {here.get(name)})" for name, was in record.versions.items() if here.get(name) != was]
    limits = flatten_tree({"limits": local.limits.model_dump()})
    recorded = flatten_tree(record.config.as_json())
    others += [f"{key} {recorded[key]} (here {limits[key]})" for key in limits if recorded.get(key) != limits[key]]
    note = f"the run was made with {', '.join(others)}" if differences and others else ""
    return Verification(folder, record.status, differences, recomputed=True, note=note)


def _recompute_audit(folder: Path, record: RunRecord, local: Config, temporary: Path) -> Iterator[str]:
    """Each difference between the audit in ``folder`` and the one that its programs get in ``temporary``."""
    replies = collect_model_replies(read_events(folder / "events.jsonl"))
    recorded = read_json(folder / _AUDIT, "restore the file")
    order = CheckOrder(
        simulation=folder / "simulation.py",
        tests=folder / "test_simulation.py",
        config=_build_config_from_record(folder, record, local),
        folder=temporary,
        task=folder / "task.json",
        scene=folder / "scene.json",
        assets=folder.resolve() / "assets",
    )
    try:
        found = check_user_program(order, partial(_AgentsOfRecord, earlier=replies))
    except MissingReply as error:
        yield f"events.jsonl: {error.message}"
        return
    audit, accepted = found.audit, found.accepted and found.tests is not None
    yield from _list_differences(recorded, audit.model_dump(mode="json"), f"{_AUDIT}:")
    yield from _list_instance_differences(folder, temporary)
    if record.status == "accepted":
        made = (temporary / _INSTANCES).glob("*")
        lost = sorted(file.name for file in made if not (folder / _INSTANCES / file.name).is_file())
        yield from (f"{_INSTANCES}/{name}: an accepted run has it" for name in lost)
    yield from _list_shadowed_assets(folder / "assets")
    if (record.status == "accepted") != accepted:
        yield f"run.json: status: recorded {record.status}, recomputed {'accepted' if accepted else 'rejected'}"
    if record.rewards != audit.rewards:
        yield f"run.json: rewards: recorded {record.rewards}, recomputed {audit.rewards}"


def _build_config_from_record(folder: Path, record: RunRecord, local: Config) -> Config:
    """The portable settings of the run on those of this machine, with the names of its models, which are not asked."""
    config = record.config.over(local)
    models = {role: ModelConfig(model=name) for role, name in record.config.model_names().items()}
    judge = flatten_tree(record.config.as_json()).get("audit.judge")
    changes: dict[str, Any] = {
        "robot": local.robot if local.robot != Config().robot else find_recorded_robot(folder, record.config),
        "models": {**config.models, **models},
        "policy": local.policy,
        "audit": config.audit.model_copy(update={"judge": None if judge is None else str(judge)}),
    }
    return config.model_copy(update=changes)


class _AgentsOfRecord(Agents):
    """Agents that never ask a model which may answer otherwise the next time: what it said is in the record."""

    def chat_model_for_role(self, role: str) -> "BaseChatModel":
        """The offline model. Raises MissingReply: another serves ``role``, and was not asked this in the run."""
        model = self.config.model_for_role(role).model
        if not is_offline(model):
            raise MissingReply(f"{model} ({role}) was not asked in the run what it is to be asked now")
        return super().chat_model_for_role(role)


def _list_instance_differences(folder: Path, temporary: Path) -> Iterator[str]:
    """What was drawn and recorded. A run that put its best version back has removed what was not of that version."""
    for file in sorted((folder / _INSTANCES).glob("*")):
        made = temporary / _INSTANCES / file.name
        name = f"{_INSTANCES}/{file.name}"
        if not made.is_file():
            yield f"{name}: it was not made again"
        elif file.suffix == ".json":
            yield from _list_differences(read_json(file, "restore it"), read_json(made, ""), f"{name}:")
        elif file.suffix == ".npz" and read_bytes(file) != read_bytes(made):
            yield f"{name}: the motion came out otherwise"


def _list_shadowed_assets(own: Path) -> Iterator[str]:
    """What a run brings along in place of the library's: a run makes assets of its photo, and none by such a name."""
    library = Library()
    for file in sorted(own.rglob("*")):
        name = file.relative_to(own).as_posix()
        if file.is_file() and name in library:
            yield f"assets/{name}: it stands in place of the library's asset of that name"


def _list_differences(recorded: Any, recomputed: Any, where: str) -> Iterator[str]:
    """One line for each value that differs between two JSON values, with its place."""
    if isinstance(recorded, dict) and isinstance(recomputed, dict):
        before, now = cast("dict[str, Any]", recorded), cast("dict[str, Any]", recomputed)
        for key in dict.fromkeys((*before, *now)):
            yield from _list_differences(before.get(key), now.get(key), f"{where} {key}")
    elif isinstance(recorded, list) and isinstance(recomputed, list):
        items, others = _index_by_key(cast("list[Any]", recorded)), _index_by_key(cast("list[Any]", recomputed))
        for key in dict.fromkeys((*items, *others)):
            yield from _list_differences(items.get(key), others.get(key), f"{where} {key}")
    elif json.dumps(recorded) != json.dumps(recomputed):  # which tells 1 from True
        yield f"{where}: recorded {_format_shortened_value(recorded)}, recomputed {_format_shortened_value(recomputed)}"


def _index_by_key(items: Sequence[Any]) -> dict[str, Any]:
    """The items by what tells them from each other, else by their number."""
    keyed: dict[str, Any] = {}
    for number, item in enumerate(items):
        fields = cast("dict[str, Any]", item) if isinstance(item, dict) else {}
        named = next((f"{fields[key]}" for key in _KEYS if key in fields), str(number))
        keyed[named if named not in keyed else f"{named} ({number})"] = item
    return keyed


def _format_shortened_value(value: Any) -> str:
    text = "nothing" if value is None else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _MOST_WORDS else f"{text[:_MOST_WORDS]}..."
