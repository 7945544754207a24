"""Pictures without GL."""

from pathlib import Path

import cv2
import pytest

from grs_agents.toolkit import ToolContext, load_tool


@pytest.mark.parametrize("moment", ["start", "end"])
def test_a_task_is_drawn(context: ToolContext, simulation: str, tmp_path: Path, moment: str) -> None:
    made = load_tool("instantiate")
    instance = made.run(made.Request(simulation=simulation, seeds=(0,)), context).instances[0]
    tool = load_tool("render")
    file = tmp_path / "scene.png"
    request = tool.Request(instance=instance, output=str(file), moment=moment, width=160, height=120)
    result = tool.run(request, context)
    assert result.error == ""
    image = cv2.imread(str(file))
    assert image is not None and image.shape == (120, 160, 3)
    assert image.std() > 5
