"""Which episode a test shows that ran none of its own: that of its class's fixture, else that of its module's."""

from collections.abc import Callable
from types import ModuleType
from typing import Any
from unittest import TestCase

Episode = dict[str, Any]


class FixtureEpisodes:
    """Keeps what fixtures ran apart from what tests run; ``take`` gives the last episode, once."""

    def __init__(self, take: Callable[[], Episode | None]) -> None:
        self._take = take
        self._module: Episode | None = None
        self._classes: dict[type, Episode] = {}

    def watch_module(self, tests: ModuleType) -> None:
        """See what ``setUpModule`` of the tests runs."""
        own: Any = getattr(tests, "setUpModule", None)

        def set_up_module() -> None:
            try:
                own()
            finally:
                self._module = self._take()

        if callable(own):
            vars(tests)["setUpModule"] = set_up_module

    def begin_test(self, kind: type[TestCase]) -> None:
        """A test of a class begins: what ran since the last one is of ``setUpClass``, if the class has its own."""
        episode = self._take()
        own = getattr(kind.setUpClass, "__func__", None) is not getattr(TestCase.setUpClass, "__func__", None)
        if episode is not None and own:
            self._classes[kind] = episode

    def find_episode_fields(self, kind: type | None) -> dict[str, Any]:
        """The fields ``episode`` and ``episode_hook`` of a test of a class, None: of a fixture that failed."""
        own = self._take()
        if own is not None:
            return {"episode": own, "episode_hook": "test" if kind else "setUpClass"}
        if kind in self._classes:
            return {"episode": self._classes[kind], "episode_hook": "setUpClass"}
        return {"episode": self._module, "episode_hook": "setUpModule" if self._module else ""}
