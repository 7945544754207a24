"""The user's models in folders written by transformers: loaded from disk, never from a hub."""

import json
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from grs_agents.base.errors import ConfigError, GrsError, InputError

LOCAL: Mapping[str, bool] = {"local_files_only": True}


def load_model_config(setting: str, name: str | None, tool: str) -> tuple[Path, dict[str, Any]]:
    """The folder ``name`` of a tool's model and its configuration.

    Raises:
        ConfigError: the ``setting`` of our configuration, as ``depth.model``, is unset or names no folder of a model.
    """
    if name is None:
        raise ConfigError(f"tool {tool} needs a model", f"name its folder: --set {setting}=FOLDER")
    folder = Path(name)
    try:
        config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
        return folder, {**config, "model_type": str(config["model_type"])}
    except (OSError, ValueError, RecursionError, TypeError, LookupError) as error:
        found = f"{setting} = {name!r}: no folder of a model with a config.json that transformers wrote ({error})"
        raise ConfigError(found, "name one on this machine; nothing is downloaded") from error


def load_pretrained_model(kind: Any, folder: Path, setting: str, transformers: Any, **options: Any) -> Any:
    """A model of a class of transformers with all its weights, in evaluation mode.

    Raises:
        InputError: weights are missing; transformers would initialise them at random.
    """
    transformers.logging.set_verbosity_error()
    transformers.logging.disable_progress_bar()
    model, notes = kind.from_pretrained(str(folder), use_safetensors=True, output_loading_info=True, **LOCAL, **options)
    missing = sorted(notes["missing_keys"])
    if missing:
        named = ", ".join(missing[:3]) + (", ..." if len(missing) > 3 else "")
        remedy = "name a folder with the whole model"
        raise InputError(f"{setting} = {str(folder)!r} lacks {len(missing)} of its weights: {named}", remedy)
    return model.eval()


@contextmanager
def wrap_model_errors(what: str, folder: Path, photo: object, loader: str) -> Generator[None]:
    """Convert any error of a model's libraries to an InputError of a single line."""
    try:
        yield
    except GrsError:
        raise
    except Exception as error:
        said = (str(error).strip() or repr(error)).splitlines()[0][:300]
        remedy = f"name the folder of a model that transformers loads by {loader}"
        raise InputError(f"the {what} model {folder} failed on {photo}: {said}", remedy) from error
