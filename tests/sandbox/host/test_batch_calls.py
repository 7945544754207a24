"""A crash costs one item; all the others are worked through in fresh workers."""

import pytest

from grs_agents.base.config.schema import Limits
from grs_agents.sandbox.host.batch_calls import BatchResult, call_tool_for_each_item
from grs_agents.sandbox.host.sandbox import Sandbox

CODE = """
import os
from grs_agents.sandbox.harness.channel import report_progress
for item in request["items"]:
    report_progress({"item": item, "phase": "start"})
    if item == "crash": os._exit(1)
    while item.startswith("hang"): pass
    report_progress({"item": item, "phase": "end", "pid": os.getpid()})
    if item == "stray": report_progress({"item": "other", "phase": "end"})
    if item == "quit": os._exit(1)
"""


def each(sandbox: Sandbox, *items: str, code: str = CODE, hopeless: bool = False) -> BatchResult:
    limits = Limits(wall_seconds=0.6)
    return call_tool_for_each_item(sandbox, "execute", {"code": code}, items, limits, lambda call: hopeless)


def test_all_items_share_a_worker(sandbox: Sandbox) -> None:
    result = each(sandbox, "a", "b", "c")
    assert list(result.ended) == ["a", "b", "c"]
    assert len({event["pid"] for event in result.ended.values()}) == len(result.calls) == 1


def test_a_crash_costs_one_item(sandbox: Sandbox) -> None:
    result = each(sandbox, "a", "crash", "b")
    assert list(result.ended) == ["a", "b"]
    assert result.stopped["crash"].outcome == "crashed"
    assert len(result.calls) == 2


def test_a_crash_between_items_costs_none(sandbox: Sandbox) -> None:
    result = each(sandbox, "quit", "b")
    assert list(result.ended) == ["quit", "b"]
    assert not result.stopped


@pytest.mark.parametrize(("hopeless", "stopped"), [(False, ["hang1", "hang2"]), (True, ["hang1"])])
def test_time_is_bounded(hopeless: bool, stopped: list[str], sandbox: Sandbox) -> None:
    result = each(sandbox, "hang1", "hang2", "a", hopeless=hopeless)
    assert list(result.stopped) == stopped
    assert not result.ended


def test_death_before_any_item_ends_it(sandbox: Sandbox) -> None:
    result = each(sandbox, "a", "b", code="import os; os._exit(2)")
    assert (len(result.calls), result.ended, result.stopped) == (1, {}, {})
    assert result.last_call.outcome == "crashed"


@pytest.mark.parametrize(
    ("stray", "repeated", "strange", "untimely"),
    [
        ('{"item": "other", "phase": "end"}', set(), ("other",), set()),
        ('{"item": "a", "phase": "never"}', set(), ("a",), set()),
        ('{"no": "item"}', set(), ("None",), set()),
        ('{"item": "a", "phase": "end"}', {"a"}, (), set()),
        ('{"item": "a", "phase": "start"}', {"a"}, (), set()),
        ('{"item": "c", "phase": "end"}', set(), (), {"c"}),
    ],
)
def test_stray_events_are_told_apart(
    stray: str, repeated: set[str], strange: tuple[str, ...], untimely: set[str], sandbox: Sandbox
) -> None:
    code = CODE.replace('report_progress({"item": "other", "phase": "end"})', f"report_progress({stray})")
    result = each(sandbox, "a", "stray", "c", code=code)
    assert list(result.ended) == ["a", "stray", "c"]
    assert (result.repeated, result.strange, result.untimely) == (repeated, strange, untimely)
