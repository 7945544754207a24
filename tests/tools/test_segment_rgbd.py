"""The segmentation tool, as comprehension calls it."""

from pathlib import Path

import numpy as np

from grs_agents.base import content
from grs_agents.perception.reading.scene_source import read_scene
from grs_agents.perception.table_finding import find_table
from grs_agents.toolkit import ToolContext


def test_the_sample_scene_gives_its_candidates(sample_scene: Path, context: ToolContext) -> None:
    tool = content.load_module("tools", "segment_rgbd")
    frame = read_scene(sample_scene)
    request = tool.Request(frame=frame, table=find_table(frame, np.random.default_rng(0)))
    candidates = tool.run(request, context).candidates
    assert [one.id for one in candidates] == list(range(1, 12))
    assert sum(one.hollow for one in candidates) == 2
    total = np.sum([one.mask for one in candidates], axis=0)
    assert total.max() == 1
