"""The eight agents of the paper: what each is told, shown and asked for.

Following the paper, the scene image goes to the describer, matcher, task author, simulation author and code fixer
(vision-language models), not to the test author and test fixer (language models).
"""

import json
from collections.abc import Sequence
from typing import Any

from grs_agents.agents.agent import Agents
from grs_agents.agents.reply import ReplyError, extract_python_program, parse_json, parse_verdict
from grs_agents.agents.types import Description, Match, NoReply, RouterReply, TaskDefinition

Json = dict[str, Any]


def describe_crop(agents: Agents, measurements: Json, images: Sequence[str]) -> Description | NoReply:
    """Describe one crop. ``images``: the crop, then the scene."""
    values = {"measurements": _to_json_text(measurements)}
    return agents.ask_role("describe", values, lambda text: parse_json(text, Description), images)


def match_asset(agents: Agents, candidate: Json, assets: Sequence[Json], images: Sequence[str]) -> Match | NoReply:
    """Match one candidate with an asset. ``assets`` hold name, description, color and size."""
    names = {str(asset["name"]) for asset in assets}

    def parse(text: str) -> Match:
        answer = parse_json(text, Match)
        if answer.match == "asset" and answer.asset not in names:
            raise ReplyError(f"asset {answer.asset!r} is not in the list of assets")
        return answer

    lines = "\n".join(json.dumps(asset, ensure_ascii=False) for asset in assets)
    return agents.ask_role("match", {"candidate": _to_json_text(candidate), "assets": lines}, parse, images)


def author_task(
    agents: Agents, scene: Json, fixtures: Sequence[Json], images: Sequence[str]
) -> TaskDefinition | NoReply:
    """Define a task for the scene. ``fixtures``: library assets that may be added to what the photo shows."""
    known = {str(item["asset"]) for item in scene["objects"]} | {str(item["name"]) for item in fixtures}

    def parse(text: str) -> TaskDefinition:
        task = parse_json(text, TaskDefinition)
        unknown = sorted(set(task.assets) - known)
        if unknown:
            raise ReplyError(f"assets-used names {unknown}, which are neither in the scene nor fixtures")
        return task

    lines = "\n".join(json.dumps(fixture, ensure_ascii=False) for fixture in fixtures)
    return agents.ask_role("task", {"scene": _to_json_text(scene), "fixtures": lines}, parse, images)


def author_simulation(
    agents: Agents, task: TaskDefinition, scene: Json, api: str, examples: str, images: Sequence[str]
) -> str | NoReply:
    """Write the simulation program."""
    values = {"task": _to_json_text(task.as_json()), "scene": _to_json_text(scene), "api": api, "examples": examples}
    return agents.ask_role("simulation", values, extract_python_program, images)


def author_tests(agents: Agents, task: TaskDefinition, code: str, api: str) -> str | NoReply:
    """Write the tests, from the task and the program alone."""
    values = {"task": _to_json_text(task.as_json()), "code": code, "api": api}
    return agents.ask_role("tests", values, extract_python_program)


def decide_what_to_fix(
    agents: Agents, task: TaskDefinition, results: str, history: Sequence[str]
) -> RouterReply | NoReply:
    """Decide between fixing the program and fixing the tests."""
    values = {
        "task": _to_json_text(task.as_json()),
        "test_results": results,
        "history": "\n".join(history) or "(no fixes yet)",
    }
    return agents.ask_role("route", values, parse_verdict)


def fix_code(
    agents: Agents,
    task: TaskDefinition,
    scene: Json,
    code: str,
    results: str,
    explanation: str,
    api: str,
    images: Sequence[str],
) -> str | NoReply:
    """Write the next version of the simulation program."""
    values = {
        "task": _to_json_text(task.as_json()),
        "scene": _to_json_text(scene),
        "code": code,
        "test_results": results,
        "explanation": explanation,
        "api": api,
    }
    return agents.ask_role("fix_code", values, extract_python_program, images)


def fix_tests(
    agents: Agents, task: TaskDefinition, code: str, tests: str, results: str, explanation: str
) -> str | NoReply:
    """Write the next version of the tests."""
    values = {
        "task": _to_json_text(task.as_json()),
        "code": code,
        "tests": tests,
        "test_results": results,
        "explanation": explanation,
    }
    return agents.ask_role("fix_tests", values, extract_python_program)


def _to_json_text(value: Json) -> str:
    return json.dumps(value, indent=1, ensure_ascii=False)
