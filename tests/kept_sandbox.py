"""A sandbox for whatever runs in a test's process: its imports and its probe are paid for once."""

import atexit
import os
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from pathlib import Path

from grs_agents.base import content
from grs_agents.base.config.schema import Config
from grs_agents.runs.sandbox_setup import PRELOAD, TOOLS, open_sandbox
from grs_agents.sandbox.host.sandbox import Sandbox


def lend_sandbox(config: Config) -> AbstractContextManager[Sandbox]:
    """As ``open_sandbox``, but kept for others that want the like; it is closed when the process ends."""
    overlays = content.content_search_roots()[:-1]
    if any((root / kind).is_dir() for root in overlays for kind in ("tools", "assets")):  # it imports tools ahead
        return open_sandbox(config)
    return nullcontext(_keep_sandbox(config.model_dump_json(include={"sandbox", "workers", "limits"})))


@cache
def _keep_sandbox(config: str) -> Sandbox:
    own = Config.model_validate_json(config)
    kept = Sandbox(
        PRELOAD, tools=TOOLS, backend=own.sandbox, workers=own.workers, limits=own.limits, readable=(written_folder(),)
    )
    atexit.register(kept.close)
    return kept


def written_folder() -> Path:
    """The folder below which the tests of a session write: who may read it needs no new sandbox for each of them."""
    return Path(os.environ["XDG_CACHE_HOME"]).parent
