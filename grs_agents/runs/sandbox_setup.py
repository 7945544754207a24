"""The sandbox of a run."""

from grs_agents.base.config.schema import Config
from grs_agents.sandbox.host.sandbox import Sandbox

PRELOAD = ("grs_agents.sim:prepare_process", "grs_agents.toolkit", "unittest", "numpy.testing", "numpy.ma")
TOOLS = ("run_tests", "probe_tests", "instantiate", "rollout", "render")
"""Modules imported and tools offered by the sandbox before it runs generated code."""


def open_sandbox(config: Config) -> Sandbox:
    """Open a sandbox with the simulation preloaded; close it after use."""
    return Sandbox(PRELOAD, tools=TOOLS, backend=config.sandbox, workers=config.workers, limits=config.limits)
