import re

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
        "task.goals_met(env)",
    ):
        assert word in text


def test_the_reference_explains_itself_to_either_reader() -> None:
    for text in (api_reference(), api_reference("tests")):
        named = set(re.findall(r"`utils\.(\w+)\(", text))
        assert {"apply", "invert", "multiply", "eulerXYZ_to_quatXYZW", "quatXYZW_to_eulerXYZ"} <= named
        assert "compose_poses" not in text
