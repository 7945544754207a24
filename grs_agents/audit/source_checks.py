"""Checks of a program's source without its task: imports, names, calls of the documented API."""

import ast
import builtins
import importlib.util
import inspect
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from grs_agents import sim
from grs_agents.audit.types import ProgramKind, StaticFinding, StaticFindingKind
from grs_agents.sandbox.host.suite_discovery import parse_program

Node = TypeVar("Node", bound=ast.AST)
_REFUSED_PACKAGES = frozenset({"ctypes", "multiprocessing", "requests", "socket", "subprocess"})
_ANSWERED_PACKAGES = frozenset(
    {"IPython", "cliport", "pybullet", "pybullet_data", "pybullet_utils", "task_code", "transforms3d"}
)
"""Packages that the sandbox provides."""
_API: dict[str, Callable[..., Any]] = {
    **{
        name: getattr(sim.Task, name)
        for name in ("add_goal", "get_random_pose", "get_random_size", "fill_template", "make_ropes", "oracle")
    },
    **{
        name: getattr(sim.Environment, name)
        for name in ("add_object", "get_object_pose", "get_object_size", "set_color", "set_task", "reset", "step")
    },
    **{name: getattr(sim, name) for name in ("inside", "on", "stacked", "near", "aligned", "upright", "in_zone")},
}
"""Documented calls by name: methods whose names say whose they are, and functions to import."""
_ONLY_OF_ENVIRONMENT = frozenset({"reset", "step"})
"""Methods that other objects have too: checked only if the receiver is called ``env``."""


@dataclass(frozen=True)
class ProgramSource:
    """A program as a syntax tree."""

    program: ProgramKind
    tree: ast.Module

    def finding(self, line: int, kind: StaticFindingKind, message: str) -> StaticFinding:
        """A finding that blames this program."""
        return StaticFinding(program=self.program, line=line, kind=kind, message=message)

    @cached_property
    def nodes(self) -> list[ast.AST]:
        """Every node of the tree."""
        return list(ast.walk(self.tree))

    def nodes_of_type(self, kind: type[Node]) -> list[Node]:
        """The nodes of this type."""
        return [node for node in self.nodes if isinstance(node, kind)]

    @cached_property
    def imported_names(self) -> frozenset[str]:
        """Names imported from the runtime without an alias and assigned nowhere."""
        froms = [node for node in self.nodes_of_type(ast.ImportFrom) if node.module == sim.__name__]
        stored = {node.id for node in self.nodes_of_type(ast.Name) if not isinstance(node.ctx, ast.Load)}
        return frozenset(alias.name for node in froms for alias in node.names if not alias.asname) - stored

    @cached_property
    def bound_names(self) -> frozenset[str]:
        """Every name that is defined, imported or assigned anywhere, including attributes and arguments."""
        names: set[str] = set()
        for node in self.nodes:
            if isinstance(node, ast.alias):
                names |= {(node.asname or node.name).split(".")[0]}
            elif isinstance(node, ast.Name | ast.Attribute) and not isinstance(node.ctx, ast.Load):
                names |= {node.id if isinstance(node, ast.Name) else node.attr}
            elif not isinstance(node, ast.Name | ast.Attribute | ast.keyword):
                names |= {str(getattr(node, key)) for key in ("name", "arg", "rest") if getattr(node, key, None)}
                names |= set(getattr(node, "names", ())) if isinstance(node, ast.Global) else set()
        return frozenset(names)


def read_source(program: ProgramKind, text: str) -> ProgramSource | StaticFinding:
    """The program as a tree, or the finding that it is not Python. Nothing of it is executed."""
    try:
        with warnings.catch_warnings(action="ignore"):
            tree = parse_program(text, f"the {program} program")
            compile(tree, "<program>", "exec", dont_inherit=True)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line, message = getattr(error, "lineno", None) or 1, getattr(error, "msg", None) or str(error)
        return StaticFinding(program=program, line=line, kind="syntax", message=message or type(error).__name__)
    return ProgramSource(program, tree)


def check_source(source: ProgramSource) -> Iterator[StaticFinding]:
    """Faults of a program that do not depend on its task."""
    guarded = {node for part in source.nodes_of_type(ast.Try) for node in ast.walk(part)}
    imported = [(node, alias.name, alias.name) for node in source.nodes_of_type(ast.Import) for alias in node.names]
    imported += [
        (node, node.module or "", alias.name) for node in source.nodes_of_type(ast.ImportFrom) for alias in node.names
    ]
    for node, module, name in imported:
        package = module.split(".", maxsplit=1)[0]
        if node in guarded:
            continue
        if package in _REFUSED_PACKAGES:
            problem = f"the sandbox does not let a program use {package}"
        elif not package:
            problem = "a relative import, in a program that is no part of a package"
        elif module == sim.__name__ and name not in ("*", module) and not hasattr(sim, name):
            problem = f"{module} has no {name}{suggest_nearest_name(name, dir(sim))}"
        elif package not in _ANSWERED_PACKAGES and importlib.util.find_spec(package) is None:
            problem = f"there is no module {package} in the sandbox"
        else:
            continue
        yield source.finding(node.lineno, "import", problem)
    read = {node.id: node.lineno for node in reversed(source.nodes_of_type(ast.Name))}
    # Skipped if names may be bound in ways that the source hides.
    unknowable = {"*", "annotations"} & source.bound_names
    unknowable |= {"globals", "locals", "exec", "eval", "NameError"} & read.keys()
    known = {*source.bound_names, *dir(builtins), "__file__"}
    for name in sorted(read.keys() - known) if not unknowable else ():
        meant = _find_missing_import(name, source) or suggest_nearest_name(name, known)
        yield source.finding(read[name], "unknown_name", f"{name} is not defined{meant}")
    for call in source.nodes_of_type(ast.Call):
        name = _get_called_name(call)
        exists = name in source.bound_names or hasattr(sim.Environment, name)
        if _get_receiver_name(call) == "env" and not exists:
            text = f"env has no method {name}{suggest_nearest_name(name, dir(sim.Environment))}"
            yield source.finding(call.lineno, "unknown_name", text)
        yield from _check_arguments(source, call)
    for attribute in source.nodes_of_type(ast.Attribute):
        owner = attribute.value.id if isinstance(attribute.value, ast.Name) else ""
        module = sim.utils if owner == "utils" and owner in source.imported_names else np if owner == "np" else None
        with warnings.catch_warnings(action="ignore"):
            missing = module is not None and not hasattr(module, attribute.attr)
        if missing:
            text = f"{owner} has no {attribute.attr}{suggest_nearest_name(attribute.attr, dir(module))}"
            yield source.finding(attribute.lineno, "unknown_name", text)
    for loop in source.nodes_of_type(ast.While):
        leaving = ast.Break | ast.Return | ast.Raise | ast.Yield | ast.Assert
        left = any(isinstance(inner, leaving) or _get_called_name(inner) == "exit" for inner in ast.walk(loop))
        if isinstance(loop.test, ast.Constant) and loop.test.value and not left:
            yield source.finding(loop.lineno, "endless_loop", "nothing leaves this while loop")


def _find_missing_import(name: str, source: ProgramSource) -> str:
    """A clause with the import that binds a name; empty for a name that no import is known for."""
    line = "import numpy as np" if name == "np" else ""
    modules = {node.value.id for node in source.nodes_of_type(ast.Attribute) if isinstance(node.value, ast.Name)}
    if name in sim.__all__:
        line = f"from {sim.__name__} import {name}"
    elif name in modules and name in ("numpy", *sys.stdlib_module_names):
        line = f"import {name}"
    return f"; `{line}` is missing" if line else ""


def suggest_nearest_name(name: str, known: Iterable[str]) -> str:
    """A clause with the nearest of the known names; empty if none is near."""
    near = get_close_matches(name, sorted(set(known) - {name}), n=1, cutoff=0.65)
    return f"; did you mean {near[0]}" if near else ""


def _check_arguments(source: ProgramSource, call: ast.Call) -> Iterator[StaticFinding]:
    """Check the arguments of a call of the documented API; a call that unpacks, or of an uncertain function, passes."""
    name, receiver = _get_called_name(call), _get_receiver_name(call)
    function = _API.get(name)
    if isinstance(call.func, ast.Name):
        if name not in source.imported_names or _takes_self_argument(function):
            return
    elif receiver == "utils" and inspect.isfunction(getattr(sim.utils, name, None)):
        function = getattr(sim.utils, name)
    else:
        ambiguous = name in source.bound_names or (name in _ONLY_OF_ENVIRONMENT and receiver != "env")
        if ambiguous or receiver[:1].isupper() or not _takes_self_argument(function):
            return
    given = [word.arg or "**" for word in call.keywords]
    if function is None or "**" in given or any(isinstance(part, ast.Starred) for part in call.args):
        return
    signature = inspect.signature(function)
    shown = {word for word in signature.parameters if not word.startswith("_")} - {"self"}
    for word in sorted(set(given) - shown):
        text = f"{name} has no argument {word}{suggest_nearest_name(word, shown)}"
        yield source.finding(call.lineno, "unknown_argument", text)
    try:
        positional = [None] * (len(call.args) + ("self" in signature.parameters))
        signature.bind(*positional, **dict.fromkeys(shown & set(given)))
    except TypeError as error:
        yield source.finding(call.lineno, "wrong_arguments", f"{name}: {error}")


def _takes_self_argument(function: Callable[..., Any] | None) -> bool:
    return function is not None and "self" in inspect.signature(function).parameters


def _get_called_name(node: ast.AST) -> str:
    """The last part of the name of the called function; empty for any other node."""
    function = getattr(node, "func", None)
    return str(getattr(function, "attr", getattr(function, "id", "")))


def _get_receiver_name(call: ast.Call) -> str:
    """The last part of the name whose method is called, e.g. ``env`` in ``self.env.step``."""
    receiver = getattr(call.func, "value", None)
    return str(getattr(receiver, "attr", getattr(receiver, "id", "")))
