"""Merge defaults, environment, file and ``--set`` into a ``Config`` that knows the source of each value."""

import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError

from grs_agents.base.config.schema import ROLE_ALIASES, ROLES, Config, ModelChoice
from grs_agents.base.errors import ConfigError, InputError, UnknownNameError
from grs_agents.base.foreign.files import read_text
from grs_agents.base.menagerie import resolve_menagerie_name

Tree = dict[str, Any]
ENVIRONMENT_PREFIX = "GRS_"
UNSAFE = "--unsafe-no-sandbox"
"""The only way to run generated code without a sandbox, so that no file brings it along unseen."""
SECRET = ("key_variable", "base_url", "arguments")
"""Keys of a model whose wrong values may hold a secret: an error names them without the value."""


@dataclass(frozen=True)
class EffectiveConfig:
    """A configuration with the source of each value."""

    config: Config
    # dotted key -> `default`, `environment NAME`, `file PATH`, `--set`, `argument`
    sources: Mapping[str, str] = field(default_factory=dict[str, str])

    def states(self, key: str) -> bool:
        """True if the user states ``key``, or a key below it, for this command: not by a default or the environment."""
        below = (source for name, source in self.sources.items() if name == key or name.startswith(f"{key}."))
        return any(source != "default" and not source.startswith("environment ") for source in below)


def load_config(
    file: Path | None = None,
    settings: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
    unsafe: bool = False,
    overrides: Tree | None = None,
) -> EffectiveConfig:
    """Read the configuration; explicit beats implicit: ``--set`` > file > ``GRS_*`` environment > defaults.

    Args:
        file: a TOML file.
        settings: ``key.sub=value`` strings; values are TOML, a bare word is a string.
        environment: of ``GRS_KEY__SUB`` variables; the process's by default.
        unsafe: run generated code without a sandbox; no other layer can request this.
        overrides: settings as Python values, nested by key; they win over all others.

    Raises:
        ConfigError: a file that cannot be read, a malformed setting, an unknown key, a value out of bounds, or a robot
            of Menagerie that cannot be had.
    """
    tree: Tree = Config().model_dump()
    sources = dict.fromkeys(flatten_tree(tree), "default")
    from_file: list[tuple[str, Tree]] = []
    if file:
        try:
            from_file.append(
                (f"file {file}", tomllib.loads(read_text(file, "name an existing TOML file with --config")))
            )
        except InputError as error:
            raise ConfigError(error.message, error.remedy) from error
        except (tomllib.TOMLDecodeError, RecursionError) as error:
            raise ConfigError(f"{file} is not TOML: {error}", "mend the line it names") from error
    from_settings: list[tuple[str, Tree]] = []
    for text in settings:
        key, equals, value = text.partition("=")
        keys = [part.strip() for part in key.split(".")]
        if not equals or not all(keys):
            raise ConfigError(f"--set wants key.sub=value, got {text!r}", "e.g. --set max_fixes=5")
        from_settings.append(("--set", nest_under_keys(keys, _parse_toml_value(value))))
    from_python = [("argument", overrides)] if overrides else []
    layers: list[tuple[str, Tree]] = []
    for name, value in sorted((os.environ if environment is None else environment).items()):
        if name.startswith(ENVIRONMENT_PREFIX) and name != ENVIRONMENT_PREFIX:
            dotted = name.removeprefix(ENVIRONMENT_PREFIX).lower().split("__")
            layers.append((f"environment {name}", nest_under_keys(dotted, _parse_toml_value(value))))
    for layer in (layers, from_file, from_settings, from_python):
        stated: Tree = {}  # merged as a whole: base_url may precede or follow its model
        named: dict[str, str] = {}
        for source, part in layer:
            expanded = _expand_model_shorthands(part)
            stated = merge_trees(stated, expanded)
            named.update(dict.fromkeys(flatten_tree(expanded), source))
        for role, model in cast(Tree, stated.get("models", {})).items():
            if "model" in model:  # another model never inherits the endpoint or key of a layer below
                tree["models"][role] = {}
                sources = {key: value for key, value in sources.items() if not key.startswith(f"models.{role}.")}
        tree = merge_trees(tree, stated)
        sources.update(named)
    if unsafe:
        tree["sandbox"], sources["sandbox"] = "none", UNSAFE
    elif tree["sandbox"] == "none":
        raise ConfigError(f"sandbox = 'none' from {sources['sandbox']}", f"give {UNSAFE} on the command line instead")
    if isinstance(tree["robot"], str):
        tree["robot"] = resolve_menagerie_name(tree["robot"])
    return EffectiveConfig(validate_config(tree), sources)


def _parse_toml_value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError):
        return text.strip()


def nest_under_keys(keys: Sequence[str], value: Any) -> Tree:
    """A tree whose only value lies under ``keys``, the outermost first."""
    for key in reversed(keys):
        value = {key: value}
    return cast(Tree, value)


def _expand_model_shorthands(layer: Tree) -> Tree:
    """Spell shorthands out: ``models.default = "offline"`` and the model keys beside the roles."""
    if "models" not in layer:
        return layer
    if not isinstance(layer["models"], dict):
        raise ConfigError(f"config models = {layer['models']!r}: not a model by role", "e.g. models.default=offline")
    models: Tree = {}
    for key, value in cast(Tree, layer["models"]).items():
        if key in ModelChoice.model_fields.keys() - {"model"}:
            models.setdefault("default", {})[key] = value
            continue
        role = ROLE_ALIASES.get(key, key)
        if role not in ROLES:
            raise UnknownNameError("model role", key, ROLES)
        if not isinstance(value, str | dict | list):
            raise ConfigError(f"config models.{key} = {value!r}: not a model", f"e.g. models.{key}=openai:NAME")
        models.setdefault(role, {}).update(value if isinstance(value, dict) else {"model": value})
    return {**layer, "models": models}


def merge_trees(below: Tree, above: Tree) -> Tree:
    """The values of both; ``above`` wins."""
    merged = dict(below)
    for key, value in above.items():
        old = merged.get(key)
        both = isinstance(old, dict) and isinstance(value, dict)
        merged[key] = merge_trees(cast(Tree, old), cast(Tree, value)) if both else value
    return merged


def flatten_tree(tree: Tree, prefix: str = "") -> Tree:
    """The values of a tree by their dotted keys."""
    values: Tree = {}
    for key, value in tree.items():
        name = f"{prefix}{key}"
        values |= flatten_tree(cast(Tree, value), f"{name}.") if isinstance(value, dict) else {name: value}
    return values


def change_config(config: Config, **changes: Any) -> Config:
    """The configuration with changed top-level keys. Raises ConfigError: a value is out of bounds."""
    return validate_config({**config.model_dump(), **changes})


def validate_config(tree: Tree) -> Config:
    """A whole configuration, as ``Config.model_dump`` gives it, checked.

    Raises:
        ConfigError: an unknown key or a value out of bounds; possible secrets are not repeated.
    """
    try:
        return Config.model_validate(tree)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            raise UnknownNameError("config key", where, flatten_tree(Config().model_dump())) from error
        given = "" if first["loc"][-1] in SECRET else f" = {first['input']!r}"
        raise ConfigError(
            f"config {where}{given}: {first['msg'].removeprefix('Value error, ')}", "see `grs config`"
        ) from error
