"""A suite: accepted tasks as a benchmark in one folder, with the hash of every file.

``suite.json`` lists the tasks; ``tasks/NAME/`` is a task folder each, with the varied instances that the expert solves.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Final, Literal, cast

from pydantic import Field, ValidationError

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.base.files import describe_hash_differences, hash_folder_files, write_text
from grs_agents.base.foreign.files import read_bytes, read_json
from grs_agents.base.foreign.run_folder import check_run_folder
from grs_agents.base.version import __version__
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.variation.types import Variation
from grs_agents.tasks.grading.grade import grade_task
from grs_agents.tasks.grading.trials import GradeOrder
from grs_agents.tasks.task_folder import TaskFolder, open_task_folder
from grs_agents.tasks.varied_instances import make_varied_instances

FILE: Final = "suite.json"
TASKS: Final = "tasks"
_REMEDY: Final = "name a folder that `grs suite` wrote"
Wording = Literal["vague", "default", "specific"]
"""Instruction variants: a vague paraphrase, the author's words, and the sentence made of the goals."""
Tag = Literal["color", "size", "kind", "in", "on", "beside", "side", "line", "order", "several moves", "pushing"]
_COLORS = re.compile(r"\b(red|orange|yellow|green|blue|purple|pink|brown|black|white|gr[ae]y|cyan)\b")
_SIZES = re.compile(r"\b(tall|low|large|big|small|short|long|wide)(er|est)?\b|\b(bigg|thinn)(er|est)\b|\bthin\b")
_SIDES = re.compile(r"\b(left of|right of|in front of|behind|between)\b")
_ORDERED = re.compile(
    r"\b(then|first|after|before|next|finally|last|stack|in (this )?order)\b"
    r"|\bfrom the (bottom (up|to)|\w+est to the \w+est)\b"
)
_IN_WORDS = re.compile(r"\b(into|inside)\b|\bin (?!front\b|the (middle|photo)\b|a (row|line)\b|(any|this) order\b)")
_ON_WORDS = re.compile(r"\b(on|onto|in the middle of) (?!the (spot|bare table)\b)")
_LINE_WORDS = re.compile(r"\bline up\b")
_IN, _ON, _BESIDE = ("inside",), ("on", "stacked", "in_zone"), ("near",)


class SuiteTask(Frozen):
    """A task of a suite."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][\w.-]{0,99}$")]  # of its folder
    source: str  # name of the run's folder
    robot: str
    hand: str  # see ``TaskInstance.hand``
    words: dict[Wording, str]  # instructions; ``default`` at least
    tags: tuple[Tag, ...]
    moves: int  # objects that the goals place
    difficulty: float | None = None  # see ``grade_task``; None if not graded
    seeds: tuple[int, ...]  # of the instances, all solved by the expert
    files: dict[str, Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]]  # SHA-256 by path relative to the task's folder


class Suite(Frozen):
    """Contents of ``suite.json``."""

    version: Literal[1] = 1
    name: str
    created_with: str = __version__  # version of grs-agents
    variation: Variation  # of the instances against those of the runs
    tasks: tuple[SuiteTask, ...]

    @property
    def text(self) -> str:
        """The canonical text of the file, whose first line holds the hash of the rest."""
        body = json.dumps(self.model_dump(mode="json"), indent=1, sort_keys=True, ensure_ascii=False)
        return f'{{\n "hash": "{sha256(body.encode()).hexdigest()}",\n{body[2:]}\n'

    def task(self, name: str) -> SuiteTask:
        """The task of a name. Raises UnknownNameError."""
        for task in self.tasks:
            if task.name == name:
                return task
        raise UnknownNameError("task", name, [task.name for task in self.tasks])


def make_suite(
    folder: Path,
    runs: Sequence[Path],
    name: str,
    instances: int,
    variation: Variation,
    grade: bool = False,
    workers: int = 2,
    show: Callable[[str], None] = lambda _: None,
) -> Suite:
    """Write a suite of accepted runs into a new or unfinished folder; an interrupted call resumes.

    Args:
        folder: of the suite.
        runs: accepted runs, or folders of ``grs instances``; each becomes a task.
        name: of the suite.
        instances: number of instances of each task.
        variation: of the instances against those of the runs.
        grade: measure each task's difficulty, which takes minutes.
        workers: processes.
        show: receives a progress text.

    Raises:
        InputError: a run cannot be used, or the folder holds another suite.
    """
    if (folder / FILE).exists():
        raise InputError(f"{folder} holds a suite already", "name another folder")
    tasks: list[SuiteTask] = []
    taken: set[str] = set()
    for run in runs:
        source = open_task_folder(run)
        words = _read_words(source)
        task_name = _unique_folder_name(source.read_instance(source.seeds[0]).task, taken)
        taken.add(task_name)
        show(f"{task_name}: instances")
        out = folder / TASKS / task_name
        # attempts beyond the number wanted replace those that the expert does not solve
        for attempts in (instances, 2 * instances, 4 * instances):
            manifest = make_varied_instances(run, range(attempts), variation, out, workers)
            if len(manifest.instances) >= instances:
                break
        if not manifest.instances:
            raise InputError(f"the expert solves no variation of {run}", "vary less, or leave the run out")
        kept = manifest.instances[:instances]
        written = open_task_folder(out)
        show(f"{task_name}: grading")
        difficulty = grade_task(written, GradeOrder(), workers).difficulty if grade else None
        first = written.read_instance(kept[0].seed)
        tasks.append(
            SuiteTask(
                name=task_name,
                source=run.resolve().name,
                robot=first.robot if Path(first.robot).suffix == "" else Path(first.robot).name,
                hand=first.hand,
                words=words,
                tags=find_tags(first, words["default"]),
                moves=len({number for goal in first.goals for number in goal.objects}),
                difficulty=difficulty,
                seeds=tuple(item.seed for item in kept),
                files=hash_folder_files(out),
            )
        )
    suite = Suite(name=name, variation=variation, tasks=tuple(tasks))
    write_text(folder / FILE, suite.text, durable=True)
    return suite


def read_suite(folder: Path) -> Suite:
    """Read a suite, which may be foreign; its files are not compared with their hashes.

    Raises:
        InputError: the folder holds no suite, or its file is damaged.
    """
    if not (folder / FILE).is_file():
        raise InputError(f"{folder} holds no {FILE}", _REMEDY)
    check_run_folder(folder)
    value = read_json(folder / FILE, _REMEDY)
    value.pop("hash", None)
    try:
        return Suite.model_validate(value)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise InputError(f"{folder / FILE} is damaged at {where}: {first['msg']}", "restore the file") from error


def list_changes_of_suite(folder: Path) -> tuple[str, ...]:
    """A line for each file that differs from its hash; raises InputError as ``read_suite``."""
    suite = read_suite(folder)
    changes = [] if read_bytes(folder / FILE) == suite.text.encode() else [f"{FILE}: it was changed"]
    known = {task.name for task in suite.tasks}
    present = {path.name for path in (folder / TASKS).iterdir()} if (folder / TASKS).is_dir() else set[str]()
    changes += [f"{TASKS}/{name}: it was added" for name in sorted(present - known)]
    for task in suite.tasks:
        place = folder / TASKS / task.name
        now = hash_folder_files(place) if place.is_dir() else {}
        changes += [f"{TASKS}/{task.name}/{line}" for line in describe_hash_differences(task.files, now)]
    return tuple(changes)


def open_suite_task(folder: Path, task: SuiteTask) -> TaskFolder:
    """The task folder of a task of a suite. Raises InputError: it is missing or damaged."""
    return open_task_folder(folder / TASKS / task.name)


def find_tags(instance: TaskInstance, words: str) -> tuple[Tag, ...]:
    """Tags of a task: by its goals what is placed in, on or beside what, by its words how objects are told apart.

    A goal by pose or zone does not name what is there; the sentence made of the goals does.
    """
    spoken, stated = words.lower(), (instance.instruction or words).lower()
    kinds = {goal.relation_kind for goal in instance.goals}
    moved = [number for goal in instance.goals for number in goal.objects]
    applies: Mapping[Tag, bool] = {
        "in": bool(kinds & set(_IN)) or bool(_IN_WORDS.search(stated)),
        "on": bool(kinds & set(_ON)) or bool(_ON_WORDS.search(stated)),
        "beside": bool(kinds & set(_BESIDE)),
        "side": bool(_SIDES.search(spoken)),
        "line": "aligned" in kinds or bool(_LINE_WORDS.search(stated)),
        "order": "stacked" in kinds or bool(_ORDERED.search(spoken)),
        "several moves": len(set(moved)) > 1,
        "pushing": instance.primitive == "push",
    }
    return (*find_word_tags(words), *(tag for tag, holds in applies.items() if holds))


def find_word_tags(words: str) -> tuple[Tag, ...]:
    """Tags of an instruction: how its words tell objects apart."""
    spoken = words.lower()
    color, size = bool(_COLORS.search(spoken)), bool(_SIZES.search(spoken))
    applies: Mapping[Tag, bool] = {"color": color, "size": size, "kind": not (color or size)}
    return tuple(tag for tag, holds in applies.items() if holds)


def _read_words(source: TaskFolder) -> dict[Wording, str]:
    """Instructions of a task: those of ``task.json``, else the sentence of its first instance."""
    specific = source.read_instance(source.seeds[0]).language
    file = source.path / "task.json"
    task = read_json(file, _REMEDY) if file.is_file() else {}
    words: dict[Wording, str] = {"default": str(task.get("task-description") or specific), "specific": specific}
    given: dict[str, Any] = task["instructions"] if isinstance(task.get("instructions"), dict) else {}
    variants: tuple[Wording, ...] = ("vague", "default", "specific")
    for kind in variants:
        variant = given.get(kind)
        if isinstance(variant, dict) and (text := cast("dict[str, Any]", variant).get("text")):
            words[kind] = str(text)
    return words


def _unique_folder_name(task: str, taken: set[str]) -> str:
    """The task's class name in kebab-case, with a number if it is taken."""
    stem = re.sub(r"[^a-z0-9]+", "-", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", task).lower()).strip("-")[:80] or "task"
    number, name = 1, stem
    while name in taken:
        number += 1
        name = f"{stem}-{number}"
    return name
