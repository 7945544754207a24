"""Inputs, pictures and parsers of the agents: the eight of the paper, grouper of segments, reviser and judge of a task.

Following the paper, the scene image goes to the describer, matcher, task author, simulation author and code fixer
(vision-language models), not to the test author and test fixer (language models). The router and the fixers of program
and task also see the end of the robot's episode; the judge sees its start and its end.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, Literal, TypeVar, cast

from grs_agents.agents.agent import Agents
from grs_agents.agents.reply import (
    ReplyError,
    extract_python_program,
    extract_test_program,
    join_problems,
    list_problems,
    parse_json,
    parse_verdict,
    read_json_rows,
)
from grs_agents.agents.types import (
    Description,
    Grouping,
    Match,
    NoReply,
    RouterReply,
    SegmentMatch,
    SegmentReply,
    TaskDefinition,
    TaskRevision,
    ToolCalling,
    Verdict,
    WordsJudgement,
)

Json = dict[str, Any]
Task = TypeVar("Task", bound=TaskDefinition)
Row = TypeVar("Row", SegmentReply, SegmentMatch)


def group_segments(
    agents: Agents, rows: Sequence[Json], size: tuple[int, int], picture: str, images: Sequence[str]
) -> Grouping | NoReply:
    """Correct a segmentation.

    Args:
        rows: all segments, each with its ``id`` and its ``box``.
        size: width and height of the picture, pixels.
        picture: text that describes ``images``.
    """
    values = {"segments": to_json_lines(rows), "picture": picture}
    seen = {int(row["id"]): row["box"] for row in rows}
    return agents.ask_role(
        "group", values, lambda text: _read_boxes_as_meant(parse_json(text, Grouping), seen, size), images
    )


def _read_boxes_as_meant(reply: Grouping, segments: Mapping[int, Sequence[float]], size: tuple[int, int]) -> Grouping:
    """The reply with boxes of left, top, width and height in pixels, where its boxes can only be meant otherwise.

    Boxes of less than a pixel are shares of the picture. Boxes that reach beyond the picture, or lie beside the segment
    that they divide, are left, top, right and bottom if all fit as such.

    Args:
        segments: the box of each segment, by number, pixels.
        size: width and height of the picture, pixels.
    """

    def fits(reply: Grouping) -> bool:
        picture = (0, 0, *size)
        around = [(box, segments.get(item.segment, picture)) for item in reply.split for box in item.boxes]
        around += [(item.box, picture) for item in reply.missing]
        return all(
            min(box[2:]) > 0
            and box[0] + box[2] <= 1.02 * size[0]
            and box[1] + box[3] <= 1.02 * size[1]
            and _shared_area(box, outer) >= 0.5 * box[2] * box[3]
            for box, outer in around
        )

    sides = [side for item in reply.split for box in item.boxes for side in box]
    sides += [side for item in reply.missing for side in item.box]
    if sides and max(sides) <= 1:
        return reply.with_boxes(lambda box: (box[0] * size[0], box[1] * size[1], box[2] * size[0], box[3] * size[1]))
    corners = reply.with_boxes(lambda box: (box[0], box[1], box[2] - box[0], box[3] - box[1]))
    return corners if not fits(reply) and fits(corners) else reply


def _shared_area(first: Sequence[float], second: Sequence[float]) -> float:
    """The area of the intersection of two boxes (left, top, width, height)."""
    wide, high = (
        min(first[axis] + first[axis + 2], second[axis] + second[axis + 2]) - max(first[axis], second[axis])
        for axis in (0, 1)
    )
    return max(0.0, wide) * max(0.0, high)


def describe_segments(
    agents: Agents, rows: Sequence[Json], numbers: Sequence[int], pictures: str, images: Sequence[str]
) -> dict[int, Description] | NoReply:
    """Describe segments.

    Args:
        rows: the segments to describe, each with its ``id``.
        numbers: ids of all segments.
        pictures: text that describes ``images``.
    """
    wanted = [int(row["id"]) for row in rows]
    usable: dict[int, SegmentReply] = {}

    def parse_descriptions(text: str) -> dict[int, Description]:
        described, problems = _read_rows_by_number(text, SegmentReply, wanted, usable)
        for number in set(wanted) & set(described):
            whole = described[number].part_of
            # no segment has the number 0, and none is a piece of itself
            if whole == number or (whole is not None and whole <= 0 and whole not in numbers):
                described[number] = described[number].model_copy(update={"part_of": None})
            elif whole is not None and whole not in numbers:
                problems.append(f"segment {number}: part_of is {whole}, which is no segment; else give null")
                del usable[number]
        if problems:
            raise ReplyError(join_problems(problems))
        return {number: Description.model_validate(described[number].model_dump()) for number in wanted}

    return agents.ask_role(
        "describe", {"segments": to_json_lines(rows), "pictures": pictures}, parse_descriptions, images
    )


def _read_rows_by_number(
    text: str, kind: type[Row], wanted: Sequence[int], usable: dict[int, Row]
) -> tuple[dict[int, Row], list[str]]:
    """The replies about segments by number, and the problems of those that are unreadable or missing.

    The only reply about the only segment needs no number. Replies are added to ``usable``, those of earlier tries,
    which stand where this try says nothing that can be read.
    """
    rows = read_json_rows(text, kind)
    problems = list_problems(rows)
    replies = [row.parsed for row in rows if row.parsed is not None]
    if len(rows) == len(replies) == len(wanted) == 1:
        replies = [replies[0].model_copy(update={"id": wanted[0]})]
    usable |= {number: reply for reply in replies if (number := reply.id) is not None}
    if usable.keys() >= set(wanted):
        return dict(usable), []
    faulty = {str(row.number) for row in rows if row.parsed is None}
    missing = [number for number in wanted if number not in usable and str(number) not in faulty]
    if missing and "None" not in faulty:
        problems.append(f"the reply has no object with the id {', '.join(map(str, missing))}")
    return dict(usable), problems


def match_segments(
    agents: Agents, rows: Sequence[Json], assets: Sequence[Json], pictures: str, images: Sequence[str]
) -> dict[int, Match] | NoReply:
    """Match segments with assets.

    Args:
        rows: the described segments, each with its ``id``.
        assets: with name, description, color, category and size.
        pictures: text that describes ``images``.
    """
    wanted = [int(row["id"]) for row in rows]
    names = {str(asset["name"]): str(asset["name"]) for asset in assets}
    usable: dict[int, SegmentMatch] = {}

    def parse_matches(text: str) -> dict[int, Match]:
        matched, problems = _read_rows_by_number(text, SegmentMatch, wanted, usable)
        matches: dict[int, Match] = {}
        for number in wanted:
            if number not in matched:
                continue
            fields = matched[number].model_dump(exclude={"id"})
            if matched[number].match != "asset":
                fields["asset"] = None
            else:
                written = matched[number].asset or ""
                fields["asset"] = _find_asset(written, names)
                if fields["asset"] is None:
                    near = _suggest_assets(written, names)
                    problems.append(f"segment {number}: asset {written!r} is not in the list of assets{near}")
                    del usable[number]
            matches[number] = Match.model_validate(fields)
        if problems:
            raise ReplyError(join_problems(problems))
        return matches

    values = {"assets": to_json_lines(assets), "pictures": pictures, "segments": to_json_lines(rows)}
    return agents.ask_role("match", values, parse_matches, images)


def author_task(
    agents: Agents, scene: Json, fixtures: Sequence[Json], images: Sequence[str], sides: str = ""
) -> TaskDefinition | NoReply:
    """Define a task for the scene.

    Args:
        scene: its objects.
        fixtures: library assets that may be added to the photo's objects.
        images: the photo, or none.
        sides: a sentence that says in which direction of the photo the robot's sides lie.
    """
    names = name_assets(scene["objects"], fixtures)

    def parse_task_definition(text: str) -> TaskDefinition:
        return _name_assets_exactly(parse_json(text, TaskDefinition), names)

    return agents.ask_role(
        "task",
        {"scene": to_json_text(scene), "fixtures": to_json_lines(fixtures), "sides": sides},
        parse_task_definition,
        images,
    )


def author_simulation(
    agents: Agents,
    task: TaskDefinition,
    scene: Json,
    api: str,
    examples: str,
    images: Sequence[str],
    role: Literal["simulation", "rival"] = "simulation",
    calling: ToolCalling | None = None,
) -> str | NoReply:
    """Write the simulation program with the model of ``role``, which may first call the tools of ``calling``."""
    values = {"task": to_json_text(task.as_json()), "scene": to_json_text(scene), "api": api, "examples": examples}
    if calling is not None:
        from grs_agents.agents.tool_calling import ask_with_tools  # takes long to import

        return ask_with_tools(agents, role, values, extract_python_program, images, calling)
    return agents.ask_role(role, values, extract_python_program, images, "simulation")


def author_tests(agents: Agents, task: TaskDefinition, code: str, api: str) -> str | NoReply:
    """Write the tests, from the task and the program alone."""
    values = {"task": to_json_text(task.as_json()), "code": code, "api": api}
    return agents.ask_role("tests", values, extract_test_program)


@dataclass(frozen=True)
class JudgedPrograms:
    """Inputs of the router and of every fixer."""

    task: TaskDefinition
    scene: str  # the objects of the task as JSON
    code: str  # the simulation program
    tests: str
    results: str  # the evidence
    history: Sequence[str]  # a line for each fix
    images: Sequence[str] = ()  # the photo (not for the router), and the end of the robot's episode if it was drawn
    explanation: str = ""  # the router's, for a fixer

    def as_prompt_values(self, *names: str, **more: str) -> dict[str, str]:
        """The variables of a prompt: the common variables ``names``, and ``more``."""
        values = {
            "task": to_json_text(self.task.as_json()),
            "scene": self.scene,
            "code": self.code,
            "tests": self.tests,
            "test_results": self.results,
            "history": "\n".join(self.history) or "(no fixes yet)",
            "explanation": self.explanation,
        }
        return {name: values[name] for name in names} | more


_MEANINGS: dict[Verdict, str] = {
    "fix_code": "change the simulation program",
    "fix_test": "change the tests",
    "fix_task": "change the task: no program can do it as it is defined, as the evidence shows (the arm cannot hold or "
    "reach something, it does not fit into a container of fixed size or does not stand), or its words are unclear",
}


def decide_what_to_fix(agents: Agents, judged: JudgedPrograms, verdicts: Sequence[Verdict]) -> RouterReply | NoReply:
    """Decide between fixing the program, the tests and the task, as far as ``verdicts`` has them."""
    lines = "\n".join(f"{verdict}: {_MEANINGS[verdict]}" for verdict in verdicts)
    names = ("task", "scene", "code", "tests", "test_results", "history")
    values = judged.as_prompt_values(*names, verdicts=lines)
    return agents.ask_role("route", values, parse_verdict, judged.images)


def fix_code(agents: Agents, judged: JudgedPrograms, api: str) -> str | NoReply:
    """Write the next version of the simulation program."""
    names = ("task", "scene", "code", "tests", "test_results", "history", "explanation")
    return agents.ask_role("fix_code", judged.as_prompt_values(*names, api=api), extract_python_program, judged.images)


def fix_tests(agents: Agents, judged: JudgedPrograms, api: str) -> str | NoReply:
    """Write the next version of the tests."""
    names = ("task", "scene", "code", "tests", "test_results", "history", "explanation")
    return agents.ask_role("fix_tests", judged.as_prompt_values(*names, api=api), extract_test_program)


def fix_task(
    agents: Agents, judged: JudgedPrograms, objects: Sequence[Json], fixtures: Sequence[Json]
) -> TaskRevision | NoReply:
    """Revise a task; fields that the reply leaves out stay. ``objects`` of the scene have a name and an asset."""
    named, original = name_assets(objects, fixtures), judged.task.as_json()

    class PartialRevision(TaskRevision):
        @classmethod
        def fill_missing_words(cls, table: dict[Any, Any]) -> dict[Any, Any]:
            """Take over the fields of the original that the reply leaves out, unless it leaves out all."""
            aliases = {name: str(field.alias) for name, field in cls.model_fields.items()}
            given = {aliases.get(key, key): value for key, value in table.items() if value is not None}
            return {**original, **given} if given.keys() & {*aliases.values()} else table

    def parse_task_revision(text: str) -> TaskRevision:
        revision = _name_assets_exactly(parse_json(text, PartialRevision), named)
        return TaskRevision.model_validate(revision.as_json())

    names = ("task", "scene", "code", "test_results", "history", "explanation")
    values = judged.as_prompt_values(*names, fixtures=to_json_lines(fixtures))
    return agents.ask_role("fix_task", values, parse_task_revision, judged.images)


@dataclass(frozen=True)
class WordsEvidence:
    """Inputs of the judge, measured by trusted code but for ``words`` and ``other_texts``."""

    words: str  # the task's description
    sentence: str  # made of the goals
    other_texts: Sequence[str]  # the task's name, and the program's sentences for its goals, a line each
    objects: Sequence[Json]  # with their motion in the episode
    goals: Sequence[str]  # a sentence for each
    notes: Sequence[str] = ()  # objects left alone where the words speak of all, and directions of the robot's sides
    pictures: Sequence[str] = ()  # the table at the start and at the end, or none


def judge_words(agents: Agents, evidence: WordsEvidence, reverse: bool = False) -> WordsJudgement | NoReply:
    """Compare the words of a task with the sentence of its goals and its episode, without the program.

    ``reverse`` turns the order of the objects and pictures, for an independent second answer.
    """
    objects, pictures = list(evidence.objects), list(evidence.pictures)
    shown = "the table at the start, then at the end of the robot's work"
    if reverse:
        objects, pictures = objects[::-1], pictures[::-1]
        shown = "the table at the end of the robot's work, then at the start"
    values = {
        "words": evidence.words,
        "sentence": evidence.sentence,
        "other_texts": "\n".join(evidence.other_texts),
        "objects": to_json_lines(objects),
        "goals": "\n".join(evidence.goals) or "(there is no goal)",
        "notes": "\n".join([f"The pictures show {shown}, with names drawn in."] * bool(pictures) + [*evidence.notes]),
    }
    return agents.ask_role("judge", values, lambda text: parse_json(text, WordsJudgement), pictures)


def name_assets(objects: Sequence[Json], fixtures: Sequence[Json]) -> dict[str, str]:
    """Names of the assets of a scene and of the fixtures, by asset and by object."""
    assets = [str(item["asset"]) for item in objects] + [str(item["name"]) for item in fixtures]
    return {str(item.get("name", item["asset"])): str(item["asset"]) for item in objects} | {
        asset: asset for asset in assets
    }


def _find_asset(written: str, names: Mapping[str, str]) -> str | None:
    """The asset that ``written`` means, perhaps without folder or suffix; None if it is ambiguous."""
    if written in names:
        return names[written]
    loose = _spell_loosely(written)
    meant = {
        asset for name, asset in names.items() if loose in (_spell_loosely(name), _spell_loosely(name.split("/")[-1]))
    }
    return meant.pop() if len(meant) == 1 else None


def _spell_loosely(name: str) -> str:
    return re.sub(r"[\s_-]+", "_", name.strip().lower()).removesuffix(".urdf")


def _suggest_assets(written: str | None, names: Mapping[str, str]) -> str:
    near = get_close_matches(written or "", names, n=3, cutoff=0.3)
    return f"; the nearest are {', '.join(near)}" if near else ""


def _name_assets_exactly(task: Task, names: Mapping[str, str]) -> Task:
    """Replace the names in ``task`` by exact asset names. Raises ReplyError: unknown names, all of them listed."""
    assets = {written: _find_asset(written, names) for written in task.assets}
    if unknown := [written for written, asset in assets.items() if asset is None]:
        near = "".join(f"; {written!r}{_suggest_assets(written, names)[1:]}" for written in unknown)
        raise ReplyError(f"assets-used names {unknown}, which are neither in the scene nor fixtures{near}")
    return task.model_copy(update={"assets": tuple(dict.fromkeys(assets.values()))})


def to_json_text(value: Json) -> str:
    """``value`` as compact JSON; each item of its lists of objects has a separate line."""
    fields: list[str] = []
    for key, item in value.items():
        text = _compact_json(item)
        if isinstance(item, list) and item and isinstance(item[0], dict):
            text = "[\n" + ",\n".join(map(_compact_json, cast(list[Any], item))) + "\n]"
        fields.append(f"{json.dumps(key)}:{text}")
    return "{" + ",\n".join(fields) + "}"


def to_json_lines(values: Sequence[Json]) -> str:
    """An object per line."""
    return "\n".join(map(_compact_json, values))


def _compact_json(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False)
