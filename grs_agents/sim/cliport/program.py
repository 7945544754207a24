"""Finding the task in a simulation program."""

import ast
from types import ModuleType

from grs_agents.sim.cliport.task import Task
from grs_agents.sim.instance.episode import SimulationError


def task_class(module: ModuleType) -> type[Task]:
    """The last ``Task`` subclass that a program defines.

    Raises:
        SimulationError: it defines none.
    """
    found = [
        value for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Task) and value.__module__ == module.__name__
    ]  # fmt: skip
    if not found:
        raise SimulationError(
            f"module {module.__name__} defines no subclass of Task", "define a class that derives from Task"
        )
    return found[-1]


def names_task(tree: ast.Module) -> bool:
    """Whether the source of a program has a class that derives from ``Task``, directly or through others in it.

    This reads the source alone, so that the program cannot change the answer. The class may stand under ``if``,
    ``try`` or ``with``, and ``Task`` may be imported under another name.
    """
    nodes = list(ast.walk(tree))
    imported = {
        alias.asname or alias.name
        for node in nodes
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.name == "Task"
    }
    bases = {node.name: node.bases for node in nodes if isinstance(node, ast.ClassDef)}
    known = imported | ({"Task"} - bases.keys())
    grown = True
    while grown:
        derived = {name for name, parents in bases.items() if any(_is_task(base, known) for base in parents)}
        grown = not derived <= known
        known |= derived
    return bool(known & bases.keys())


def _is_task(base: ast.expr, known: set[str]) -> bool:
    if isinstance(base, ast.Attribute):
        return base.attr == "Task"
    return isinstance(base, ast.Name) and base.id in known
