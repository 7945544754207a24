"""The configuration's types: frozen, and bounded as documented."""

import pytest
from pydantic import ValidationError

from grs_agents.base.config.load import load_config
from grs_agents.base.config.schema import ROLE_ALIASES, ROLES, Config, ModelConfig, PromptsConfig
from grs_agents.base.errors import ConfigError


def test_a_configuration_cannot_be_changed() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        Config().__setattr__("seed", 1)


def test_every_role_is_served_out_of_the_box() -> None:
    assert {Config().model_for_role(role).model for role in ROLES} == {"offline"}


def test_every_role_but_the_default_has_a_prompt() -> None:
    assert set(PromptsConfig.model_fields) == set(ROLES) - {
        "default",
        "rival",
    }  # the rival reads the prompt of simulation


def test_aliases_lead_to_roles_and_hide_none() -> None:
    assert set(ROLE_ALIASES.values()) <= set(ROLES)
    assert not set(ROLE_ALIASES) & set(ROLES)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("key_variable", "sk-secret"),
        ("key_variable", "1KEY"),
        ("base_url", "https://me:secret@example.org/v1"),
        ("base_url", "me:secret@example.org"),
    ],
)
def test_what_may_be_a_secret_is_refused_and_not_repeated(key: str, value: str) -> None:
    with pytest.raises(ConfigError, match=key) as caught:
        load_config(None, ["models.default=openai:any", f"models.{key}={value}"], {})
    assert value not in str(caught.value) and "secret" not in str(caught.value)


def test_a_key_itself_has_no_place() -> None:
    with pytest.raises(ValidationError, match="Extra inputs"):
        ModelConfig.model_validate({"model": "openai:any", "api_key": "secret"})
