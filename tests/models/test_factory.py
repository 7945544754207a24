"""Models by name: unknown providers, missing keys and packages, loopback servers without a key."""

import sys
from importlib import import_module

import pytest
from langchain_core.messages import HumanMessage
from langchain_core.rate_limiters import InMemoryRateLimiter

from grs_agents.base.config.schema import ModelConfig
from grs_agents.base.errors import ConfigError, UnknownNameError
from grs_agents.models.call import Retries, invoke_with_retries
from grs_agents.models.factory import PROVIDERS, is_loopback_url, make_chat_model
from grs_agents.models.offline.chat import OfflineChatModel
from tests.models.conftest import Scripted
from tests.needs import needs


def test_offline_carries_the_seed() -> None:
    model = make_chat_model(ModelConfig(model="offline"), seed=7)
    assert isinstance(model, OfflineChatModel)
    assert model.seed == 7


@pytest.mark.parametrize("name", ["gpt", "openapi:any", ":x", "offline:x"])
def test_unknown_providers_are_named_with_the_valid_ones(name: str) -> None:
    with pytest.raises(UnknownNameError, match=name) as caught:
        make_chat_model(ModelConfig(model=name), seed=0)
    assert {"offline", "openai:NAME", "ollama:NAME"} <= set(caught.value.valid) or name == "offline:x"


def test_a_provider_that_is_nearly_named_is_suggested() -> None:
    with pytest.raises(UnknownNameError, match="use one of: groq:NAME"):
        make_chat_model(ModelConfig(model="grok:x"), seed=0)


def test_a_provider_without_a_model_name() -> None:
    with pytest.raises(ConfigError, match="openai:NAME"):
        make_chat_model(ModelConfig(model="openai:"), seed=0)


def test_a_missing_key_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    with pytest.raises(ConfigError, match="OPENAI_API_KEY"):
        make_chat_model(ModelConfig(model="openai:any"), seed=0)
    with pytest.raises(ConfigError, match="MY_KEY"):
        make_chat_model(ModelConfig(model="openai:any", key_variable="MY_KEY"), seed=0)


@pytest.mark.parametrize("provider", PROVIDERS)
def test_a_missing_package_is_named_with_what_installs_it(provider: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, PROVIDERS[provider].module, None)
    package = PROVIDERS[provider].module.partition(".")[0]
    with pytest.raises(ConfigError, match=package) as caught:
        make_chat_model(ModelConfig(model=f"{provider}:any"), seed=0)
    assert caught.value.remedy.startswith("run: pip install ")
    assert package.replace("_", "-") in caught.value.remedy or "grs-agents[" in caught.value.remedy


def test_every_provider_that_langchain_knows_is_known() -> None:
    langchain = import_module("langchain.chat_models.base")
    known = {(provider.module, provider.model_class) for provider in PROVIDERS.values()}
    for name, (module, model_class, _) in langchain._BUILTIN_PROVIDERS.items():
        assert name in PROVIDERS
        assert (module, model_class) in known or name == "bedrock"  # here that is the newer of its two interfaces


@needs("langchain_cohere")
def test_a_setting_that_a_client_lacks_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COHERE_API_KEY", "any")
    with pytest.raises(ConfigError, match="max_tokens is not passed on"):
        make_chat_model(ModelConfig(model="cohere:any", max_tokens=9), seed=0)


def test_the_key_comes_from_the_named_variable(server: tuple[Scripted, str], monkeypatch: pytest.MonkeyPatch) -> None:
    script, url = server
    script.complete()
    monkeypatch.setenv("MY_KEY", "secret-of-mine")
    config = ModelConfig(model="openai:any", base_url=url, key_variable="MY_KEY", temperature=0.5, max_tokens=99)
    invoke_with_retries(make_chat_model(config, seed=0), [HumanMessage("hi")])
    key, body = script.requests[0]
    assert key == "Bearer secret-of-mine"
    assert body["temperature"] == 0.5
    assert 99 in (body.get("max_tokens"), body.get("max_completion_tokens"))


def test_a_server_on_this_machine_needs_no_key(server: tuple[Scripted, str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    script, url = server
    script.complete()
    assert invoke_with_retries(
        make_chat_model(ModelConfig(model="openai:any", base_url=url), seed=0), [HumanMessage("hi")]
    ).text


def test_a_rate_limiter_is_asked_before_each_request(
    server: tuple[Scripted, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    script, url = server
    script.say(500, {"error": {"message": "later"}})
    script.complete()
    before: list[int] = []

    def acquire(limiter: InMemoryRateLimiter, *, blocking: bool = True) -> bool:
        assert (limiter.requests_per_second, limiter.max_bucket_size, blocking) == (0.5, 3, True)
        before.append(len(script.requests))
        return True

    monkeypatch.setattr(InMemoryRateLimiter, "acquire", acquire)
    config = ModelConfig(model="openai:any", base_url=url, requests_per_second=0.5, burst=3)
    invoke_with_retries(make_chat_model(config, seed=0), [HumanMessage("hi")], Retries(sleep=lambda _: None))
    assert before == [0, 1]


def test_loopback_addresses() -> None:
    assert is_loopback_url("http://localhost:8000/v1")
    assert is_loopback_url("http://127.0.0.1:1")
    assert is_loopback_url("http://[::1]:1")
    assert not is_loopback_url("http://localhost.example.org")
    assert not is_loopback_url("https://10.0.0.1")
    assert not is_loopback_url(None)
