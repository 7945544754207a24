"""The default depth tool makes no depth up."""

import numpy as np
import pytest

from grs_agents.base import content
from grs_agents.base.errors import InputError
from grs_agents.toolkit import ToolContext


def test_a_photo_without_depth_is_refused_with_what_to_do(context: ToolContext) -> None:
    tool = content.load_module("tools", "depth_given")
    request = tool.Request(rgb=np.zeros((9, 9, 3), np.uint8), focal=None, photo="table.jpg", model=None)
    with pytest.raises(InputError, match=r"table\.jpg has no depth; .*tools\.depth=depth_transformers"):
        tool.run(request, context)
