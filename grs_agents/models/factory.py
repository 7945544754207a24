"""Make the chat model that a configuration names: ``offline`` or ``provider:name``."""

import ipaddress
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from operator import attrgetter
from typing import Any, cast
from urllib.parse import urlsplit

from langchain_core.language_models.chat_models import BaseChatModel

from grs_agents.config import ModelConfig
from grs_agents.errors import ConfigError, UnknownNameError
from grs_agents.models.key_redaction import redact_keys, register_key_variable
from grs_agents.models.reply_limits import limit_response_size

OFFLINE = "offline"
PLACEHOLDER_KEY = "not-needed"
"""Stands for the key where a server on this machine needs none."""


@dataclass(frozen=True)
class Provider:
    """How one provider's LangChain client is made; the extra of ``grs-agents`` that installs it has its name."""

    module: str  # the package to import
    model_class: str  # the chat model in it
    # where the model holds its HTTP client, so that the length of replies can be bounded. Only two of the four packages
    # take a client or hooks when a model is made.
    http_client: str
    key_variable: str  # the environment variable that holds the key by default; empty where none is needed
    key_argument: str = "api_key"  # the constructor's name for the key
    length_argument: str = "max_tokens"  # the constructor's name for the longest reply
    # further arguments; the client's own retries are switched off, ours are in `retry`
    defaults: Mapping[str, Any] = field(default_factory=lambda: {"max_retries": 0})


PROVIDERS: Mapping[str, Provider] = {
    "openai": Provider("langchain_openai", "ChatOpenAI", "root_client._client", "OPENAI_API_KEY"),
    "anthropic": Provider(
        "langchain_anthropic",
        "ChatAnthropic",
        "_client._client",
        "ANTHROPIC_API_KEY",
        defaults={"max_retries": 0, "max_tokens": 8192},
    ),
    "google": Provider(
        "langchain_google_genai",
        "ChatGoogleGenerativeAI",
        "client._api_client._httpx_client",
        "GOOGLE_API_KEY",
        "google_api_key",
        "max_output_tokens",
    ),
    "ollama": Provider("langchain_ollama", "ChatOllama", "_client._client", "", "", "num_predict", {}),
}


def make_chat_model(config: ModelConfig, seed: int) -> BaseChatModel:
    """The chat model that ``config`` names; ``seed`` is for the ``offline`` model's choices.

    Raises:
        UnknownNameError: no such provider.
        ConfigError: the provider's package is not installed, or its key is not set.
    """
    if is_offline(config.model):
        from grs_agents.models.offline import make_offline_model

        return make_offline_model(config.model, seed)
    name, colon, model = config.model.partition(":")
    if name not in PROVIDERS:
        raise UnknownNameError("model", config.model, [OFFLINE, *(f"{provider}:NAME" for provider in PROVIDERS)])
    if not colon or not model.strip():
        raise ConfigError(f"model {config.model!r} names no model of {name}", f"write {name}:NAME")
    provider = PROVIDERS[name]
    make = _import_client_class(name, config.model)
    arguments = {
        **provider.defaults,
        "model": model.strip(),
        **_api_key_argument(provider, config),
        **_request_settings(name, config),
    }
    try:
        made = cast(BaseChatModel, make(**arguments))
        limit_response_size(attrgetter(provider.http_client)(made))
    except (ValueError, TypeError, AttributeError) as error:
        first = redact_keys(str(error)).splitlines()[0] if str(error) else type(error).__name__
        raise ConfigError(f"model {config.model!r} cannot be made: {first}", "see `grs doctor`") from error
    return made


def is_provider_installed(provider: str) -> bool:
    """Whether the package that ``provider`` needs can be imported."""
    try:
        import_module(PROVIDERS[provider].module)
    except ImportError:
        return False
    return True


def is_offline(model: str) -> bool:
    """Whether ``model`` is the embedded one, with mistakes or without."""
    return model.partition(":")[0] == OFFLINE


def is_loopback_url(url: str | None) -> bool:
    """Whether ``url`` points at this machine."""
    host = (urlsplit(url).hostname or "") if url else ""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _import_client_class(name: str, model: str) -> Any:
    provider = PROVIDERS[name]
    try:
        return getattr(import_module(provider.module), provider.model_class)
    except ImportError as error:
        what = f"model {model!r} needs the package {provider.module}, which is not installed"
        raise ConfigError(what, f'run: pip install "grs-agents[{name}]"') from error


def _api_key_argument(provider: Provider, config: ModelConfig) -> dict[str, str]:
    variable = config.key_variable or provider.key_variable
    if not variable or not provider.key_argument:
        return {}
    register_key_variable(variable)
    key = os.environ.get(variable, "")
    if not key and is_loopback_url(config.base_url):
        key = PLACEHOLDER_KEY
    if not key:
        raise ConfigError(
            f"model {config.model!r} needs a key, and the environment variable {variable} is not set",
            f"set {variable}, or name another variable with models.<role>.key_variable",
        )
    return {provider.key_argument: key}


def _request_settings(name: str, config: ModelConfig) -> dict[str, Any]:
    bounds: dict[str, Any] = {"timeout": config.timeout}
    if name == "ollama":
        bounds = {"client_kwargs": {"timeout": config.timeout}}
    if config.base_url:
        bounds["base_url"] = config.base_url
    if config.temperature is not None:
        bounds["temperature"] = config.temperature
    if config.max_tokens is not None:
        bounds[PROVIDERS[name].length_argument] = config.max_tokens
    return bounds
