"""Ask the offline model as each role and take its reply apart."""

import json
from collections.abc import Sequence
from typing import Any

from grs_agents.audit.goal_sentences import TaskInWords
from grs_agents.models.offline.chat import OfflineChatModel
from tests.models.conftest import Json, render

API = "# API\n\n## Task\n\n```python\nclass Task: ...\n```\n"


def as_text(value: Any) -> str:
    """Indented JSON, as the agents insert it."""
    return json.dumps(value, indent=1)


def block(reply: str, language: str) -> str:
    """The one fenced block of a reply."""
    head, _, rest = reply.partition(f"```{language}\n")
    body, fence, tail = rest.partition("```")
    assert fence and not head.strip() and not tail.strip(), reply
    return body


def task_for(scene: Json, seed: int = 0) -> Json:
    """A task definition for a scene; an empty one where the model has none to offer."""
    values = {"scene": as_text(scene), "fixtures": "", "sides": ""}
    reply = OfflineChatModel(seed=seed).invoke(render("task", values))
    results: Json = json.loads(block(str(reply.text), "json")) if "```" in str(reply.text) else {}
    return results


def simulation_for(task: Json, scene: Json, seed: int = 0) -> str:
    """A simulation program for a task."""
    values = {"task": as_text(task), "scene": as_text(scene), "api": API, "examples": "x = 1"}
    return block(str(OfflineChatModel(seed=seed).invoke(render("simulation", values)).text), "python")


def unit_tests_for(task: Json, code: str) -> str:
    """Tests for a program."""
    values = {"task": as_text(task), "code": code, "api": API}
    return block(str(OfflineChatModel().invoke(render("tests", values)).text), "python")


def fixed_code(task: Json, scene: Json, code: str, report: str, seed: int = 0, tests: str = "") -> str:
    """The next version of a program."""
    values = {
        "task": as_text(task),
        "scene": as_text(scene),
        "code": code,
        "tests": tests,
        "test_results": report,
        "history": "",
        "explanation": "",
        "api": API,
    }
    return block(str(OfflineChatModel(seed=seed).invoke(render("fix_code", values)).text), "python")


def fixed_tests(task: Json, code: str, tests: str, report: str) -> str:
    """The next version of the tests."""
    values = {
        "task": as_text(task),
        "scene": "{}",
        "code": code,
        "tests": tests,
        "test_results": report,
        "history": "",
        "explanation": "",
        "api": API,
    }
    return block(str(OfflineChatModel().invoke(render("fix_tests", values)).text), "python")


def verdict_on(
    report: str,
    task: Json | None = None,
    scene: Json | None = None,
    code: str = "",
    verdicts: str = "fix_code, fix_test, fix_task",
) -> tuple[str, str]:
    """The router's verdict and its explanation."""
    values = {
        "task": as_text(task or {}),
        "scene": as_text(scene or {}),
        "code": code,
        "tests": "",
        "test_results": report,
        "history": "",
        "verdicts": verdicts,
    }
    text = str(OfflineChatModel().invoke(render("route", values)).text)
    explanation, _, rest = text.partition("```\n")
    return rest.removesuffix("\n```"), explanation


def judge(words: str, told: TaskInWords, other_texts: Sequence[str] = ()) -> tuple[str, str]:
    """The verdict on a task's words and what else is said of it, and the reason."""
    rows = "\n".join(as_text(row).replace("\n", " ") for row in told.objects)
    values = {"words": words, "other_texts": "\n".join(other_texts), "objects": rows, "goals": "\n".join(told.goals)}
    values |= dict.fromkeys(("sentence", "notes"), "")
    answer: Json = json.loads(block(str(OfflineChatModel().invoke(render("judge", values)).text), "json"))
    return answer["verdict"], answer["reason"]
