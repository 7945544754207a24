"""Given masks become candidates without a search for them."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from grs_agents.base import content
from grs_agents.base.errors import InputError
from grs_agents.perception.reading.scene_source import read_scene
from grs_agents.perception.table_finding import find_table
from grs_agents.toolkit import ToolContext
from tests.pictures import read_picture


def test_the_labels_of_the_sample_scene_are_its_candidates(sample_scene: Path, context: ToolContext) -> None:
    tool = content.load_module("tools", "segment_masks")
    frame = read_scene(sample_scene)
    labels = read_picture(sample_scene / "labels.png")
    request = tool.Request(frame=frame, table=find_table(frame, np.random.default_rng(0)))
    candidates = tool.run(request, context).candidates
    assert len(candidates) == len(np.unique(labels)) - 1
    for one in candidates:
        assert len(np.unique(labels[one.mask])) == 1


def test_names_of_annotations_are_noted(sample_scene: Path, tmp_path: Path, context: ToolContext) -> None:
    scene = tmp_path / "scene"
    shutil.copytree(sample_scene, scene, ignore=shutil.ignore_patterns("labels.png"))
    labels = read_picture(sample_scene / "labels.png")
    rows, columns = labels.shape
    wanted = [int(label) for label in np.unique(labels)[1:3]]
    annotations: list[dict[str, object]] = []
    for label in wanted:
        edges = np.flatnonzero(np.diff((labels == label).ravel(order="F").astype(np.int8), prepend=0))
        runs = np.diff(edges, prepend=0, append=labels.size).tolist()
        outline = {"size": [rows, columns], "counts": runs}
        annotations.append({"image_id": 1, "category_id": label, "segmentation": outline})
    categories = [{"id": label, "name": f"thing {label}"} for label in wanted]
    images = [{"id": 1, "file_name": "rgb.png", "height": rows, "width": columns}]
    values = {"images": images, "annotations": annotations, "categories": categories}
    (scene / "annotations.json").write_text(json.dumps(values))
    tool = content.load_module("tools", "segment_masks")
    frame = read_scene(scene)
    result = tool.run(tool.Request(frame=frame, table=find_table(frame, np.random.default_rng(0))), context)
    seen = ", ".join(f"{item.id} is 'thing {labels[item.mask].max()}'" for item in result.candidates)
    assert result.notes == (f"names of the masks: object {seen}",)
    for item in result.candidates:
        assert item.label == f"thing {labels[item.mask].max()}"


def test_a_scene_without_masks_is_refused(sample_scene: Path, tmp_path: Path, context: ToolContext) -> None:
    scene = tmp_path / "scene"
    shutil.copytree(sample_scene, scene, ignore=shutil.ignore_patterns("labels.png"))
    tool = content.load_module("tools", "segment_masks")
    frame = read_scene(scene)
    with pytest.raises(InputError, match="no masks"):
        tool.run(tool.Request(frame=frame, table=find_table(frame, np.random.default_rng(0))), context)
