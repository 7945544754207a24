"""What a run may spend, over all its attempts."""

from pathlib import Path

import pytest

from grs_agents.agents import roles
from grs_agents.agents.agent import Agents
from grs_agents.agents.budget import BudgetReached
from grs_agents.agents.roles import JudgedPrograms
from grs_agents.agents.types import NoReply, TaskDefinition
from grs_agents.base.config.load import validate_config
from grs_agents.base.config.schema import BudgetConfig, Config, ModelConfig, Price
from grs_agents.base.trace.events import Note, Reply, RunStarted
from grs_agents.base.trace.log import EventLog, read_events
from tests.scripted import say, scripted

TASK = TaskDefinition.model_validate({"task-name": "t", "task-description": "d", "assets-used": ["a"]})
JUDGED = JudgedPrograms(TASK, "{}", "", "", "failed: 0 of 1 tests passed", [])
REPLY = Reply(call="a", role="task", model="openai:any", text="", input_tokens=9_000, output_tokens=1_000, cost=0.5)


@pytest.mark.parametrize(
    ("budget", "reason"),
    [
        ({"tokens": 20_000}, "budget: 20,000 of 20,000 tokens used"),
        ({"cost": 0.9, "tokens": 50_000}, "budget: 1.00 of 0.90 US dollars used"),
        ({"minutes": 3}, "budget: 4.0 of 3 minutes used"),
        ({"tokens": 20_001, "cost": 1.01, "minutes": 4.5}, ""),
        ({}, ""),
    ],
)
def test_earlier_attempts_count_and_the_time_between_them_does_not(
    tmp_path: Path, budget: dict[str, float], reason: str
) -> None:
    start = RunStarted(run_id="r", graph="grs", seed=0)
    events = [(start, 0), (REPLY, 60), (start, 9_000), (REPLY, 9_180)]  # seconds: two attempts of 1 and 3 minutes
    lines = [
        event.model_copy(update={"sequence": number, "time": float(time)}).model_dump_json() + "\n"
        for number, (event, time) in enumerate(events)
    ]
    (tmp_path / "events.jsonl").write_text("".join(lines))
    config = Config(budget=BudgetConfig.model_validate(budget))
    log = EventLog(tmp_path / "events.jsonl")
    log.append(start)
    agents = Agents.resume_from_log(config, log, tmp_path)
    if reason:
        with pytest.raises(BudgetReached, match=reason):
            roles.decide_what_to_fix(agents, JUDGED, ("fix_code", "fix_test"))
    else:
        assert not isinstance(roles.decide_what_to_fix(agents, JUDGED, ("fix_code", "fix_test")), NoReply)


def test_a_budget_ends_before_the_call_that_would_pass_it(tmp_path: Path) -> None:
    config = Config(budget=BudgetConfig(tokens=30, cost=1), models={"default": ModelConfig(model="openai:any")})
    agents = scripted(tmp_path, ["no", "no", "no"], config)
    with pytest.raises(BudgetReached, match="32 of 30 tokens"):
        roles.decide_what_to_fix(agents, JUDGED, ("fix_code", "fix_test"))
    assert len(agents.script.asked) == 2
    notes = [event.text for event in read_events(agents.log.path) if isinstance(event, Note)]
    assert len(notes) == 2 and all("budget.cost" in note for note in notes)


@pytest.mark.parametrize(
    ("prices", "cost"),
    [
        ({"openai:any": {"input": 3, "output": 15}}, (11 * 3 + 5 * 15) / 1e6),
        ({"openai:*": {"input": 1, "output": 1}, "openai:an*": {"input": 3, "output": 15}}, (11 * 3 + 5 * 15) / 1e6),
        ({"openai:any": {"input": 3, "output": 15, "cached": 0.5}}, (7 * 3 + 4 * 0.5 + 5 * 15) / 1e6),
        ({"openai:?": {"input": 3, "output": 15}}, None),
    ],
    ids=["name", "longest pattern", "cached", "no match"],
)
def test_a_reply_without_a_cost_is_priced_by_its_tokens(
    tmp_path: Path, prices: dict[str, dict[str, float]], cost: float | None
) -> None:
    config = validate_config(
        {**Config().model_dump(), "models": {"default": {"model": "openai:any"}}, "prices": prices, "reply_retries": 0}
    )
    said = say("no")
    assert said.usage_metadata is not None
    said.usage_metadata["input_token_details"] = {"cache_read": 4}
    agents = scripted(tmp_path, [said], config)
    roles.decide_what_to_fix(agents, JUDGED, ("fix_code", "fix_test"))
    [reply] = [event for event in read_events(agents.log.path) if isinstance(event, Reply)]
    assert reply.cost == (None if cost is None else pytest.approx(cost))
    assert reply.cost_source == ("unknown" if cost is None else "prices")


def test_the_providers_cost_prevails_and_prices_bind_the_budget(tmp_path: Path) -> None:
    config = Config(
        budget=BudgetConfig(cost=0.9),
        models={"default": ModelConfig(model="openai:any")},
        prices={"openai:any": Price(input=0, output=1e5)},  # 0.5 dollars for each reply of 5 tokens
    )
    dear = say("no")
    dear.response_metadata["token_usage"] = {"cost": 0.25}
    agents = scripted(tmp_path, [dear, "no", "no", "no"], config.model_copy(update={"reply_retries": 9}))
    with pytest.raises(BudgetReached, match=r"1\.25 of 0\.90 US dollars"):
        roles.decide_what_to_fix(agents, JUDGED, ("fix_code", "fix_test"))
    replies = [event for event in read_events(agents.log.path) if isinstance(event, Reply)]
    assert [(reply.cost, reply.cost_source) for reply in replies] == [
        (0.25, "provider"),
        (0.5, "prices"),
        (0.5, "prices"),
    ]
