"""Make the chat model that a configuration names: ``offline``, ``provider:name`` or a user-defined class."""

import ipaddress
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from importlib import import_module
from math import ceil
from operator import attrgetter
from typing import TYPE_CHECKING, Any, cast
from urllib.parse import urlsplit

from pydantic import ValidationError

from grs_agents.base import content
from grs_agents.base.config.schema import ModelChoice, ModelConfig
from grs_agents.base.errors import ConfigError
from grs_agents.base.plugins import broken_class_error, load_named_class
from grs_agents.models.call import Retries, limit_and_record_http_client
from grs_agents.models.key_redaction import redact_keys, register_key_variable

if TYPE_CHECKING:
    from langchain_core.language_models.chat_models import BaseChatModel

OFFLINE = "offline"
ENTRY_POINTS = "grs_agents.models"
"""The group of entry points for models of other packages."""
PLACEHOLDER_KEY = "not-needed"
"""Key for a server on this machine that needs none."""


def _timeout_in_whole_seconds(seconds: float) -> dict[str, Any]:
    return {"timeout": ceil(seconds)}


@dataclass(frozen=True)
class Provider:
    """Construction of a provider's LangChain client."""

    module: str  # the package to import
    model_class: str  # the chat model in it
    # attribute path of the model's HTTP client, which is watched; empty without one. Only two of the packages take a
    # client or hooks when a model is made.
    http_client: str
    key_variable: str  # default environment variable of the key; empty if none is needed
    extra: str = ""  # of `grs-agents`, which installs the package; empty if it is installed by its name
    # the constructor's names for the key (empty if the client finds it by itself), the model, the endpoint, and the
    # longest reply; empty if it takes none
    key_argument: str = "api_key"
    model_argument: str = "model"
    url_argument: str = "base_url"
    length_argument: str = "max_tokens"
    timeout: Callable[[float], Mapping[str, Any]] = lambda seconds: {
        "timeout": seconds
    }  # the arguments for a timeout in seconds
    # further arguments; the client's own retries are switched off, ours are in `retry`
    defaults: Mapping[str, Any] = field(default_factory=lambda: {"max_retries": 0})
    by_line: bool = False  # each line of a reply is a JSON document
    variables: tuple[str, ...] = ()  # further environment variables that its client reads
    constructor: str = ""  # the class method that makes the model; empty for the class itself
    url: str = ""  # the endpoint if the configuration names none; empty for the client's default
    cleared: str = ""  # attribute of the model that is set to None after construction

    @property
    def install_command(self) -> str:
        """Command that installs the package."""
        package = self.module.partition(".")[0].replace("_", "-")
        return f'pip install "grs-agents[{self.extra}]"' if self.extra else f"pip install {package}"


_OPENAI_CLIENT = "root_client._client"
_OF_AWS = (
    *("AWS_ACCESS_KEY_ID", "AWS_SESSION_TOKEN", "AWS_BEARER_TOKEN_BEDROCK", "AWS_REGION", "AWS_DEFAULT_REGION"),
    *("AWS_PROFILE", "AWS_ENDPOINT_URL", "AWS_ENDPOINT_URL_BEDROCK_RUNTIME", "AWS_CA_BUNDLE"),
)
_AZURE = Provider(
    "langchain_openai",
    "AzureChatOpenAI",
    _OPENAI_CLIENT,
    "AZURE_OPENAI_API_KEY",
    "openai",
    model_argument="azure_deployment",
    url_argument="azure_endpoint",
    variables=("AZURE_OPENAI_ENDPOINT", "OPENAI_API_VERSION", "OPENAI_ORG_ID", "OPENAI_PROXY"),
)
_BEDROCK = Provider(
    "langchain_aws",
    "ChatBedrockConverse",
    "client",
    "AWS_SECRET_ACCESS_KEY",
    "bedrock",
    "",
    timeout=_timeout_in_whole_seconds,
    variables=_OF_AWS,
)
_GOOGLE = Provider(
    "langchain_google_genai",
    "ChatGoogleGenerativeAI",
    "client._api_client._httpx_client",
    "GOOGLE_API_KEY",
    "google",
    "google_api_key",
    length_argument="max_output_tokens",
    variables=("GEMINI_API_KEY", "GOOGLE_GENAI_USE_VERTEXAI", "GOOGLE_CLOUD_PROJECT", "GOOGLE_CLOUD_LOCATION"),
)
_FOR_ANTHROPIC: Mapping[str, Any] = {"max_retries": 0, "max_tokens": 8192}
PROVIDERS: Mapping[str, Provider] = {
    "openai": Provider(
        "langchain_openai",
        "ChatOpenAI",
        _OPENAI_CLIENT,
        "OPENAI_API_KEY",
        "openai",
        variables=("OPENAI_BASE_URL", "OPENAI_API_BASE", "OPENAI_ORG_ID", "OPENAI_PROJECT_ID", "OPENAI_PROXY"),
    ),
    "azure": _AZURE,
    "anthropic": Provider(
        "langchain_anthropic",
        "ChatAnthropic",
        "_client._client",
        "ANTHROPIC_API_KEY",
        "anthropic",
        defaults=_FOR_ANTHROPIC,
        variables=("ANTHROPIC_BASE_URL", "ANTHROPIC_API_URL", "ANTHROPIC_PROXY"),
    ),
    "bedrock": _BEDROCK,
    "google": _GOOGLE,
    "ollama": Provider(
        "langchain_ollama",
        "ChatOllama",
        "_client._client",
        "",
        "ollama",
        "",
        length_argument="num_predict",
        timeout=lambda seconds: {"client_kwargs": {"timeout": seconds}},
        defaults={},
        by_line=True,
        variables=("OLLAMA_HOST", "OLLAMA_API_KEY"),
    ),
    # The other names of LangChain's `init_chat_model`
    "anthropic_bedrock": Provider(
        "langchain_aws",
        "ChatAnthropicBedrock",
        "_client._client",
        "AWS_SECRET_ACCESS_KEY",
        "bedrock",
        "",
        url_argument="",
        defaults=_FOR_ANTHROPIC,
        variables=_OF_AWS,
    ),
    "azure_ai": Provider(
        "langchain_azure_ai.chat_models",
        "AzureAIOpenAIApiChatModel",
        _OPENAI_CLIENT,
        "AZURE_AI_API_KEY",
        key_argument="credential",
        url_argument="endpoint",
    ),
    "azure_openai": _AZURE,
    "baseten": Provider("langchain_baseten", "ChatBaseten", _OPENAI_CLIENT, "BASETEN_API_KEY"),
    "bedrock_converse": _BEDROCK,
    "bedrock_mantle_anthropic": Provider(
        "langchain_aws",
        "ChatAnthropicMantle",
        "_client._client",
        "AWS_SECRET_ACCESS_KEY",
        "bedrock",
        "",
        defaults=_FOR_ANTHROPIC,
        variables=_OF_AWS,
    ),
    "bedrock_mantle_openai": Provider(
        "langchain_aws", "ChatOpenAIMantle", _OPENAI_CLIENT, "AWS_SECRET_ACCESS_KEY", "bedrock", "", variables=_OF_AWS
    ),
    "cohere": Provider(
        "langchain_cohere",
        "ChatCohere",
        "client._client_wrapper.httpx_client.httpx_client",
        "COHERE_API_KEY",
        key_argument="cohere_api_key",
        length_argument="",
        timeout=lambda seconds: {"timeout_seconds": seconds},
        defaults={},
    ),
    "deepseek": Provider("langchain_deepseek", "ChatDeepSeek", _OPENAI_CLIENT, "DEEPSEEK_API_KEY"),
    "fireworks": Provider("langchain_fireworks", "ChatFireworks", "_sdk_client._client", "FIREWORKS_API_KEY"),
    "google_anthropic_vertex": Provider(
        "langchain_google_vertexai.model_garden", "ChatAnthropicVertex", "client._client", "", key_argument=""
    ),
    "google_genai": _GOOGLE,
    "google_vertexai": Provider("langchain_google_vertexai", "ChatVertexAI", "", "", key_argument=""),
    "groq": Provider("langchain_groq", "ChatGroq", "client._client._client", "GROQ_API_KEY"),
    "huggingface": Provider(
        "langchain_huggingface",
        "ChatHuggingFace",
        "",
        "HF_TOKEN",
        key_argument="huggingfacehub_api_token",
        model_argument="model_id",
        url_argument="",
        length_argument="max_new_tokens",
        timeout=_timeout_in_whole_seconds,
        defaults={"backend": "endpoint"},
        constructor="from_model_id",
    ),
    "ibm": Provider(
        "langchain_ibm",
        "ChatWatsonx",
        "",
        "WATSONX_API_KEY",
        model_argument="model_id",
        url_argument="url",
        timeout=lambda seconds: {},
        defaults={},
    ),
    "langsmith": Provider(
        "langchain_openai",
        "ChatOpenAI",
        _OPENAI_CLIENT,
        "LANGSMITH_API_KEY",
        "openai",
        defaults={"max_retries": 0, "use_responses_api": True},
        url="https://gateway.smith.langchain.com/v1",
    ),
    "litellm": Provider(
        "langchain_litellm",
        "ChatLiteLLM",
        "",
        "",
        url_argument="api_base",
        timeout=lambda seconds: {"request_timeout": seconds},
        defaults={"max_retries": 1},  # calls in all
    ),
    "meta": Provider("langchain_meta", "ChatMetaModel", _OPENAI_CLIENT, "META_API_KEY"),
    "mistralai": Provider(
        "langchain_mistralai", "ChatMistralAI", "client", "MISTRAL_API_KEY", timeout=_timeout_in_whole_seconds
    ),
    "nvidia": Provider("langchain_nvidia_ai_endpoints", "ChatNVIDIA", "_client", "NVIDIA_API_KEY", defaults={}),
    "openrouter": Provider(
        "langchain_openrouter",
        "ChatOpenRouter",
        "client.sdk_configuration.client",
        "OPENROUTER_API_KEY",
        timeout=lambda seconds: {"timeout": ceil(1000 * seconds)},
        cleared="client.sdk_configuration.retry_config",  # without this it retries for an hour
    ),
    "perplexity": Provider("langchain_perplexity", "ChatPerplexity", "client._client", "PPLX_API_KEY", url_argument=""),
    "together": Provider("langchain_together", "ChatTogether", "client._client._client", "TOGETHER_API_KEY"),
    "upstage": Provider("langchain_upstage", "ChatUpstage", _OPENAI_CLIENT, "UPSTAGE_API_KEY"),
    "xai": Provider("langchain_xai", "ChatXAI", "client._client._client", "XAI_API_KEY"),
}
"""By the name before the colon. LangChain's table is private, and in a package that GRS does not need."""
_COMMON = ("openai", "azure", "anthropic", "bedrock", "google", "ollama")
"""Providers with an extra, which errors list."""


def make_chat_model(config: ModelConfig, seed: int) -> "BaseChatModel":
    """The chat model that ``config`` names, with its fallbacks; ``seed`` is for the ``offline`` model's choices.

    Raises:
        UnknownNameError: no such provider, entry point or module.
        ConfigError: the provider's package is not installed, its key is not set, or a user-defined class cannot be
            imported or made.
    """
    choices = (config, *config.fallbacks)
    models = tuple(_make_single_model(choice, seed) for choice in choices)
    for choice, model in zip(choices, models, strict=True):
        if choice.requests_per_second is not None:
            from langchain_core.rate_limiters import InMemoryRateLimiter

            model.rate_limiter = InMemoryRateLimiter(
                requests_per_second=choice.requests_per_second, max_bucket_size=choice.burst
            )
    if len(models) == 1:
        return models[0]
    from grs_agents.models.fallbacks import FallbackChatModel

    return FallbackChatModel(
        names=tuple(choice.model for choice in choices),
        models=models,
        retries=tuple(make_retries(choice) for choice in choices),
        pictures=tuple(takes_pictures(choice, model) for choice, model in zip(choices, models, strict=True)),
        structured=tuple(map(takes_schema, choices)),
    )


def takes_pictures(choice: ModelChoice, model: "BaseChatModel") -> bool:
    """True if pictures are sent to ``model``, made of ``choice``.

    By default they are, unless the profile that LangChain ships of it says that it reads none; of several models the
    first decides.
    """
    if choice.pictures != "auto":
        return choice.pictures
    first: Any = getattr(model, "models", (model,))[0]
    profile: Mapping[str, Any] = getattr(first, "profile", None) or {}
    return profile.get("image_inputs") is not False


def takes_schema(choice: ModelChoice) -> bool:
    """True if the model may be sent a JSON schema of its reply."""
    return choice.structured == "auto" and not is_offline(choice.model)


def make_retries(choice: ModelChoice) -> Retries:
    """Limits of a model's tries; the offline model, and fallbacks together, have no deadline."""
    endless = is_offline(choice.model) or (isinstance(choice, ModelConfig) and choice.fallbacks)
    return Retries(deadline=None if endless else choice.timeout)


def _make_single_model(choice: ModelChoice, seed: int) -> "BaseChatModel":
    if is_offline(choice.model):
        from grs_agents.models.offline.chat import make_offline_model

        return make_offline_model(choice.model, seed)
    name, colon, model = choice.model.partition(":")
    if name not in PROVIDERS:
        return _make_user_defined_model(choice)
    if not colon or not model.strip():
        raise ConfigError(f"model {choice.model!r} names no model of {name}", f"write {name}:NAME")
    provider = PROVIDERS[name]
    try:
        make: Any = getattr(import_module(provider.module), provider.model_class)
    except ImportError as error:
        what = f"model {choice.model!r} needs the package {provider.module.partition('.')[0]}, which is not installed"
        raise ConfigError(what, f"run: {provider.install_command}") from error
    make = getattr(make, provider.constructor) if provider.constructor else make
    settings: dict[str, Any] = dict(provider.timeout(choice.timeout))
    for key, argument in (
        ("base_url", provider.url_argument),
        ("temperature", "temperature"),
        ("max_tokens", provider.length_argument),
    ):
        value = getattr(choice, key) or (provider.url if key == "base_url" else None)
        if value is None or value == "":
            continue
        if not argument:
            what = f"models.<role>.{key} is not passed on to {choice.model!r}: {provider.model_class} takes none"
            raise ConfigError(what, "leave it out")
        settings[argument] = value
    key_argument: dict[str, str] = {}
    variable = choice.key_variable or provider.key_variable
    if variable:
        register_key_variable(variable)
    if variable and provider.key_argument:
        api_key = os.environ.get(variable, "") or (PLACEHOLDER_KEY if is_loopback_url(choice.base_url) else "")
        if not api_key:
            raise ConfigError(
                f"model {choice.model!r} needs a key, and the environment variable {variable} is not set",
                f"set {variable}, or name another variable with models.<role>.key_variable",
            )
        key_argument[provider.key_argument] = api_key
    ours = {**provider.defaults, provider.model_argument: model.strip(), **key_argument, **settings}
    if taken := sorted(choice.arguments.keys() & ours.keys()):
        raise ConfigError(f"models.<role>.arguments holds {taken[0]}, which GRS sets itself", "leave it out")
    try:
        chat_model = cast("BaseChatModel", make(**ours, **choice.arguments))
        if provider.cleared:
            holder, _, name = provider.cleared.rpartition(".")
            setattr(attrgetter(holder)(chat_model), name, None)
        if provider.http_client:
            limit_and_record_http_client(attrgetter(provider.http_client)(chat_model), provider.by_line)
    except Exception as error:  # each package raises its own
        text = str(error).partition("\n")[0]
        if isinstance(error, ValidationError):  # its own text repeats the arguments, a key cut in two among them
            faults = [f"{'.'.join(map(str, fault['loc']))} {fault['msg']}".strip() for fault in error.errors()]
            text = "; ".join(faults)
        reason = redact_keys(text) or type(error).__name__
        raise ConfigError(f"model {choice.model!r} cannot be made: {reason}", "see `grs doctor`") from error
    return chat_model


def _make_user_defined_model(choice: ModelChoice) -> "BaseChatModel":
    """Make a model of a user-defined class (``Model`` in a content file) with the configured arguments."""
    name = choice.model
    near = get_close_matches(name.partition(":")[0], PROVIDERS)
    listed = [provider for provider in PROVIDERS if provider in _COMMON or provider in near]
    known = [OFFLINE, *(f"{provider}:NAME" for provider in listed), *content.content_names("models")]
    make = content.find_class("models", name, "Model") or load_named_class("model", name, ENTRY_POINTS, known)
    for key in ("base_url", "temperature", "max_tokens"):
        if getattr(choice, key) is not None:
            raise ConfigError(
                f"models.<role>.{key} is not passed on to {name!r}", "put it into models.<role>.arguments"
            )
    if choice.key_variable:
        register_key_variable(choice.key_variable)
    try:
        chat_model = make(**choice.arguments)
    except Exception as error:  # of the user's code
        raise broken_class_error("model", name, error) from error
    from langchain_core.language_models.chat_models import BaseChatModel

    if not isinstance(chat_model, BaseChatModel):
        raise ConfigError(f"model {name!r} is no LangChain chat model", "derive it from BaseChatModel")
    return chat_model


def list_model_variables(models: Iterable[ModelConfig]) -> frozenset[str]:
    """The environment variables that the clients of ``models`` and their fallbacks read, set or not."""
    names: set[str] = set()
    for choice in (choice for model in models for choice in (model, *model.fallbacks)):
        provider = PROVIDERS.get(choice.model.partition(":")[0])
        default = () if provider is None else (provider.key_variable, *provider.variables)
        names.update(filter(None, (choice.key_variable, *default)))
    return frozenset(names)


def is_provider_installed(provider: str) -> bool:
    """True if the package of ``provider`` can be imported."""
    try:
        import_module(PROVIDERS[provider].module)
    except ImportError:
        return False
    return True


def is_offline(model: str) -> bool:
    """True for the embedded model, with or without mistakes."""
    return model.partition(":")[0] == OFFLINE


def is_loopback_url(url: str | None) -> bool:
    """True if ``url`` points at this machine."""
    host = (urlsplit(url).hostname or "") if url else ""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
