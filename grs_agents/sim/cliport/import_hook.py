"""Import hook: this runtime stands in for CLIPort, PyBullet and transforms3d, so that their programs run unchanged.

Switched on by the sandbox worker alone, with ``install()``. The real packages are never imported, installed or not.
"""

import os
import random
import sys
from collections.abc import Callable, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any, Final, cast

from grs_agents.sim.cliport import end_effectors, lohoravens, pybullet, rotations, utils
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.cliport.task import PublishedTask
from grs_agents.sim.instance.episode import UnsupportedError
from grs_agents.sim.world import templates

PACKAGES: Final = ("cliport", "pybullet", "pybullet_utils", "pybullet_data", "transforms3d")
BUILT_IN: Final = (
    *("align_box_corner", "align_rope", "assembling_kits", "assembling_kits_seq", "block_insertion"),
    *("manipulating_rope", "packing_boxes", "packing_boxes_pairs", "packing_google_objects", "packing_shapes"),
    *("palletizing_boxes", "place_red_in_green", "put_block_in_bowl", "separating_piles", "stack_block_pyramid"),
    *("stack_block_pyramid_seq", "sweeping_piles", "towers_of_hanoi", "towers_of_hanoi_seq"),
)
"""Modules of ``cliport.tasks``, each with a published task."""


def install() -> None:
    """Let imports of ``PACKAGES`` reach this runtime's objects in this process."""
    if any(isinstance(finder, _UnknownModuleRefuser) for finder in sys.meta_path):
        return
    for name in [name for name in sys.modules if name.split(".")[0] in PACKAGES]:
        del sys.modules[name]
    grippers = {"Suction": end_effectors.Suction, "Spatula": end_effectors.Spatula}
    primitives = {"PickPlace": end_effectors.PickPlace, "push": end_effectors.push}
    colors = {"COLOR_CATEGORY_NAMES": lohoravens.COLOR_CATEGORY_NAMES}
    modules: dict[str, ModuleType] = {
        "IPython": _make_module("IPython", embed=_do_nothing),
        "cliport": _make_module("cliport"),
        "cliport.tasks": _make_module("cliport.tasks", Task=PublishedTask),
        "cliport.tasks.task": _make_module("cliport.tasks.task", Task=PublishedTask),
        "cliport.tasks.primitives": _make_module("cliport.tasks.primitives", **primitives),
        "cliport.tasks.grippers": _make_module("cliport.tasks.grippers", **grippers),
        "cliport.tasks.color_reasoning": _make_module("cliport.tasks.color_reasoning", **colors),
        "cliport.utils": _make_module("cliport.utils"),
        "cliport.utils.utils": utils,
        "cliport.environments": _make_module("cliport.environments"),
        "cliport.environments.environment": _make_module("cliport.environments.environment", Environment=Environment),
        "pybullet": pybullet,
        "pybullet_utils": _make_module("pybullet_utils"),
        "transforms3d": _make_module("transforms3d"),
        **{name: _make_module(name, **functions) for name, functions in _group_rotation_functions().items()},
        **{f"cliport.tasks.{name}": _make_published_task_module(f"cliport.tasks.{name}") for name in BUILT_IN},
    }
    sys.modules.update(modules)
    for name, module in modules.items():
        parent, _, child = name.rpartition(".")
        if parent:
            setattr(modules[parent], child, module)
    sys.meta_path.insert(0, _UnknownModuleRefuser(tuple(sorted(modules))))
    remove, sample = os.remove, cast("Callable[..., list[Any]]", random.sample)

    def remove_unless_template(path: Any, *more: Any, **options: Any) -> None:
        """Ignore filled templates, which are files in CLIPort and none here."""
        if not isinstance(path, str) or templates.find_filling_by_name(path) is None:
            remove(path, *more, **options)

    def sample_in_order(population: Any, *more: Any, **options: Any) -> list[Any]:
        """Take sets, as until Python 3.10; published programs draw colours from them."""
        members: Any = cast(set[Any], population) if isinstance(population, set | frozenset) else None
        return sample(population if members is None else sorted(members, key=repr), *more, **options)

    os.remove, random.sample = remove_unless_template, sample_in_order


def _group_rotation_functions() -> dict[str, dict[str, Callable[..., Any]]]:
    """Functions of each supported module of ``transforms3d``."""
    conversions = "euler2mat mat2euler euler2quat quat2euler euler2axangle axangle2euler"
    names = {
        "euler": conversions,
        "quaternions": "axangle2quat quat2axangle quat2mat mat2quat fillpositive qmult qconjugate qnorm qisunit "
        "qinverse qeye qexp qlog qpow rotate_vector nearly_equivalent",
        "axangles": "axangle2mat mat2axangle axangle2aff aff2axangle",
        "affines": "compose decompose",
        "utils": "normalized_vector vector_norm",
    }
    groups = {
        f"transforms3d.{module}": {name: getattr(rotations, name) for name in listed.split()}
        for module, listed in names.items()
    }
    groups["transforms3d.affines"]["decompose44"] = rotations.decompose
    groups["transforms3d.taitbryan"] = {
        name: rotations.tait_bryan(getattr(rotations, name)) for name in conversions.split()
    }
    return groups


def _do_nothing(*_: Any, **__: Any) -> None:
    """``IPython.embed``: published programs import it and leave no call of it behind."""


def _make_published_task_module(module: str) -> ModuleType:
    """A module whose classes can be imported but not run, since the published tasks themselves are not here."""

    def reset(self: Any, env: Any) -> None:
        found = f"{type(self).__name__} is a task of {module}, whose program is not part of this simulation"
        raise UnsupportedError(found, "give its source as a program of its own, or derive from Task")

    def make_task_class(name: str) -> type[PublishedTask]:
        if not name[0].isupper() or name.isupper():
            raise AttributeError(f"{module} has no {name} in this simulation")
        return type(name, (PublishedTask,), {"reset": reset, "__module__": module})

    return _make_module(module, __getattr__=make_task_class)


def _make_module(name: str, **names: Any) -> ModuleType:
    module = ModuleType(name, "Answered by grs_agents.sim.")
    module.__path__ = []
    vars(module).update(names)
    return module


class _UnknownModuleRefuser(MetaPathFinder):
    """First finder of the import system: refuses unsupported modules rather than finding them on the user's disk."""

    def __init__(self, answered: tuple[str, ...]) -> None:
        self.answered = answered

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """None for other packages; raises ``ModuleNotFoundError`` for unsupported modules of ``PACKAGES``."""
        del path, target
        if fullname.split(".", maxsplit=1)[0] not in PACKAGES:
            return None
        raise ModuleNotFoundError(
            f"there is no {fullname} in this simulation; there are {', '.join(self.answered)}", name=fullname
        )
