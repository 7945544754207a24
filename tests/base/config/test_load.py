"""Layers of configuration: what wins, where each value came from, and what every mistake says."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.base.config.load import EffectiveConfig, load_config
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import ConfigError, UnknownNameError


def load(file: Path | None = None, *settings: str, **environment: str) -> EffectiveConfig:
    """Load with an explicit environment, so that the test machine's own never counts."""
    return load_config(file, settings, environment)


def toml(folder: Path, text: str) -> Path:
    """A configuration file with ``text``."""
    file = folder / "grs.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_without_any_layer_everything_is_a_default() -> None:
    effective = load()
    assert effective.config == Config()
    assert set(effective.sources.values()) == {"default"}
    assert effective.sources["audit.seeds"] == "default"


def test_set_beats_file_beats_environment_beats_default(tmp_path: Path) -> None:
    file = toml(tmp_path, "seed = 2\nmax_fixes = 2\n")
    effective = load(file, "seed=3", GRS_SEED="1", GRS_MAX_FIXES="1", GRS_REPLY_RETRIES="1")
    assert (effective.config.seed, effective.config.max_fixes, effective.config.reply_retries) == (3, 2, 1)
    assert effective.sources["seed"] == "--set"
    assert effective.sources["max_fixes"] == f"file {file}"
    assert effective.sources["reply_retries"] == "environment GRS_REPLY_RETRIES"


def test_a_later_set_beats_an_earlier_one() -> None:
    assert load(None, "seed=1", "seed=2").config.seed == 2


def test_environment_variables_nest_with_two_underscores() -> None:
    assert load(None, GRS_LIMITS__WALL_SECONDS="7.5").config.limits.wall_seconds == 7.5


def test_variables_without_the_prefix_are_nothing_to_us() -> None:
    assert load(None, SEED="9", GRS_="9").config == Config()


@pytest.mark.parametrize("setting", ["policy=rules", 'policy="rules"', " policy = rules "])
def test_a_bare_word_is_a_string(setting: str) -> None:
    assert load(None, setting).config.policy == "rules"


def test_a_model_is_one_string() -> None:
    config = load(None, "models.default=openai:gpt-5").config
    assert config.model_for_role("simulation").model == "openai:gpt-5"


def test_model_keys_beside_the_roles_are_the_default_models() -> None:
    config = load(None, "models.default=openai:any", "models.base_url=http://127.0.0.1:1/v1").config
    assert config.model_for_role("route").base_url == "http://127.0.0.1:1/v1"


def test_a_role_of_its_own_has_its_own_model() -> None:
    config = load(None, "models.router=ollama:llama").config
    assert config.model_for_role("route").model == "ollama:llama"
    assert config.model_for_role("tests").model == "offline"


def test_another_model_does_not_inherit_the_endpoint_of_the_old_one(tmp_path: Path) -> None:
    file = toml(tmp_path, '[models.default]\nmodel = "openai:a"\nbase_url = "http://a"\nkey_variable = "A_KEY"\n')
    model = load(file, "models.default=anthropic:b").config.model_for_role("default")
    assert (model.model, model.base_url, model.key_variable) == ("anthropic:b", None, None)


def test_the_endpoint_may_come_before_the_model() -> None:
    config = load(None, "models.base_url=http://127.0.0.1:1/v1", "models.default=openai:any").config
    assert config.model_for_role("default").base_url == "http://127.0.0.1:1/v1"


def test_an_environment_may_name_model_and_endpoint() -> None:
    environment = {"GRS_MODELS__BASE_URL": "http://127.0.0.1:1/v1", "GRS_MODELS__DEFAULT": "openai:any"}
    model = load(None, **environment).config.model_for_role("default")
    assert (model.model, model.base_url) == ("openai:any", "http://127.0.0.1:1/v1")


def test_an_unknown_key_lists_the_valid_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"max_fixs.*use one of: max_fixes"):
        load(None, "max_fixs=3")


def test_an_unknown_nested_key_names_the_whole_path() -> None:
    with pytest.raises(UnknownNameError, match=r"limits\.wall_second'.*limits\.wall_seconds"):
        load(None, "limits.wall_second=3")


def test_an_unknown_role_lists_the_roles() -> None:
    with pytest.raises(UnknownNameError, match=r"model role 'fix_cod'.*fix_code"):
        load(None, "models.fix_cod=offline")


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("max_fixes=-1", "max_fixes = -1"),
        ("seed=many", "seed = 'many'"),
        ("audit.reward=1.5", "audit.reward = 1.5"),
        ("limits.memory_mib=8", "limits.memory_mib = 8"),
        ("limits.wall_seconds=nan", "limits.wall_seconds = nan"),
        ("limits=3", "limits = 3"),
    ],
)
def test_a_value_out_of_bounds_is_named(setting: str, named: str) -> None:
    with pytest.raises(ConfigError) as raised:
        load(None, setting)
    assert named in str(raised.value)
    assert "\n" not in str(raised.value)
    assert raised.value.exit_status == 2


@pytest.mark.parametrize("setting", ["models=offline", "models.default=3", "models.default=true", "models.route=[1]"])
def test_a_model_of_the_wrong_type_is_a_config_error(setting: str) -> None:
    with pytest.raises(ConfigError, match="models"):
        load(None, setting)


@pytest.mark.parametrize("setting", ["seed", "=3", "limits.=3", ".=3", ""])
def test_a_malformed_setting_shows_the_form(setting: str) -> None:
    with pytest.raises(ConfigError, match=r"key\.sub=value"):
        load(None, setting)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml.*--config"):
        load(tmp_path / "none.toml")


@pytest.mark.parametrize("content", [b"seed = = 3\n", b"\xff\xfe seed"])
def test_a_file_that_is_not_toml_is_named(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "bad.toml"
    file.write_bytes(content)
    with pytest.raises(ConfigError, match=r"bad\.toml is not (TOML|UTF-8)"):
        load(file)


@given(st.lists(st.text(max_size=30), max_size=3))
def test_no_setting_ends_in_anything_but_a_config_or_a_config_error(settings: list[str]) -> None:
    try:
        effective = load(None, *settings)
    except ConfigError as error:
        assert "\n" not in str(error)
    else:
        assert isinstance(effective.config, Config)


@given(st.integers(0, 2**31 - 1), st.floats(0.01, 1), st.integers(1, 100))
def test_a_configuration_survives_its_own_toml(seed: int, reward: float, seeds: int) -> None:
    config = load(None, f"seed={seed}", f"audit.reward={reward}", f"audit.seeds={seeds}").config
    assert Config.model_validate_json(config.model_dump_json()) == config
    assert (config.seed, config.audit.reward, config.audit.seeds) == (seed, reward, seeds)
