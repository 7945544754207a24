"""CLIPort's and PyBullet's import lines, answered by this runtime: programs written for them run unchanged.

Switched on by the sandbox worker alone, with ``install()``. The real packages are never imported, installed or not.
"""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any, Final

from grs_agents.sim.cliport import end_effectors, pybullet, utils
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.cliport.task import PublishedTask

PACKAGES: Final = ("cliport", "pybullet", "pybullet_utils", "pybullet_data")


def install() -> None:
    """Let ``import cliport...`` and ``import pybullet`` reach this runtime's objects in this process."""
    if any(isinstance(finder, _Refusal) for finder in sys.meta_path):
        return
    for name in [name for name in sys.modules if name.split(".")[0] in PACKAGES]:
        del sys.modules[name]
    modules = _build_replacement_modules()
    sys.modules.update(modules)
    for name, module in modules.items():
        parent, _, child = name.rpartition(".")
        if parent:
            setattr(modules[parent], child, module)
    sys.meta_path.insert(0, _Refusal(tuple(sorted(modules))))


def _build_replacement_modules() -> dict[str, ModuleType]:
    grippers = {"Suction": end_effectors.Suction, "Spatula": end_effectors.Spatula}
    primitives = {"PickPlace": end_effectors.PickPlace, "push": end_effectors.push}
    return {
        "IPython": _make_module("IPython", embed=_do_nothing),
        "cliport": _make_module("cliport"),
        "cliport.tasks": _make_module("cliport.tasks", Task=PublishedTask),
        "cliport.tasks.task": _make_module("cliport.tasks.task", Task=PublishedTask),
        "cliport.tasks.primitives": _make_module("cliport.tasks.primitives", **primitives),
        "cliport.tasks.grippers": _make_module("cliport.tasks.grippers", **grippers),
        "cliport.utils": _make_module("cliport.utils"),
        "cliport.utils.utils": utils,
        "cliport.environments": _make_module("cliport.environments"),
        "cliport.environments.environment": _make_module("cliport.environments.environment", Environment=Environment),
        "pybullet": pybullet,
    }


def _do_nothing(*_: Any, **__: Any) -> None:
    """``IPython.embed``: published programs import it and leave no call of it behind."""


def _make_module(name: str, **names: Any) -> ModuleType:
    module = ModuleType(name, "Answered by grs_agents.sim.")
    module.__path__ = []
    vars(module).update(names)
    return module


class _Refusal(MetaPathFinder):
    """Stands first in line, so that what is not answered is refused rather than found on the user's disk."""

    def __init__(self, answered: tuple[str, ...]) -> None:
        self.answered = answered

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """None for other packages; raises ``ModuleNotFoundError`` for what this runtime does not answer of these."""
        del path, target
        if fullname.split(".", maxsplit=1)[0] not in PACKAGES:
            return None
        raise ModuleNotFoundError(
            f"there is no {fullname} in this simulation; there are {', '.join(self.answered)}", name=fullname
        )
