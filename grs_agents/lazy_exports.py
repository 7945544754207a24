"""The doors of rooms: what a package offers is listed in its ``__init__.pyi`` and loaded when it is first used.

So a door costs nothing until one goes through it: ``grs --help`` loads no physics, the sandbox no pictures.
"""

from collections.abc import Callable
from typing import Any, cast

import lazy_loader


def attach_lazy_exports(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """``__getattr__``, ``__dir__`` and ``__all__`` of ``package``, whose ``__init__.py`` is ``file``."""
    return cast(Any, lazy_loader).attach_stub(package, file)
