import re

import pytest

from grs_agents.sim import api_reference


def test_the_reference_is_short_and_names_what_programs_need() -> None:
    text = api_reference()
    assert len(text.splitlines()) <= 212
    for word in (
        "add_goal",
        "get_random_pose",
        "fill_template",
        "add_object",
        "metric='zone'",
        "symmetries",
        "0.85",
        "stacked(objs)",
        "env.find(asset)",
        "make_piles",
        "make_ropes",
    ):
        assert word in text


def test_the_reference_names_the_hand_and_the_reach_of_the_arm() -> None:
    fingers = api_reference("program", None, "panda", "franka_hand")
    assert "picks from above with two fingers between" in fingers and "picks from above with suction" not in fingers
    assert "suction between 0.22 m and 0.85 m" in api_reference()
    assert "0.85 m from its base" not in fingers


def test_the_reference_explains_itself_to_either_reader() -> None:
    for text in (api_reference(), api_reference("tests")):
        named = set(re.findall(r"`utils\.(\w+)\(", text))
        assert {"apply", "invert", "multiply", "eulerXYZ_to_quatXYZW", "quatXYZW_to_eulerXYZ"} <= named
        assert "compose_poses" not in text


def test_each_reader_gets_what_it_needs() -> None:
    tests = api_reference("tests")
    for word in ("task.goals_met(env)", "env.step(", "env.reset(", "agent.act(obs, info)"):
        assert word in tests and word not in api_reference()


@pytest.mark.parametrize(
    ("about", "names"),
    [
        ("Stack the cans on the open box.", set[str]()),
        ("Lay the rope along the line.", {"make_ropes"}),
        ("Sweep the heap of blocks into the zone.", {"make_piles"}),
        ("class A(Task): ... self.make_ropes(env, corners) ... self.make_piles(env)", {"make_piles", "make_ropes"}),
    ],
)
def test_piles_and_ropes_are_for_tasks_that_mention_them(about: str, names: set[str]) -> None:
    text = api_reference("program", about)
    assert {name for name in ("make_piles", "make_ropes") if f"task.{name}(" in text} == names
    assert "task.add_goal(" in text
