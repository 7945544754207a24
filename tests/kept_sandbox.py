"""Sandboxes for whatever runs in a test's process: their imports and their probes are paid for once."""

import atexit
import os
from collections.abc import Generator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache
from pathlib import Path
from unittest.mock import patch

from grs_agents.base import content
from grs_agents.base.config.schema import Config, Limits
from grs_agents.runs.sandbox_setup import PRELOAD, TOOLS, open_sandbox
from grs_agents.sandbox.host.foreign_reader import READING, ForeignReader
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sandbox.host.zygote_process import Zygote, ZygoteSpec
from grs_agents.sandbox.isolation.allowlist import is_path_covered
from grs_agents.sandbox.isolation.backends import Backend


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


class LentReader(ForeignReader):
    """A ``ForeignReader`` whose zygote is kept for others of its kind: it may read all that the session's tests write,
    and nothing else. Files elsewhere, and what is to be written, take a zygote of their own."""

    def __init__(
        self,
        module: str,
        readable: Sequence[Path],
        limits: Limits = READING,
        writable: Sequence[Path] = (),
        workers: int = 1,
    ) -> None:
        super().__init__(module, readable, limits, writable, workers)
        self._is_kept = not writable and all(is_path_covered(path.absolute(), [written_folder()]) for path in readable)
        if self._is_kept:
            self._sandbox = _keep_reading_sandbox(module, limits.model_dump_json(), workers)

    def close(self) -> None:
        if not self._is_kept:
            super().close()


@cache
def _keep_reading_sandbox(module: str, limits: str, workers: int) -> Sandbox:
    kept = Sandbox((module,), limits=Limits.model_validate_json(limits), workers=workers, readable=(written_folder(),))
    atexit.register(kept.close)
    return kept


@contextmanager
def note_preloads() -> Generator[list[tuple[str, ...]]]:
    """The modules that each zygote which is started meanwhile imports ahead of its calls."""
    preloads: list[tuple[str, ...]] = []

    class NotedZygote(Zygote):
        def __init__(self, backend: Backend, spec: ZygoteSpec) -> None:
            preloads.append(spec.preload)
            super().__init__(backend, spec)

    with patch("grs_agents.sandbox.host.sandbox.Zygote", NotedZygote):
        yield preloads


def written_folder() -> Path:
    """The folder below which the tests of a session write: who may read it needs no new sandbox for each of them."""
    return Path(os.environ["XDG_CACHE_HOME"]).parent
