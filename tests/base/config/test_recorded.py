"""A run folder brings along the settings of an allow-list; everything else is that of the machine that resumes it."""

from typing import Any

import pytest

from grs_agents.base.config.load import EffectiveConfig, flatten_tree, load_config
from grs_agents.base.config.recorded import RecordedConfig, list_local_settings, portable_settings
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import ConfigError

LOCAL = load_config(None, (), {})
CHANGED: dict[str, Any] = {
    "sandbox": "none",
    "record": "/home/somebody/.bashrc",
    "cassette": "/tmp/cassette.json",
    "models.default.model": "openai:large",
    "models.default.base_url": "http://stranger.example/v1",
    "models.default.key_variable": "AWS_SECRET_ACCESS_KEY",
    "models.default.arguments": {"custom_class": "os:system"},
    "models.default.fallbacks": [{"model": "package.module:Class"}],
    "audit.judge": "package.module:Class",
    "audit.words": "agree",
    "policy": "package.module:Policy",
    "robot": "/home/somebody/arm.xml",
    "hand": "franka_hand",
    "graph": "../graphs/mine",
    "tools.segment": "package.module",
    "prompts.task": "../secret",
    "segment.device": "cuda:0",
    "scene.table": "largest",
    "scene.group": "off",
    "camera.intrinsics": "realsense-d435",
    "camera.rectified": True,
    "match.describe": "each",
    "segment.prompts": ["a mug"],
}
"""Values that differ from the default where adding to a number or turning a truth value does not make them."""


def changed_value(key: str, default: Any) -> Any:
    """A value of ``key`` that is valid and not the default."""
    if key in CHANGED:
        return CHANGED[key]
    if isinstance(default, bool):
        return not default
    if isinstance(default, int):
        return default + 1
    return 0.5 * default if isinstance(default, float) else 40 if default is None else f"{default}x"


LEAVES = flatten_tree(Config().model_dump(mode="json"))
KEYS = sorted({*LEAVES, "models.default.arguments"})


def recorded(key: str, value: Any) -> RecordedConfig:
    """A record that is the default's but for one key."""
    tree = Config().model_dump(mode="json")
    *path, last = key.split(".")
    at = tree
    for name in path:
        at = at[name]
    at[last] = value
    return RecordedConfig(tree)


@pytest.mark.parametrize("key", KEYS)
def test_no_setting_outside_the_allow_list_comes_from_a_record(key: str) -> None:
    value = changed_value(key, LEAVES.get(key))
    before = flatten_tree(LOCAL.config.model_dump(mode="json"))
    try:
        after = flatten_tree(recorded(key, value).resume_on(LOCAL).model_dump(mode="json"))
    except ConfigError as error:
        assert f"{key}" in error.message and "a run folder cannot choose" in error.message
        return
    changed = {name for name in after if after[name] != before[name]}
    assert changed <= set(portable_settings())
    if key not in ("sandbox", "workers"):
        assert changed == {key}, "a setting of the record was lost without a question"


def test_every_setting_is_on_one_side_on_purpose() -> None:
    # A new setting is local until it is marked; these are the ones that a stranger may choose.
    sides = {key.partition(".")[0] for key in portable_settings()}
    assert sides == {
        *("graph", "policy", "seed", "robot", "hand", "max_fixes", "end_picture", "reply_retries", "tools", "scene"),
        *("segment", "depth", "camera", "match", "background", "prompts", "audit", "author"),
    }
    assert not {"sandbox", "workers", "record", "cassette", "limits", "models", "budget"} & sides


@pytest.mark.parametrize("key", ["policy", "robot", "graph", "tools.segment", "prompts.task", "audit.judge"])
def test_a_path_or_code_in_a_portable_setting_is_asked_for_again(key: str) -> None:
    with pytest.raises(ConfigError, match="a run folder cannot choose"):
        recorded(key, CHANGED[key]).resume_on(LOCAL)


def test_a_setting_that_the_user_states_again_holds() -> None:
    record = recorded("limits.wall_seconds", 90.0)
    stated = load_config(None, ["limits.wall_seconds=30"], {})
    assert record.resume_on(stated).limits.wall_seconds == 30


def test_anchanged_value_of_a_portable_setting_is_refused() -> None:
    record = recorded("seed", 7)
    assert record.resume_on(load_config(None, ["seed=7"], {})).seed == 7
    assert record.resume_on(load_config(None, (), {"GRS_SEED": "3"})).seed == 7, "the environment is no statement"
    with pytest.raises(ConfigError, match="keeps its seed = 7, not 3"):
        record.resume_on(load_config(None, ["seed=3"], {}))


def test_an_offline_model_is_taken_over_and_a_stated_model_is_taken_whole() -> None:
    faulty = RecordedConfig({"models": {"default": {"model": "offline:faulty"}, "judge": {"model": "offline"}}})
    assert {role: spec.model for role, spec in faulty.resume_on(LOCAL).models.items()} == {
        "default": "offline:faulty",
        "judge": "offline",
    }
    foreign = recorded("models.default.base_url", "http://stranger.example/v1")
    stated = load_config(None, ["models.default=openai:mine"], {})
    spec = foreign.resume_on(stated).models["default"]
    assert (spec.model, spec.base_url) == ("openai:mine", None)


def test_a_machine_that_isolates_nothing_by_order_of_its_user_is_asked_by_its_user_alone() -> None:
    unsafe = load_config(None, (), {}, unsafe=True)
    assert RecordedConfig.of(unsafe.config).resume_on(LOCAL).sandbox == "auto"
    assert RecordedConfig.of(Config()).resume_on(unsafe).sandbox == "none"


@pytest.mark.parametrize("tree", [{}, {"models": 3}, {"audit": "x"}, {"new_key": {"a": 1}}])
def test_a_record_of_another_shape_changes_nothing(tree: dict[str, Any]) -> None:
    assert RecordedConfig(tree).resume_on(EffectiveConfig(Config())) == Config()


@pytest.mark.parametrize(("key", "value"), [("seed", -1), ("seed", "seven"), ("scene.coverage.warn", 9)])
def test_a_value_out_of_bounds_is_named(key: str, value: Any) -> None:
    with pytest.raises(ConfigError, match=key.replace(".", r"\.")):
        recorded(key, value).resume_on(LOCAL)


@pytest.mark.parametrize(
    "settings",
    [
        ["policy=my.module:Policy", "robot=arms/mine.xml", "audit.judge=openai:judge"],
        ['models.default=["openai:a", "anthropic:b"]'],
        [
            'models.default={model = "openai:a", arguments = {"a.b" = "\U0001f600\\t\x7f", top_k = 3}}',
            "models.route=offline",
        ],
        ['prices={"openai:a.1" = {input = 2, output = 8}, "ollama:*" = {input = 0, output = 0, cached = 0}}'],
        ["limits.wall_seconds=90", "record=a b.json", "seed=7", "scene.table=highest"],
        [],
    ],
    ids=str,
)
def test_a_run_is_resumed_by_the_settings_that_are_printed(settings: list[str]) -> None:
    begun = load_config(None, settings, {})
    again = load_config(None, list_local_settings(begun), {})
    assert RecordedConfig.of(begun.config).resume_on(again) == begun.config


def test_a_role_is_asked_for_by_its_model_alone() -> None:
    record = RecordedConfig.of(load_config(None, ["models.route=openai:x"], {}).config)
    with pytest.raises(ConfigError, match=r"made with models\.route\.model = 'openai:x', which"):
        record.resume_on(LOCAL)
