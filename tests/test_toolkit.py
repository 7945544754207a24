"""Tools are found by name, and any agent framework can call those that speak JSON."""

from pathlib import Path

import pytest

import grs_agents
from grs_agents.base import content
from grs_agents.base.config.schema import Limits
from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.library.library import Library
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.toolkit import ToolContext, build_langchain_tools, json_tool_names, load_tool, open_library

ADD = '''"""Add two numbers.

More words.
"""
from grs_agents.base import Frozen
class Request(Frozen):
    first: int
    second: int = 1
class Result(Frozen):
    total: int
def run(request, context):
    return Result(total=request.first + request.second)
'''
ARRAYS = '"""Takes arrays."""\nclass Request: pass\nclass Result: pass\ndef run(request, context): return Result()\n'


@pytest.fixture
def context(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ToolContext:
    for name, source in {"add": ADD, "arrays": ARRAYS, "half": "x = 1\n"}.items():
        (tmp_path / "tools").mkdir(exist_ok=True)
        (tmp_path / "tools" / f"{name}.py").write_text(source)
    monkeypatch.setattr(content, "_overlays", [tmp_path])
    return ToolContext(sandbox=Sandbox(), library=Library(), limits=Limits())


def test_a_tool_becomes_a_structured_tool(context: ToolContext) -> None:
    (add,) = grs_agents.build_langchain_tools(context, ["add"])
    assert (add.name, add.description) == ("add", "Add two numbers.")
    assert set(add.args) == {"first", "second"}
    assert add.invoke({"first": 2}) == {"total": 3}


def test_a_tool_that_takes_arrays_is_refused_by_name(context: ToolContext) -> None:
    with pytest.raises(InputError, match="arrays"):
        build_langchain_tools(context, ["arrays"])


def test_an_unknown_tool_lists_those_there_are(context: ToolContext) -> None:
    with pytest.raises(UnknownNameError, match="add"):
        build_langchain_tools(context, ["ad"])


def test_a_tool_that_lacks_parts_is_named(context: ToolContext) -> None:
    del context
    with pytest.raises(InputError, match=r"half.*Request, Result, run"):
        load_tool("half")


def test_the_shipped_tools_that_speak_json_are_all_offered() -> None:
    names = json_tool_names()
    assert {"instantiate", "run_tests"} <= set(names)
    offered = build_langchain_tools(ToolContext(sandbox=Sandbox(), library=Library(), limits=Limits()))
    assert [tool.name for tool in offered] == names
    assert all(tool.description for tool in offered)


def test_no_roots_mean_the_shipped_library() -> None:
    assert open_library([]).roots == Library().roots


def test_an_unknown_attribute_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nothing"):
        _ = grs_agents.nothing


def test_every_argument_of_a_shipped_tool_is_described() -> None:
    schemas = {name: load_tool(name).Request.model_json_schema() for name in json_tool_names()}
    silent = [
        f"{name}.{key}"
        for name, schema in schemas.items()
        for key, value in schema["properties"].items()
        if not value.get("description", "").strip()
    ]
    assert schemas and silent == []
