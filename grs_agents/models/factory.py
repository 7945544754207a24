"""Make the chat model that a configuration names: ``offline``, ``provider:name`` or a class of the user's own."""

import ipaddress
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from math import ceil
from operator import attrgetter
from typing import TYPE_CHECKING, Any, cast
from urllib.parse import urlsplit

from grs_agents import content
from grs_agents.config import ModelChoice, ModelConfig
from grs_agents.errors import ConfigError
from grs_agents.models.key_redaction import redact_keys, register_key_variable
from grs_agents.models.reply_limits import limit_and_record_http_client
from grs_agents.models.retry import Retries
from grs_agents.plugins import broken_class_error, load_named_class

if TYPE_CHECKING:
    from langchain_core.language_models.chat_models import BaseChatModel

OFFLINE = "offline"
ENTRY_POINTS = "grs_agents.models"
"""The group of entry points for models of other packages."""
PLACEHOLDER_KEY = "not-needed"
"""Stands for the key where a server on this machine needs none."""


@dataclass(frozen=True)
class Provider:
    """How one provider's LangChain client is made."""

    module: str  # the package to import
    model_class: str  # the chat model in it
    # where the model holds its HTTP client, so that it can be watched. Only two of the packages take a client or hooks
    # when a model is made.
    http_client: str
    key_variable: str  # the environment variable that holds the key by default; empty where none is needed
    extra: str  # of `grs-agents`, which installs the package
    # the constructor's names for the key (empty where the client finds it by itself), the model, the endpoint, and the
    # longest reply
    key_argument: str = "api_key"
    model_argument: str = "model"
    url_argument: str = "base_url"
    length_argument: str = "max_tokens"
    # further arguments; the client's own retries are switched off, ours are in `retry`
    defaults: Mapping[str, Any] = field(default_factory=lambda: {"max_retries": 0})
    by_line: bool = False  # whether each line of a reply is a JSON document of its own
    variables: tuple[str, ...] = ()  # further environment variables that its client reads


PROVIDERS: Mapping[str, Provider] = {
    "openai": Provider(
        "langchain_openai",
        "ChatOpenAI",
        "root_client._client",
        "OPENAI_API_KEY",
        "openai",
        variables=("OPENAI_BASE_URL", "OPENAI_API_BASE", "OPENAI_ORG_ID", "OPENAI_PROJECT_ID", "OPENAI_PROXY"),
    ),
    "azure": Provider(
        "langchain_openai",
        "AzureChatOpenAI",
        "root_client._client",
        "AZURE_OPENAI_API_KEY",
        "openai",
        model_argument="azure_deployment",
        url_argument="azure_endpoint",
        variables=("AZURE_OPENAI_ENDPOINT", "OPENAI_API_VERSION", "OPENAI_ORG_ID", "OPENAI_PROXY"),
    ),
    "anthropic": Provider(
        "langchain_anthropic",
        "ChatAnthropic",
        "_client._client",
        "ANTHROPIC_API_KEY",
        "anthropic",
        defaults={"max_retries": 0, "max_tokens": 8192},
        variables=("ANTHROPIC_BASE_URL", "ANTHROPIC_API_URL", "ANTHROPIC_PROXY"),
    ),
    "bedrock": Provider(
        "langchain_aws",
        "ChatBedrockConverse",
        "client",
        "AWS_SECRET_ACCESS_KEY",
        "bedrock",
        "",
        variables=(
            *("AWS_ACCESS_KEY_ID", "AWS_SESSION_TOKEN", "AWS_BEARER_TOKEN_BEDROCK", "AWS_REGION", "AWS_DEFAULT_REGION"),
            *("AWS_PROFILE", "AWS_ENDPOINT_URL", "AWS_ENDPOINT_URL_BEDROCK_RUNTIME", "AWS_CA_BUNDLE"),
        ),
    ),
    "google": Provider(
        "langchain_google_genai",
        "ChatGoogleGenerativeAI",
        "client._api_client._httpx_client",
        "GOOGLE_API_KEY",
        "google",
        "google_api_key",
        length_argument="max_output_tokens",
        variables=("GEMINI_API_KEY", "GOOGLE_GENAI_USE_VERTEXAI", "GOOGLE_CLOUD_PROJECT", "GOOGLE_CLOUD_LOCATION"),
    ),
    "ollama": Provider(
        "langchain_ollama",
        "ChatOllama",
        "_client._client",
        "",
        "ollama",
        "",
        length_argument="num_predict",
        defaults={},
        by_line=True,
        variables=("OLLAMA_HOST", "OLLAMA_API_KEY"),
    ),
}


def make_chat_model(config: ModelConfig, seed: int) -> "BaseChatModel":
    """The chat model that ``config`` names, with its fallbacks; ``seed`` is for the ``offline`` model's choices.

    Raises:
        UnknownNameError: no such provider, entry point or module.
        ConfigError: the provider's package is not installed, its key is not set, or a class of the user's own cannot
            be imported or made.
    """
    choices = (config, *config.fallbacks)
    models = tuple(_make_single_model(choice, seed) for choice in choices)
    if len(models) == 1:
        return models[0]
    from grs_agents.models.fallbacks import FallbackChatModel

    names = tuple(choice.model for choice in choices)
    return FallbackChatModel(names=names, models=models, retries=tuple(make_retries(choice) for choice in choices))


def make_retries(choice: ModelChoice) -> Retries:
    """How long to keep trying: the offline model, which asks nobody, and fallbacks together have no deadline."""
    endless = is_offline(choice.model) or (isinstance(choice, ModelConfig) and choice.fallbacks)
    return Retries(deadline=None if endless else choice.timeout)


def _make_single_model(choice: ModelChoice, seed: int) -> "BaseChatModel":
    if is_offline(choice.model):
        from grs_agents.models.offline import make_offline_model

        return make_offline_model(choice.model, seed)
    name, colon, model = choice.model.partition(":")
    if name not in PROVIDERS:
        return _make_user_defined_model(choice)
    if not colon or not model.strip():
        raise ConfigError(f"model {choice.model!r} names no model of {name}", f"write {name}:NAME")
    provider = PROVIDERS[name]
    make = _import_client_class(provider, choice.model)
    ours = {
        **provider.defaults,
        provider.model_argument: model.strip(),
        **_api_key_argument(provider, choice),
        **_build_client_arguments(name, choice),
    }
    if taken := sorted(choice.arguments.keys() & ours.keys()):
        raise ConfigError(f"models.<role>.arguments holds {taken[0]}, which GRS sets itself", "leave it out")
    try:
        made = cast("BaseChatModel", make(**ours, **choice.arguments))
        limit_and_record_http_client(attrgetter(provider.http_client)(made), provider.by_line)
    except Exception as error:  # each package raises its own
        first = redact_keys(str(error)).splitlines()[0] if str(error) else type(error).__name__
        raise ConfigError(f"model {choice.model!r} cannot be made: {first}", "see `grs doctor`") from error
    return made


def _make_user_defined_model(choice: ModelChoice) -> "BaseChatModel":
    """A model of the user's own class (``Model`` where it is a content file), made with the configured arguments."""
    name = choice.model
    known = [OFFLINE, *(f"{provider}:NAME" for provider in PROVIDERS), *content.content_names("models")]
    make = content.find_class("models", name, "Model") or load_named_class("model", name, ENTRY_POINTS, known)
    for key in ("base_url", "temperature", "max_tokens"):
        if getattr(choice, key) is not None:
            raise ConfigError(
                f"models.<role>.{key} is not passed on to {name!r}", "put it into models.<role>.arguments"
            )
    if choice.key_variable:
        register_key_variable(choice.key_variable)
    try:
        made = make(**choice.arguments)
    except Exception as error:  # whatever the user's own code raises
        raise broken_class_error("model", name, error) from error
    from langchain_core.language_models.chat_models import BaseChatModel

    if not isinstance(made, BaseChatModel):
        raise ConfigError(f"model {name!r} is no LangChain chat model", "derive it from BaseChatModel")
    return made


def list_model_variables(models: Iterable[ModelConfig]) -> frozenset[str]:
    """The environment variables that the clients of ``models`` and their fallbacks read, whether set or not."""
    names: set[str] = set()
    for choice in (choice for model in models for choice in (model, *model.fallbacks)):
        provider = PROVIDERS.get(choice.model.partition(":")[0])
        default = () if provider is None else (provider.key_variable, *provider.variables)
        names.update(filter(None, (choice.key_variable, *default)))
    return frozenset(names)


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


def _import_client_class(provider: Provider, model: str) -> Any:
    try:
        return getattr(import_module(provider.module), provider.model_class)
    except ImportError as error:
        what = f"model {model!r} needs the package {provider.module}, which is not installed"
        raise ConfigError(what, f'run: pip install "grs-agents[{provider.extra}]"') from error


def _api_key_argument(provider: Provider, config: ModelChoice) -> dict[str, str]:
    variable = config.key_variable or provider.key_variable
    if variable:
        register_key_variable(variable)
    if not variable or not provider.key_argument:
        return {}
    key = os.environ.get(variable, "")
    if not key and is_loopback_url(config.base_url):
        key = PLACEHOLDER_KEY
    if not key:
        raise ConfigError(
            f"model {config.model!r} needs a key, and the environment variable {variable} is not set",
            f"set {variable}, or name another variable with models.<role>.key_variable",
        )
    return {provider.key_argument: key}


def _build_client_arguments(name: str, config: ModelChoice) -> dict[str, Any]:
    provider = PROVIDERS[name]
    settings: dict[str, Any] = {"timeout": config.timeout}
    if name == "ollama":
        settings = {"client_kwargs": {"timeout": config.timeout}}
    if name == "bedrock":
        settings = {"timeout": ceil(config.timeout)}  # whole seconds
    if config.base_url:
        settings[provider.url_argument] = config.base_url
    if config.temperature is not None:
        settings["temperature"] = config.temperature
    if config.max_tokens is not None:
        settings[provider.length_argument] = config.max_tokens
    return settings
