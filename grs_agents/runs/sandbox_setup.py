"""The sandbox of a run, as its configuration wants it."""

from grs_agents.base.config.schema import Config
from grs_agents.sandbox.host.sandbox import Sandbox

PRELOAD = ("grs_agents.sim:prepare_process", "grs_agents.toolkit", "unittest", "numpy.testing", "numpy.ma")
TOOLS = ("run_tests", "probe_tests", "instantiate", "rollout", "render")
"""What the sandbox imports before it sees generated code."""


def open_sandbox(config: Config) -> Sandbox:
    """A sandbox with the simulation imported ahead; close it after use."""
    return Sandbox(PRELOAD, tools=TOOLS, backend=config.sandbox, workers=config.workers, limits=config.limits)
