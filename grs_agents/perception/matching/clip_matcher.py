"""The baseline of the paper: CLIP embeddings of the crop and of three views of each asset (Radford et al. 2021)."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import ConfigError, InputError
from grs_agents.library.asset_rendering import random_view_directions, render_asset_views
from grs_agents.library.library import Library
from grs_agents.perception.matching.asset_ranking import RankedAssets
from grs_agents.perception.matching.feature_matcher import TOLD, matchable_assets, rank_assets_per_segment
from grs_agents.perception.matching.types import MatchRequest, MatchResult, Segment
from grs_agents.perception.types import Array, MatchEvidence, RGBDFrame

LEAST = 0.5  # a candidate less similar than this to every asset is no object (paper, Table 1)
VIEWS = 3  # random views of an asset
_MARGIN = 0.1  # around a crop, share of its longer side
Picture = npt.NDArray[np.uint8]


class Embedder(Protocol):
    """Embeds pictures as vectors."""

    def __call__(self, pictures: Sequence[Picture]) -> Array:
        """Unit vectors (N, D) of pictures (H, W, 3), red, green, blue."""
        ...


def open_clip_embedder(folder: str | None) -> Embedder:
    """The embedder of an OpenCLIP model in a folder (``open_clip_config.json`` and its weights).

    Raises:
        ConfigError: no folder is named, it holds no such model, or OpenCLIP is not installed.
    """
    if folder is None:
        raise ConfigError("match_clip needs the weights of a model", "name its folder: --set match.model=FOLDER")
    if not (Path(folder) / "open_clip_config.json").is_file():
        raise ConfigError(f"{folder} holds no open_clip_config.json", "name the folder of an OpenCLIP model")
    try:
        torch, open_clip = import_module("torch"), import_module("open_clip")
    except ImportError as error:
        raise ConfigError("match_clip needs OpenCLIP", "pip install 'grs-agents[clip]'") from error
    except RuntimeError as error:  # torchvision built for another torch
        raise ConfigError(
            f"OpenCLIP cannot be loaded: {str(error).splitlines()[0]}", "install torch and torchvision of one build"
        ) from error
    try:
        model, preprocess = open_clip.create_model_from_pretrained(f"local-dir:{Path(folder).resolve()}")
    except (RuntimeError, ValueError, OSError, KeyError) as error:
        raise ConfigError(f"{folder} cannot be loaded: {str(error).splitlines()[0]}", "use another model") from error
    model.eval()
    return _Embedder(torch, model, preprocess)


class _Embedder:
    def __init__(self, torch: Any, model: Any, preprocess: Any) -> None:
        self._torch, self._model, self._preprocess = torch, model, preprocess

    def __call__(self, pictures: Sequence[Picture]) -> Array:
        from PIL import Image

        batch = self._torch.stack([self._preprocess(Image.fromarray(picture)) for picture in pictures])
        with self._torch.no_grad():
            vectors = np.asarray(self._model.encode_image(batch).float().cpu().numpy(), np.float64)
        return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def match_by_clip(request: MatchRequest, library: Library, embedder: Embedder) -> MatchResult:
    """The asset whose mean vector over three views is most like the crop's; ``no_object`` below `LEAST`.

    Raises:
        InputError: the files of an asset are faulty.
    """
    assets = matchable_assets(library)
    if not assets or not request.segments:
        return MatchResult(
            {segment.id: MatchEvidence(match="no_asset", method="match_clip") for segment in request.segments}
        )
    rng = np.random.default_rng(request.seed)
    views: list[Array] = []  # for each asset the mean vector (D,) of its views on white, of length 1
    for asset in assets:
        pictures: list[Picture] = []
        for view in render_asset_views(library, asset.name, random_view_directions(VIEWS, rng)):
            cover = view.rgba[:, :, 3:].astype(np.float64) / 255
            pictures.append(np.asarray(view.rgba[:, :, :3] * cover + 255 * (1 - cover), np.uint8))
        mean = embedder(pictures).mean(axis=0)
        views.append(np.asarray(mean / max(float(np.linalg.norm(mean)), 1e-12), np.float64))
    crops = embedder([crop_segment(request.frame, segment) for segment in request.segments])
    ranking, names = rank_assets_per_segment(request, library), [asset.name for asset in assets]
    similarities = crops @ np.stack(views).T
    return MatchResult(
        {
            segment.id: _evidence_from_similarity(names, similarity, ranking[segment.id][0])
            for segment, similarity in zip(request.segments, similarities, strict=True)
        }
    )


def crop_segment(frame: RGBDFrame, segment: Segment) -> Picture:
    """The segment's rectangle of the photo with a margin, unmasked."""
    rows, columns = np.nonzero(segment.mask)
    if not len(rows):
        raise InputError(f"candidate {segment.id} has no pixels", "segment the photo again")
    pad = 2 + int(_MARGIN * max(np.ptp(rows), np.ptp(columns)))
    top, left = max(0, int(rows.min()) - pad), max(0, int(columns.min()) - pad)
    return np.ascontiguousarray(frame.rgb[top : int(rows.max()) + pad, left : int(columns.max()) + pad])


def _evidence_from_similarity(names: Sequence[str], similarity: Array, ranked: RankedAssets) -> MatchEvidence:
    """The most similar asset; its confidence comes from the measured features, not from the similarity (A,)."""
    order: list[int] = np.argsort(-similarity, kind="stable")[:TOLD].tolist()
    scores = {names[index]: round(float(similarity[index]), 4) for index in order}
    best, highest = names[order[0]], float(similarity[order[0]])
    others = [name for name in scores if name != best]
    if highest < LEAST:
        reason = f"its picture is {highest:.2f} like {best} at most, below {LEAST}"
        return MatchEvidence(match="no_object", method="match_clip", scores=scores, runner_up=best, reason=reason)
    return MatchEvidence(
        match="asset",
        asset=best,
        method="match_clip",
        confidence=round(ranked.confidence_of(best), 4),
        scores=scores,
        runner_up=others[0] if others else None,
        reason=f"its picture is {highest:.2f} like the asset's views",
    )
