"""Describing assets with a model, once: the words that photos are compared with."""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from langchain_core.language_models.chat_models import BaseChatModel
from langchain_core.runnables.config import ContextThreadPoolExecutor
from pydantic import Field, ValidationError

from grs_agents.agents.agent import image_block_from_array
from grs_agents.agents.prompt_template import render_prompt_template
from grs_agents.agents.reply import ReplyError, parse_json
from grs_agents.agents.types import ModelReply
from grs_agents.base import Frozen, content, interrupts
from grs_agents.base.config.schema import ModelConfig
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json
from grs_agents.base.foreign.files import read_text
from grs_agents.library.asset import Asset
from grs_agents.library.asset_rendering import RANDOM_VIEW_SIZE, RANDOM_VIEWS, AssetView, render_random_views
from grs_agents.library.colors import main_color_names
from grs_agents.library.contact_sheets import composite_over_white
from grs_agents.library.library import Library
from grs_agents.models.answer import ReplyProblem
from grs_agents.models.call import invoke_with_retries
from grs_agents.models.factory import is_offline, make_retries

PROMPT = "describe_asset"
_REPLY_TOKENS = 120
_PIXELS_PER_TOKEN = 600
_TRIES = 3


class AssetDescription(ModelReply):
    """A model's description of an asset."""

    description: str = Field(min_length=1, max_length=2000)
    color: str = Field(min_length=1, max_length=40)
    category: str = Field(min_length=1, max_length=40)


class DescribedAsset(Frozen):
    """A description with its provenance, as stored beside the asset."""

    asset: str
    words: AssetDescription  # as the model replied
    model: str  # who said it
    prompt: str  # SHA-256 of the prompt's template
    content: str  # SHA-256 of the asset's content; another value makes the description out of date
    date: str  # ISO 8601, UTC
    input_tokens: int = 0  # as the provider counted them
    output_tokens: int = 0


@dataclass(frozen=True)
class DescriptionPlan:
    """Assets to describe, and the estimated cost."""

    todo: tuple[Asset, ...]
    done: tuple[DescribedAsset, ...]  # described before by the same model with the same prompt
    input_tokens: int  # about, for all of `todo`
    output_tokens: int


def select_assets_to_describe(root: Path, assets: Sequence[Asset], model: str, again: bool = False) -> DescriptionPlan:
    """Select the assets of the library ``root`` to describe, with an estimate of the tokens."""
    prompt = _prompt_hash()
    todo: list[Asset] = []
    done: list[DescribedAsset] = []
    for asset in assets:
        before = read_saved_description(root, asset.name)
        fits = before is not None and (before.model, before.prompt, before.content) == (
            model,
            prompt,
            _asset_content_hash(asset),
        )
        if before is not None and fits and not again:
            done.append(before)
        else:
            todo.append(asset)
    template = content.content_path("prompts", PROMPT).read_text("utf-8")
    tokens = len(template) // 4 + 60 + RANDOM_VIEWS * RANDOM_VIEW_SIZE**2 // _PIXELS_PER_TOKEN
    return DescriptionPlan(tuple(todo), tuple(done), tokens * len(todo), _REPLY_TOKENS * len(todo))


def describe_assets(
    root: Path,
    library: Library,
    todo: Sequence[Asset],
    model: BaseChatModel,
    spec: ModelConfig,
    warn: Callable[[str], None],
) -> Iterator[tuple[Asset, DescribedAsset | None]]:
    """Describe as many assets at once as ``spec.concurrency`` says, and yield them in their order.

    Each description is stored as soon as it is there. None if the model gave no usable reply.
    """

    def describe(asset: Asset) -> DescribedAsset | None:
        if interrupts.is_interrupt_requested():  # assets that still wait for a thread are not asked about
            raise KeyboardInterrupt
        return _describe_asset(root, library, asset, model, spec, warn)

    with ContextThreadPoolExecutor(1 if is_offline(spec.model) else spec.concurrency) as pool:
        waiting = [pool.submit(describe, asset) for asset in todo]
        try:
            for asset, future in zip(todo, waiting, strict=True):
                described = future.result()
                yield (asset if described is None else replace_asset_description(asset, described.words)), described
        finally:
            for future in waiting:
                future.cancel()


def _describe_asset(
    root: Path,
    library: Library,
    asset: Asset,
    model: BaseChatModel,
    spec: ModelConfig,
    warn: Callable[[str], None],
) -> DescribedAsset | None:
    """Describe an asset and store the description; None if the model gave no usable reply."""
    views = render_random_views(library, asset.name)
    facts = {
        "file_name": Path(asset.name).stem,
        "size_m": [round(extent, 3) for extent in asset.size],
        "colors": visible_color_names(views),
        "hollow": asset.hollow,
    }
    prompt = render_prompt_template(content.content_path("prompts", PROMPT), PROMPT, {"facts": json.dumps(facts)})
    messages = prompt.to_messages([image_block_from_array(composite_over_white(view)[:, :, ::-1]) for view in views])
    for _ in range(_TRIES):
        try:
            answer = invoke_with_retries(model, messages, make_retries(spec))
            words = parse_json(answer.text, AssetDescription)
        except (ReplyProblem, ReplyError) as error:
            warn(f"{asset.name}: {error}")
            continue
        described = DescribedAsset(
            asset=asset.name,
            words=words,
            model=spec.model,
            prompt=_prompt_hash(),
            content=_asset_content_hash(asset),
            date=datetime.now(UTC).isoformat(timespec="seconds"),
            input_tokens=answer.input_tokens,
            output_tokens=answer.output_tokens,
        )
        write_json(description_file_path(root, asset.name), described.model_dump(mode="json"))
        return described
    return None


def replace_asset_description(asset: Asset, words: AssetDescription) -> Asset:
    """The asset with a model's description; its size is added, since the pictures do not show it."""
    x, y, z = (f"{100 * extent:.1f}" for extent in asset.size)
    text = f"{words.description.strip().rstrip('.')}, {x} x {y} x {z} cm"
    return asset.model_copy(update={"description": text, "color": words.color, "category": words.category.lower()})


def description_file_path(root: Path, name: str) -> Path:
    """File in which the description of an asset is kept. Raises InputError: a link leads out of the library."""
    urdf = root / name
    folder = urdf.parent / "descriptions"
    if not folder.resolve().is_relative_to(root.resolve()):
        raise InputError(f"{folder} leads out of {root}", "remove the link")
    return folder / f"{urdf.stem}.json"


def read_saved_description(root: Path, name: str) -> DescribedAsset | None:
    """The stored description of an asset; None if there is none, or it cannot be read."""
    file = description_file_path(root, name)
    try:
        return DescribedAsset.model_validate_json(read_text(file))
    except (InputError, ValidationError):
        return None


def visible_color_names(views: Sequence[AssetView]) -> list[str]:
    """Names of the colours that views show, the most frequent first, at most three."""
    return main_color_names(np.concatenate([view.rgba[view.rgba[:, :, 3] > 200][::7, :3] for view in views]), 16)


def _prompt_hash() -> str:
    return hashlib.sha256(content.content_path("prompts", PROMPT).read_bytes()).hexdigest()


def _asset_content_hash(asset: Asset) -> str:
    """Hash of the source files and the size, which make a description out of date."""
    source = asset.origin.content if asset.origin is not None else ""
    return hashlib.sha256(f"{asset.name} {asset.size} {source}".encode()).hexdigest()
