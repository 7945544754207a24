"""The eight agents of the paper, who revises a task and who judges it: what each is told, shown and asked for.

Following the paper, the scene image goes to the describer, matcher, task author, simulation author and code fixer
(vision-language models), not to the test author and test fixer (language models). The router and the fixers of program
and task also see how the robot's episode ended; the judge sees its start and its end.
"""

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast

from grs_agents.agents.agent import Agents
from grs_agents.agents.reply import ReplyError, extract_python_program, parse_json, parse_json_rows, parse_verdict
from grs_agents.agents.types import (
    Description,
    Match,
    NoReply,
    RouterReply,
    SegmentReply,
    TaskDefinition,
    TaskRevision,
    ToolCalling,
    Verdict,
    WordsJudgement,
)

Json = dict[str, Any]


def describe_segments(
    agents: Agents, rows: Sequence[Json], numbers: Sequence[int], pictures: str, images: Sequence[str]
) -> dict[int, Description] | NoReply:
    """Describe the segments of ``rows``, by their ``id``; ``numbers`` are those of all segments.

    ``images`` show what ``pictures`` says.
    """
    asked = [int(row["id"]) for row in rows]

    def parse_descriptions(text: str) -> dict[int, Description]:
        replies = parse_json_rows(text, SegmentReply)
        if len(replies) == len(asked) == 1:
            replies = [replies[0].model_copy(update={"id": asked[0]})]
        found = {number: reply for reply in replies if (number := reply.id) is not None}
        if missing := sorted(set(asked) - set(found)):
            raise ReplyError(f"the reply has no object with the id {missing[0]}; describe the segments {asked}")
        for number in asked:
            whole = found[number].part_of
            if whole is not None and (whole == number or whole not in numbers):
                raise ReplyError(f"segment {number}: part_of is {whole}, which is no other segment; else give null")
        return {number: Description.model_validate(found[number].model_dump()) for number in asked}

    return agents.ask_role(
        "describe", {"segments": to_json_lines(rows), "pictures": pictures}, parse_descriptions, images
    )


def match_asset(agents: Agents, candidate: Json, assets: Sequence[Json], images: Sequence[str]) -> Match | NoReply:
    """Match one candidate with an asset. ``assets`` hold name, description, color and size."""
    names = {str(asset["name"]) for asset in assets}

    def parse_match(text: str) -> Match:
        answer = parse_json(text, Match)
        if answer.match == "asset" and answer.asset not in names:
            raise ReplyError(f"asset {answer.asset!r} is not in the list of assets")
        return answer

    return agents.ask_role(
        "match", {"candidate": to_json_text(candidate), "assets": to_json_lines(assets)}, parse_match, images
    )


def author_task(
    agents: Agents, scene: Json, fixtures: Sequence[Json], images: Sequence[str]
) -> TaskDefinition | NoReply:
    """Define a task for the scene. ``fixtures``: library assets that may be added to what the photo shows."""
    known = {str(item["asset"]) for item in scene["objects"]} | {str(item["name"]) for item in fixtures}

    def parse_task_definition(text: str) -> TaskDefinition:
        task = parse_json(text, TaskDefinition)
        _refuse_unknown_assets(task, known)
        return task

    return agents.ask_role(
        "task", {"scene": to_json_text(scene), "fixtures": to_json_lines(fixtures)}, parse_task_definition, images
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
    """Write the simulation program. ``role`` says whose model does, ``calling`` which tools it may call before."""
    values = {"task": to_json_text(task.as_json()), "scene": to_json_text(scene), "api": api, "examples": examples}
    if calling is not None:
        from grs_agents.agents.tool_calling import ask_with_tools  # takes long to import

        return ask_with_tools(agents, role, values, extract_python_program, images, calling)
    return agents.ask_role(role, values, extract_python_program, images, "simulation")


def author_tests(agents: Agents, task: TaskDefinition, code: str, api: str) -> str | NoReply:
    """Write the tests, from the task and the program alone."""
    values = {"task": to_json_text(task.as_json()), "code": code, "api": api}
    return agents.ask_role("tests", values, extract_python_program)


@dataclass(frozen=True)
class JudgedPrograms:
    """What the router and every fixer are shown."""

    task: TaskDefinition
    scene: str  # the objects of the task as JSON
    code: str  # the simulation program
    tests: str
    results: str  # the evidence
    history: Sequence[str]  # one line for each fix
    images: Sequence[str] = ()  # the photo (not for the router), and the end of the robot's episode if it was drawn
    explanation: str = ""  # the router's, for a fixer

    def as_prompt_values(self, *names: str, **more: str) -> dict[str, str]:
        """The variables of a prompt: those of ``names`` that all have, and ``more``."""
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
    "fix_task": "change the task: no program can do it as it is defined, as the evidence shows (something does not fit "
    "into a container of fixed size, is out of reach or does not stand)",
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
    return agents.ask_role("fix_tests", judged.as_prompt_values(*names, api=api), extract_python_program)


def fix_task(agents: Agents, judged: JudgedPrograms, known: Sequence[str], fixtures: str) -> TaskRevision | NoReply:
    """Revise a task that cannot be done as it is defined; ``known`` are the assets of scene and fixtures."""

    def parse_task_revision(text: str) -> TaskRevision:
        revision = parse_json(text, TaskRevision)
        _refuse_unknown_assets(revision, known)
        return revision

    names = ("task", "scene", "code", "test_results", "history", "explanation")
    return agents.ask_role(
        "fix_task", judged.as_prompt_values(*names, fixtures=fixtures), parse_task_revision, judged.images
    )


def judge_words(
    agents: Agents,
    words: str,
    other_texts: Sequence[str],
    objects: Sequence[Json],
    goals: Sequence[str],
    images: Sequence[str],
) -> WordsJudgement | NoReply:
    """Compare a task's ``words`` with ``goals`` in sentences and what happened to ``objects``, without the program.

    ``other_texts`` are further words that people see, one line each: the task's name, what the program calls its goals.
    ``images``: the table at the start and at the end, or none.
    """
    values = {
        "words": words,
        "other_texts": "\n".join(other_texts),
        "objects": to_json_lines(objects),
        "goals": "\n".join(goals) or "(there is no goal)",
    }
    return agents.ask_role("judge", values, lambda text: parse_json(text, WordsJudgement), images)


def _refuse_unknown_assets(task: TaskDefinition, known: Collection[str]) -> None:
    unknown = sorted(set(task.assets) - set(known))
    if unknown:
        raise ReplyError(f"assets-used names {unknown}, which are neither in the scene nor fixtures")


def to_json_text(value: Json) -> str:
    """``value`` as compact JSON, but for the items of its lists of objects: each has a line of its own."""
    return (
        "{" + ",\n".join(f"{json.dumps(key)}:{_json_with_an_item_per_line(item)}" for key, item in value.items()) + "}"
    )


def to_json_lines(values: Sequence[Json]) -> str:
    """One object a line."""
    return "\n".join(map(_compact_json, values))


def _json_with_an_item_per_line(value: Any) -> str:
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return "[\n" + ",\n".join(map(_compact_json, cast(list[Any], value))) + "\n]"
    return _compact_json(value)


def _compact_json(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False)
