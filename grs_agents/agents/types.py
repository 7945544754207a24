"""What the agents say, as frozen types."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import ConfigDict, Field, field_validator

from grs_agents.base import Frozen

Verdict = Literal["fix_code", "fix_test", "fix_task"]
"""The router's two answers, spelt as in the paper, and a third: the task cannot be done as it is defined."""
ToolFunction = Callable[..., str | list[Any]]
"""What a tool tells a model: words, or content blocks such as a picture."""


@dataclass(frozen=True)
class ToolCalling:
    """What an agent may call, how often, and in which graph."""

    tools: Mapping[str, ToolFunction]  # by name; the docstring and the annotations are what the model reads
    steps: int  # calls of tools in all
    graph: str  # for messages


class Description(Frozen):
    """What the describer says of one segmented crop (paper, Scene Comprehension, step 2)."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    is_object: bool
    description: str = Field(min_length=1)
    color: str
    shape: str
    category: str
    part_of: int | None = None  # the segment that shows the rest of the thing that this one is a piece of
    # open at the top, so that things can be put into it; None where nobody says so
    open_top: bool | None = None


class SegmentReply(Description):
    """A description in a reply about several segments; ``id`` is the segment's number."""

    id: int | None = None


class Match(Frozen):
    """What the matcher says of one candidate (paper, Scene Comprehension, step 3).

    ``asset`` names a library asset; ``no_asset`` is a real object that the library lacks; ``no_object`` is a
    segment that is not an object at all.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    match: Literal["asset", "no_asset", "no_object"]
    asset: str | None = None
    reason: str = ""


class TaskDefinition(Frozen):
    """The paper's three fields, with its spelling in JSON."""

    model_config = ConfigDict(frozen=True, extra="ignore", populate_by_name=True)

    name: str = Field(alias="task-name", min_length=1, max_length=100)
    description: str = Field(alias="task-description", min_length=1)
    assets: tuple[str, ...] = Field(alias="assets-used", min_length=1)

    @field_validator("name")
    @classmethod
    def normalize_task_name(cls, name: str) -> str:
        """Task names become file and class names: letters, digits and dashes."""
        slug = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
        if not slug:
            raise ValueError("task-name needs letters or digits")
        return slug

    def as_json(self) -> dict[str, Any]:
        """The definition as the paper prints it."""
        return self.model_dump(mode="json", by_alias=True)


class TaskRevision(TaskDefinition):
    """A task defined anew because it could not be done, and what was given up with it."""

    given_up: str = Field(alias="given-up", min_length=1, max_length=500)

    def as_definition(self) -> TaskDefinition:
        """The task alone."""
        return TaskDefinition.model_validate(self.as_json())


class RouterReply(Frozen):
    """The router's explanation and verdict."""

    verdict: Verdict
    explanation: str


class WordsJudgement(Frozen):
    """Whether a task's words and its goals say the same."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    # ``unclear``: the judge does not understand the words, or they may mean something else too
    verdict: Literal["agrees", "differs", "unclear"]
    reason: str = Field(min_length=1)


class NoReply(Frozen):
    """A role whose model gave no usable reply: an outcome, not an exception."""

    role: str
    tries: int  # how many replies were refused
    problem: str  # what was wrong with the last one

    def __str__(self) -> str:
        return f"the {self.role} model gave no usable reply in {self.tries} tries: {self.problem}"
