"""Segmentation by a detector of the user's own: what is refused, and tiny real detectors where transformers is."""

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grs_agents.base import content
from grs_agents.base.errors import ConfigError, InputError
from grs_agents.perception.table_finding import find_table
from grs_agents.toolkit import ToolContext
from tests.needs import needs, require
from tests.perception.conftest import THINGS, render

FRAME = render(THINGS, calibrated=True).frame
TABLE = find_table(FRAME, np.random.default_rng(0))
WORDS = ("red", "box", "can", "mug", "a", "the", ".", "?")


def ask(model: str | None, context: ToolContext, *prompts: str) -> Any:
    tool = content.load_module("tools", "segment_grounded")
    return tool.run(tool.Request(frame=FRAME, table=TABLE, model=model, prompts=prompts), context).candidates


def test_a_model_of_another_kind_is_refused(tmp_path: Path, context: ToolContext) -> None:
    (tmp_path / "config.json").write_text(json.dumps({"model_type": "sam2"}))
    with pytest.raises(ConfigError, match=r"is a sam2 model.*grounding-dino"):
        ask(str(tmp_path), context)
    with pytest.raises(ConfigError, match="needs a model"):
        ask(None, context)


def _tiny_owl(transformers: Any, folder: Path) -> None:
    """An OWL-ViT of a few ten thousand random weights, as its authors' are written to disk."""
    vocabulary = {"<|startoftext|>": 0, "<|endoftext|>": 1, **{f"{word}</w>": 2 + n for n, word in enumerate(WORDS)}}
    for letter in "abcdefghijklmnopqrstuvwxyz":
        vocabulary.setdefault(letter, len(vocabulary))
        vocabulary.setdefault(f"{letter}</w>", len(vocabulary))
    (folder / "vocab.json").write_text(json.dumps(vocabulary))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    tokenizer = transformers.CLIPTokenizer(
        vocab=str(folder / "vocab.json"),
        merges=str(folder / "merges.txt"),
        pad_token="<|endoftext|>",
        model_max_length=16,
    )
    size = {"hidden_size": 16, "intermediate_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2}
    text = {**size, "vocab_size": len(vocabulary), "max_position_embeddings": 16, "eos_token_id": 1, "bos_token_id": 0}
    config = transformers.OwlViTConfig(
        text_config=text, vision_config={**size, "image_size": 64, "patch_size": 16}, projection_dim=16
    )
    pictures = transformers.OwlViTImageProcessor(size={"height": 64, "width": 64})
    transformers.OwlViTForObjectDetection(config).save_pretrained(folder)
    transformers.OwlViTProcessor(pictures, tokenizer).save_pretrained(folder)


def _tiny_dino(transformers: Any, folder: Path) -> None:
    """A Grounding DINO of a few ten thousand random weights."""
    (folder / "vocab.txt").write_text("\n".join(("[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", *WORDS)))
    tokenizer = transformers.BertTokenizer(vocab=str(folder / "vocab.txt"))
    backbone = transformers.SwinConfig(
        image_size=64, embed_dim=8, depths=[1, 1, 1, 1], num_heads=[1, 1, 2, 2], window_size=4, out_indices=[2, 3, 4]
    )
    text = transformers.BertConfig(
        vocab_size=16, hidden_size=32, num_hidden_layers=1, num_attention_heads=2, intermediate_size=16
    )
    config = transformers.GroundingDinoConfig(
        backbone_config=backbone,
        text_config=text,
        d_model=32,
        encoder_layers=1,
        decoder_layers=2,
        encoder_ffn_dim=16,
        decoder_ffn_dim=16,
        encoder_attention_heads=2,
        decoder_attention_heads=2,
        num_queries=10,
        num_feature_levels=3,
    )
    pictures = transformers.GroundingDinoImageProcessor(size={"shortest_edge": 64, "longest_edge": 96})
    transformers.GroundingDinoForObjectDetection(config).save_pretrained(folder)
    transformers.GroundingDinoProcessor(pictures, tokenizer).save_pretrained(folder)


@pytest.fixture(params=[_tiny_owl, _tiny_dino])
def detector(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    require("torch", "transformers")
    torch, transformers = importlib.import_module("torch"), importlib.import_module("transformers")
    torch.manual_seed(0)
    request.param(transformers, tmp_path)
    return tmp_path


def test_a_real_detector_is_asked_and_what_it_does_not_find_stands_on_the_table_all_the_same(
    detector: Path, context: ToolContext
) -> None:
    found = [ask(str(detector), context, *prompts) for prompts in (("red box", "can"), ("red box", "can"), ())]
    assert len(found[0]) == len(found[1]) >= len(THINGS) - 1
    assert all((one.mask == other.mask).all() for one, other in zip(found[0], found[1], strict=True))
    assert found[2]


def test_a_detector_without_its_weights_is_refused(detector: Path, context: ToolContext) -> None:
    (detector / "model.safetensors").write_bytes(b"torn")
    with pytest.raises(InputError, match="failed on"):
        ask(str(detector), context, "can")


@needs("torch", "transformers")
def test_a_device_that_is_not_there_is_one_line(tmp_path: Path, context: ToolContext) -> None:
    transformers = importlib.import_module("transformers")
    _tiny_owl(transformers, tmp_path)
    tool = content.load_module("tools", "segment_grounded")
    request = tool.Request(frame=FRAME, table=TABLE, model=str(tmp_path), prompts=("can",), device="abacus")
    with pytest.raises(InputError, match=r"failed on .*abacus"):
        tool.run(request, context)
