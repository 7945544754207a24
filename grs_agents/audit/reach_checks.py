"""Where a program reaches into what runs and measures it, as its source shows: no task and no test needs that.

Code in one interpreter can still hide such a reach with enough effort; what is plain is named here.
"""

import ast
from collections.abc import Iterator
from typing import Final

from grs_agents import sim
from grs_agents.audit.source_checks import ProgramSource

# fmt: off
_MODULES: Final = {
    "_thread", "atexit", "builtins", "ctypes", "dis", "faulthandler", "gc", "importlib", "inspect", "marshal",
    "mmap", "multiprocessing", "pickle", "pkgutil", "resource", "runpy", "shelve", "signal", "socket", "sqlite3",
    "subprocess", "tempfile", "threading", "tracemalloc", "types", "weakref",
}
"""Modules that show or change an interpreter, or keep something from one run to the next."""
_NAMES: Final = {
    "witness", "Probe", "EpisodeMemory", "EpisodeReplay", "RememberingOracle", "set_environment_defaults",
    "reset_before_test", "_getframe", "_current_frames", "f_back", "f_locals", "f_globals", "gi_frame", "tb_frame",
    "tb_next", "__globals__", "__subclasses__", "__builtins__", "__dict__", "__mro__", "modules", "settrace",
    "setprofile", "_exit", "mj_step", "attrgetter", "methodcaller", "__getattribute__",
}
# fmt: on
"""Names that lead there."""
_CALLED: Final = frozenset({"exec", "eval", "compile", "__import__", "globals", "vars", "open"})


def find_runtime_accesses(source: ProgramSource) -> Iterator[tuple[int, str]]:
    """What reaches out of a program, with the line."""
    imported = {
        alias.asname or alias.name.split(".")[0]
        for node in source.nodes
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    for node in source.nodes:
        if reach := _describe_runtime_access(node, imported):
            yield getattr(node, "lineno", 1), reach


def _describe_runtime_access(node: ast.AST, imported: set[str]) -> str:
    if isinstance(node, ast.Import | ast.ImportFrom):
        return _describe_forbidden_import(node)
    name = _attribute_name_or_text(node)
    if name in _NAMES:
        return f"{name} leads to what runs and measures it"
    if isinstance(node, ast.Call) and (called := _describe_forbidden_call(node)):
        return called
    stored = isinstance(node, ast.Attribute | ast.Subscript) and not isinstance(node.ctx, ast.Load)
    root = _root_variable_name(node) if stored else ""
    return f"it changes {root}, which is not its own" if root in imported else ""


def _attribute_name_or_text(node: ast.AST) -> str:
    """The name of an attribute, or a constant text; "" for anything else."""
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def _describe_forbidden_call(call: ast.Call) -> str:
    name = call.func.id if isinstance(call.func, ast.Name) else ""
    if name == "getattr" and len(call.args) > 1 and not isinstance(call.args[1], ast.Constant):
        return "it calls getattr with a name that it computes"
    return f"it calls {name}" if name in _CALLED else ""


def _describe_forbidden_import(node: ast.Import | ast.ImportFrom) -> str:
    modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""]
    for name in modules:
        inner = name.startswith("grs_agents") and name not in ("grs_agents", sim.__name__)
        if inner or name.split(".")[0] in _MODULES:
            return f"it imports {name}"
    taken = {alias.name for alias in node.names} if isinstance(node, ast.ImportFrom) else set[str]()
    rooms = {"sandbox", "nodes", "audit", "run"} if modules == ["grs_agents"] else set[str]()
    hidden = sorted(taken & (_NAMES | _MODULES | rooms))
    return f"it imports {hidden[0]}" if hidden else ""


def _root_variable_name(node: ast.AST) -> str:
    """The name at the beginning of ``a.b[c].d``."""
    while isinstance(node, ast.Attribute | ast.Subscript):
        node = node.value
    return node.id if isinstance(node, ast.Name) else ""
