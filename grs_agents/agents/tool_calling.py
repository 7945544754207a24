"""An agent that may call tools before it replies: LangChain's agent around a model whose every exchange is an event."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from threading import Lock
from typing import Any, TypeVar, cast

from langchain_core.callbacks import CallbackManagerForLLMRun
from langchain_core.language_models import LanguageModelInput
from langchain_core.messages import AIMessage, BaseMessage, HumanMessage
from langchain_core.messages import ToolCall as CalledTool
from langchain_core.outputs import ChatGeneration, ChatResult
from langchain_core.runnables import Runnable
from langchain_core.tools import BaseTool, StructuredTool
from langgraph.errors import GraphRecursionError
from pydantic import ValidationError
from pydantic.v1 import ValidationError as FirstValidationError

from grs_agents.agents.agent import Agents, image_block_from_file
from grs_agents.agents.prompt_template import render_prompt_template
from grs_agents.agents.reply import ReplyError
from grs_agents.agents.types import NoReply, ToolCalling, ToolFunction
from grs_agents.base import content
from grs_agents.base.errors import ConfigError, GrsError
from grs_agents.base.foreign.run_folder import resolve_member_file
from grs_agents.base.trace.events import ToolCall
from grs_agents.models.answer import Answer, require_complete_answer
from grs_agents.models.call import request_message
from grs_agents.models.factory import make_retries
from grs_agents.models.fallbacks import DelegatingChatModel
from grs_agents.models.key_redaction import redact_keys

Parsed = TypeVar("Parsed")
_MARK = "[tool calls] "
"""Before the calls in a logged reply, so that a recorded reply holds them too."""
_UNUSABLE = "(no usable reply)"


class StepsUsedUp(GrsError):
    """The model keeps calling tools without calls left."""


def ask_with_tools(
    agents: Agents,
    role: str,
    values: Mapping[str, str],
    parse: Callable[[str], Parsed],
    images: Sequence[str],
    calling: ToolCalling,
) -> Parsed | NoReply:
    """Ask ``role``, which may call tools first, and parse its last reply as ``Agents.ask_role`` does.

    Raises:
        ConfigError: LangChain is not installed, or the model of the role cannot call tools.
    """
    try:
        create_agent: Any = import_module("langchain.agents").create_agent
    except ImportError as error:
        what = f"graph {calling.graph!r} needs the package langchain, which is not installed"
        raise ConfigError(what, 'run: pip install "grs-agents[agent]"') from error
    file = content.content_path("prompts", getattr(agents.config.prompts, role))
    tools = (
        f"## Tools\n\nYou may call tools ({', '.join(calling.tools)}), {calling.steps} times in all, before you hand "
        "in your reply in the form asked for. A program that you only checked is not handed in: reply with it."
    )
    prompt = render_prompt_template(file, role, values)
    images = images if images and agents.takes_pictures(role) else ()
    blocks = [image_block_from_file(resolve_member_file(agents.folder, image)) for image in images]
    messages = replace(prompt, system=f"{prompt.system}\n\n{tools}").to_messages(blocks)
    model = LoggedToolModel(agents=agents, role=role, pictures=tuple(images), graph=calling.graph)
    limit = {"recursion_limit": 4 * (calling.steps + agents.config.reply_retries + 4)}
    graph: Any = create_agent(model, _CountedTools(agents, role, calling).build_langchain_tool_list())
    problem, tries = "", agents.config.reply_retries + 1
    for _ in range(tries):
        try:
            messages = graph.invoke({"messages": messages}, limit)["messages"]
            return parse(str(messages[-1].text))
        except ReplyError as error:
            problem = str(error)
        except StepsUsedUp as error:
            return NoReply(role=role, tries=tries, problem=str(error))
        except GraphRecursionError:
            problem = f"it called what is no tool until its {limit['recursion_limit']} steps were used up"
            return NoReply(role=role, tries=tries, problem=problem)
        words = f"Your reply could not be used: {problem}. Reply again, with all of it, in exactly the form asked for."
        messages = [*messages, HumanMessage(words)]
    return NoReply(role=role, tries=tries, problem=problem)


class LoggedToolModel(DelegatingChatModel):
    """The chat model of a role, with tools; its exchanges go through ``agents``."""

    agents: Any  # an `Agents`
    role: str
    pictures: tuple[str, ...]
    graph: str
    bound: Any = None  # the role's model, with tools

    @property
    def _llm_type(self) -> str:
        return "grs-logged"

    def bind_tools(
        self, tools: Sequence[Any], *, tool_choice: str | None = None, **kwargs: Any
    ) -> Runnable[LanguageModelInput, AIMessage]:
        """A copy whose model knows the tools. Raises ConfigError: the model cannot call tools."""
        agents = cast(Agents, self.agents)
        try:
            bound = agents.chat_model_for_role(self.role).bind_tools(tools, tool_choice=tool_choice, **kwargs)
        except NotImplementedError as error:
            named = agents.config.model_for_role(self.role).model
            what = f"model {named!r} of the role {self.role} cannot call tools, which graph {self.graph!r} needs"
            raise ConfigError(what, f"name another with models.{self.role}, without fallbacks, or graph=grs") from error
        return self.model_copy(update={"bound": bound})

    def _generate(
        self,
        messages: list[BaseMessage],
        stop: list[str] | None = None,
        run_manager: CallbackManagerForLLMRun | None = None,
        **kwargs: Any,
    ) -> ChatResult:
        agents = cast(Agents, self.agents)
        retries = make_retries(agents.config.model_for_role(self.role))
        live: list[AIMessage] = []

        def ask_bound_model() -> Answer:
            message, answer = request_message(self.bound or agents.chat_model_for_role(self.role), messages, retries)
            live.append(message)
            if not message.tool_calls:
                return require_complete_answer(answer)
            return require_complete_answer(replace(answer, text=redact_keys(_format_tool_calls(message))))

        logged = [AIMessage(_format_tool_calls(item)) if isinstance(item, AIMessage) else item for item in messages]
        text, _ = agents.get_earlier_or_new_reply(self.role, logged, self.pictures, ask_bound_model)
        message = AIMessage(_UNUSABLE) if text is None else live[-1] if live else _parse_tool_calls(text, len(messages))
        return ChatResult(generations=[ChatGeneration(message=message)])


def _format_tool_calls(message: AIMessage) -> str:
    """The text of a message with the tools that it calls, if any."""
    if not message.tool_calls:
        return str(message.text)
    calls = [{"name": call["name"], "args": call["args"]} for call in message.tool_calls]
    return f"{message.text}{_MARK}{json.dumps(calls)}"


def _parse_tool_calls(text: str, number: int) -> AIMessage:
    """The message that `_format_tool_calls` wrote as ``text``; the ids of its calls are made of ``number``."""
    words, mark, written = text.rpartition(_MARK)
    if not mark:
        return AIMessage(text)
    try:
        calls: list[dict[str, Any]] = json.loads(written)
        called = [
            CalledTool(name=call["name"], args=call["args"], id=f"call-{number}-{rank}", type="tool_call")
            for rank, call in enumerate(calls)
        ]
    except (ValueError, KeyError, TypeError):
        return AIMessage(text)
    return AIMessage(words, tool_calls=called)


@dataclass
class _CountedTools:
    """The tools of an agent; each call is counted and logged, even if its arguments do not fit."""

    agents: Agents
    role: str
    calling: ToolCalling
    call_count: int = 0
    lock: Lock = field(default_factory=Lock)  # a model may call several at once

    def build_langchain_tool_list(self) -> list[BaseTool]:
        return [self._build_tool(name, function) for name, function in self.calling.tools.items()]

    def _build_tool(self, name: str, function: ToolFunction) -> BaseTool:
        described = StructuredTool.from_function(function, name=name)

        def call(**arguments: Any) -> str | list[Any]:
            begin = time.perf_counter()
            beyond = self._count_call()
            ok, result = beyond <= 0, cast("str | list[Any]", "All tool calls are used up. Hand in your reply now.")
            if ok:
                try:
                    result = function(**arguments)
                except GrsError as error:
                    ok, result = False, str(error)
            text = result if isinstance(result, str) else "(a picture)"
            seconds = time.perf_counter() - begin
            event = ToolCall(role=self.role, tool=name, arguments=arguments, result=text, ok=ok, seconds=seconds)
            self.agents.log.append(event)
            return result

        def report_invalid_arguments(error: ValidationError | FirstValidationError) -> str:
            wrong = "; ".join(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in error.errors())
            result = f"The arguments do not fit: {wrong}"
            self._count_call()
            self.agents.log.append(ToolCall(role=self.role, tool=name, result=result, ok=False))
            return result

        return StructuredTool.from_function(
            call,
            name=name,
            description=described.description,
            args_schema=described.args_schema,
            handle_validation_error=report_invalid_arguments,
        )

    def _count_call(self) -> int:
        """Count a call. Returns: number of calls beyond the allowed number. Raises StepsUsedUp: too many beyond it."""
        with self.lock:
            self.call_count += 1
            beyond = self.call_count - self.calling.steps
        if beyond > self.agents.config.reply_retries + 1:
            what = f"it called tools {self.call_count} times and handed nothing in"
            raise StepsUsedUp(what, f"raise author.steps (now {self.calling.steps})")
        return beyond
