"""The configuration in a run folder: untrusted, so it is shown and compared, never run unchanged.

A resumed run takes the settings of an allow-list from it (`portable_settings`); all others are those of this machine.
"""

import json
import re
import reprlib
from collections.abc import Iterator, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, Final, cast

from pydantic import BaseModel, ConfigDict, JsonValue, RootModel

from grs_agents.base.config.load import (
    EffectiveConfig,
    Tree,
    flatten_tree,
    merge_trees,
    nest_under_keys,
    validate_config,
)
from grs_agents.base.config.schema import ROLES, Config, ModelConfig, Portable
from grs_agents.base.errors import ConfigError

_OFFLINE: Final = re.compile(r"offline(:[a-z0-9_]{1,64})?")
"""Models that need no key, no network and no user code: a run folder may name them."""
_OF_THIS_MACHINE: Final = frozenset({"sandbox", "workers"})
"""Settings that change no verdict; a resumed run takes them from this machine without asking."""


_MODEL_DEFAULTS: Final = {**ModelConfig(model="offline").model_dump(mode="json"), "model": None}
"""Settings of a role that no error lists."""
_MOST_LISTED: Final = 8
"""Most settings that an error lists."""


@cache
def portable_settings() -> dict[str, re.Pattern[str]]:
    """The allow-list: the dotted key of each setting marked `Portable`, with the pattern of its texts."""
    return dict(_list_portable(Config, "", None))


def _list_portable(model: type[BaseModel], prefix: str, mark: Portable | None) -> Iterator[tuple[str, re.Pattern[str]]]:
    for name, field in model.model_fields.items():
        nearest = next((item for item in field.metadata if isinstance(item, Portable)), mark)
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from _list_portable(field.annotation, f"{prefix}{name}.", nearest)
        elif nearest is not None:
            yield f"{prefix}{name}", re.compile(nearest.pattern)


def select_portable_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """The settings by dotted key that are in the allow-list and whose texts are plain names."""
    allowed = portable_settings()
    return {key: value for key, value in settings.items() if key in allowed and _is_plain(value, allowed[key])}


class RecordedConfig(RootModel[dict[str, JsonValue]]):
    """A configuration as a file states it; `select_portable` and `resume_on` alone give settings that a run may use."""

    model_config = ConfigDict(frozen=True)

    @classmethod
    def of(cls, config: Config) -> "RecordedConfig":
        """The record of a configuration."""
        return cls(config.model_dump(mode="json"))

    def as_json(self) -> dict[str, Any]:
        """The settings as in the file, to be shown or written."""
        return dict(self.root)

    def select_portable(self) -> dict[str, Any]:
        """The portable settings by dotted key."""
        return select_portable_settings(flatten_tree(self.as_json()))

    def model_names(self) -> dict[str, str]:
        """The name of the model of each role, without endpoint, key or arguments. The names are untrusted."""
        models = self.root.get("models")
        choices = models.items() if isinstance(models, dict) else ()
        return {
            role: name
            for role, choice in choices
            if role in ROLES and isinstance(choice, dict) and isinstance(name := choice.get("model"), str)
        }

    def over(self, local: Config, models: Mapping[str, str] = MappingProxyType({})) -> Config:
        """The portable settings, and ``models`` by role, over those of ``local``.

        Raises:
            ConfigError: a portable setting is out of bounds.
        """
        tree: Tree = local.model_dump()
        tree["models"] |= {role: {"model": name} for role, name in models.items()}
        for key, value in self.select_portable().items():
            tree = merge_trees(tree, nest_under_keys(key.split("."), value))
        return validate_config(tree)

    def resume_on(self, local: EffectiveConfig) -> Config:
        """The configuration of a resumed run: the portable settings of the file, all others from ``local``.

        Args:
            local: the configuration of this machine, with the settings that the user states for this attempt.

        Raises:
            ConfigError: the user states another value for a portable setting; or the file has other values for settings
                that a file cannot choose, and the user does not state them.
        """
        here, recorded = flatten_tree(local.config.model_dump(mode="json")), flatten_tree(self.as_json())
        portable = self.select_portable()
        for key, value in portable.items():
            if local.states(key) and here.get(key) != value:
                raise ConfigError(
                    f"a resumed run keeps its {key} = {value!r}, not {here.get(key)!r}", f"leave {key} out"
                )
        named = self.model_names().items()
        offline = {
            role: name for role, name in named if _OFFLINE.fullmatch(name) and not local.states(f"models.{role}")
        }
        config = self.over(local.config, offline)
        result = flatten_tree(config.model_dump(mode="json"))
        differing = [
            key
            for key, value in recorded.items()
            if (key in result or key.startswith("models.")) and result.get(key) != value
            if key not in _OF_THIS_MACHINE and not local.states(key)
            # a new model has no setting of the old model
            if not (key.startswith("models.") and local.states(".".join(key.split(".")[:2])))
            if key in result or value != _MODEL_DEFAULTS.get(key.rpartition(".")[2], ...)
        ]
        if differing:
            listing = ", ".join(f"{key} = {reprlib.repr(recorded[key])}" for key in differing[:_MOST_LISTED])
            listing += f" and {len(differing) - _MOST_LISTED} more" if len(differing) > _MOST_LISTED else ""
            which = "it" if len(differing) == 1 else "each"
            raise ConfigError(
                f"the run was made with {listing}, which a run folder cannot choose",
                f"state {which} again, or what you want instead: --set {differing[0]}=...",
            )
        return config


def list_local_settings(effective: EffectiveConfig) -> list[str]:
    """The settings, ``KEY=VALUE`` as ``--set`` takes them, that the user stated and that a run folder cannot choose.

    A run that is resumed with them goes on with the configuration that it began with.
    """
    present, default = effective.config.model_dump(mode="json"), Config().model_dump(mode="json")
    models: dict[str, Any] = present.pop("models")
    prices: dict[str, Any] = present.pop("prices")  # whose keys hold dots
    portable, before = select_portable_settings(flatten_tree(present)), flatten_tree(default)
    leaves = {
        key: value
        for key, value in flatten_tree(present).items()
        if key not in portable and key not in _OF_THIS_MACHINE and value not in (None, before[key])
    }
    stated = {key: value for key, value in leaves.items() if effective.states(key)}
    stated |= {f"models.{role}": model for role, model in models.items() if effective.states(f"models.{role}")}
    stated |= {"prices": prices} if effective.states("prices") else {}
    return [f"{key}={_format_toml(value)}" for key, value in stated.items()]


def _format_toml(value: Any) -> str:
    """A JSON value in TOML; keys without a value are left out."""
    if isinstance(value, dict):
        items = cast("dict[str, Any]", value).items()
        return (
            f"{{{', '.join(f'{_format_toml(key)} = {_format_toml(each)}' for key, each in items if each is not None)}}}"
        )
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_format_toml, cast('list[Any]', value)))}]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _is_plain(value: Any, pattern: re.Pattern[str]) -> bool:
    """True if all texts in a value match ``pattern`` whole."""
    if isinstance(value, list | tuple):
        return all(_is_plain(item, pattern) for item in cast("list[Any]", value))
    return not isinstance(value, str) or pattern.fullmatch(value) is not None
