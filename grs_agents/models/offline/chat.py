"""The embedded chat model: no key, no network, the same reply to the same prompt and seed."""

import hashlib
import random
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from langchain_core.callbacks import CallbackManagerForLLMRun
from langchain_core.language_models import LanguageModelInput
from langchain_core.language_models.chat_models import BaseChatModel
from langchain_core.messages import AIMessage, BaseMessage, HumanMessage, SystemMessage, ToolCall, ToolMessage
from langchain_core.messages.ai import UsageMetadata
from langchain_core.outputs import ChatGeneration, ChatResult
from langchain_core.runnables import Runnable

from grs_agents.base.errors import UnknownNameError
from grs_agents.models.offline.authors import author_simulation, author_task, fix_code, revise_task
from grs_agents.models.offline.describer_and_matcher import (
    describe_asset,
    describe_segments,
    extract_message_images,
    match_segments,
)
from grs_agents.models.offline.judging.judge import judge_words
from grs_agents.models.offline.mistakes import Program, introduce_suitable_mistake
from grs_agents.models.offline.prompt_text import PromptText, parse_prompt, parse_scene_objects
from grs_agents.models.offline.router import decide_what_to_fix
from grs_agents.models.offline.unittest_author import author_tests, fix_tests

_SEGMENTATION_STAYS = '```json\n{"merge": [], "split": [], "drop": [], "missing": []}\n```'
ReplyFunction = Callable[[PromptText, list[bytes], np.random.Generator], str]
ROLES: Mapping[str, ReplyFunction] = {
    "group": lambda prompt, pictures, rng: _SEGMENTATION_STAYS,
    "describe": lambda prompt, pictures, rng: describe_segments(prompt, pictures),
    "describe_asset": lambda prompt, pictures, rng: describe_asset(prompt),
    "match": lambda prompt, pictures, rng: match_segments(prompt),
    "task": lambda prompt, pictures, rng: author_task(prompt, rng),
    "simulation": lambda prompt, pictures, rng: author_simulation(prompt),
    "tests": lambda prompt, pictures, rng: author_tests(prompt),
    "route": lambda prompt, pictures, rng: decide_what_to_fix(prompt),
    "fix_code": lambda prompt, pictures, rng: fix_code(prompt),
    "fix_task": lambda prompt, pictures, rng: revise_task(prompt),
    "fix_tests": lambda prompt, pictures, rng: fix_tests(prompt),
    "judge": lambda prompt, pictures, rng: judge_words(prompt),
}
_AUTHORED: Mapping[str, Program] = {
    "simulation": "simulation",
    "tests": "tests",
    "fix_code": "simulation",
    "fix_tests": "tests",
}
"""The program that each role writes; fixes may contain mistakes."""
_PYTHON = re.compile(r"```python\n(.*)```", re.DOTALL)
_HELP = "I answer prompts that begin with a line `# Role: NAME`, NAME being one of: "


class OfflineChatModel(BaseChatModel):
    """A chat model that answers the GRS prompts by rules.

    It reads the same prompts as any model, and takes its role from the ``# Role:`` line. Equal prompt and seed give an
    equal reply.
    """

    model: str = "grs-offline-1"  # its name in traces
    seed: int = 0  # of its random choices
    faulty: float = 0.0  # probability of a mistake in each program and each test script that it writes, also in fixes

    @property
    def _llm_type(self) -> str:
        return "grs-offline"

    @property
    def _identifying_params(self) -> dict[str, Any]:
        return {"model": self.model, "seed": self.seed, "faulty": self.faulty}

    def bind_tools(
        self, tools: Sequence[Any], *, tool_choice: str | None = None, **kwargs: Any
    ) -> Runnable[LanguageModelInput, AIMessage]:
        """The model with tools; it calls ``check`` alone, with its draft, once."""
        return self.bind(tools=[str(getattr(tool, "name", "")) for tool in tools])

    def _generate(
        self,
        messages: list[BaseMessage],
        stop: list[str] | None = None,
        run_manager: CallbackManagerForLLMRun | None = None,
        **kwargs: Any,
    ) -> ChatResult:
        text = self._answer_last_prompt(messages)
        for word in stop or ():
            text = text.split(word)[0]
        calls: list[ToolCall] = []
        block = _PYTHON.fullmatch(text)
        checked = any(isinstance(message, ToolMessage) for message in messages)
        if block is not None and "check" in kwargs.get("tools", ()) and not checked:
            calls = [ToolCall(name="check", args={"program": block[1]}, id=f"check-{len(messages)}", type="tool_call")]
        read = sum(_estimate_token_count(str(message.text)) for message in messages)
        replied = _estimate_token_count(text)
        message = AIMessage(
            "" if calls else text,
            tool_calls=calls,
            usage_metadata=UsageMetadata(input_tokens=read, output_tokens=replied, total_tokens=read + replied),
            response_metadata={
                "model_name": self.model,
                "model_provider": "grs",
                "finish_reason": "stop",
                "token_usage": {"cost": 0.0},
            },
        )
        return ChatResult(generations=[ChatGeneration(message=message)])

    def _answer_last_prompt(self, messages: list[BaseMessage]) -> str:
        system = "\n\n".join(str(message.text) for message in messages if isinstance(message, SystemMessage))
        asked = [message for message in messages if isinstance(message, HumanMessage)]
        for message in reversed(asked):
            text = f"{system}\n\n{message.text}" if message is asked[0] else str(message.text)
            prompt = parse_prompt(text)
            if prompt is not None and prompt.role in ROLES:
                seeding = text
                if prompt.role == "task":  # neither the prompt's words nor a millimetre change the choice
                    objects = parse_scene_objects(prompt.section_json("scene"))
                    seeding = "\n".join(sorted(obj.asset for obj in objects))
                digest = hashlib.sha256(seeding.encode()).digest()
                rng = np.random.default_rng([self.seed, int.from_bytes(digest[:8], "big")])
                reply = ROLES[prompt.role](prompt, extract_message_images(message), rng)
                block = _PYTHON.fullmatch(reply)
                program = _AUTHORED.get(prompt.role)
                if program is None or block is None or rng.random() >= self.faulty:
                    return reply
                generator = random.Random(int(rng.integers(1 << 31)))
                source, _ = introduce_suitable_mistake(block[1], program, generator)
                return f"```python\n{source}```"
        return _HELP + ", ".join(ROLES)


def _estimate_token_count(text: str) -> int:
    return max(1, len(text) // 4)


_NAME = re.compile(r"offline(?P<faulty>:faulty(?::(?P<share>[01](?:\.\d+)?|\.\d+))?)?")


def make_offline_model(name: str, seed: int) -> OfflineChatModel:
    """The model called ``offline``, ``offline:faulty`` or, with the probability of a mistake, ``offline:faulty:0.3``.

    Raises:
        UnknownNameError: there is no such offline model.
    """
    form = _NAME.fullmatch(name)
    faulty = float(form["share"] or 0.5) if form and form["faulty"] else 0.0
    if form is None or faulty > 1:
        raise UnknownNameError("model", name, ["offline", "offline:faulty", "offline:faulty:P with P from 0 to 1"])
    return OfflineChatModel(seed=seed, faulty=faulty)
