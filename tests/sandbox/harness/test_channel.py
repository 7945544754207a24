"""Only a worker can report progress."""

import pytest

from grs_agents.base.errors import GrsError
from grs_agents.sandbox.harness.channel import report_progress


def test_the_host_is_told_to_use_the_sandbox() -> None:
    with pytest.raises(GrsError, match=r"Sandbox\.call"):
        report_progress({"x": 1})
