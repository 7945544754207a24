"""Whether a simulation program draws from its seed alone, and leaves to the runtime what measures and answers.

What two processes draw alike may still depend on the hour, the machine or a rare chance, which the source shows.
"""

import ast
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from grs_agents import sim
from grs_agents.audit.source_checks import ProgramSource, read_source
from grs_agents.audit.types import Finding

_MODULES: Final = frozenset(
    [
        "time",
        "datetime",
        "uuid",
        "secrets",
        "platform",
        "getpass",
        "glob",
        "fileinput",
        "linecache",
        "io",
        "shutil",
        "locale",
        "calendar",
    ]
)
"""Modules whose answers depend on the moment, the machine or its files."""
_HARMLESS: Final[Mapping[str, frozenset[str]]] = {
    "os": frozenset({"path", "sep", "linesep"}),
    "os.path": frozenset({"join", "basename", "dirname", "splitext", "normpath"}),
    "sys": frozenset({"maxsize", "float_info", "version_info"}),
}
"""And what of others does not."""
_NAMES: Final = frozenset(
    {
        *("SystemRandom", "urandom", "datetime64", "fromfile", "loadtxt", "genfromtxt", "memmap", "read_text"),
        *("read_bytes", "iterdir", "getpid", "environ", "getenv", "perf_counter", "monotonic", "time_ns", "utcnow"),
    }
)
_GENERATORS: Final = frozenset({"default_rng", "RandomState", "SeedSequence", "Random", "PCG64", "MT19937", "Philox"})
"""What draws from the machine where it is given no seed; ``seed`` does so too."""
_OWN: Final = frozenset({"reset", "additional_reset"})
"""Methods of a task that programs write."""
_ANSWERS: Final = frozenset(
    name
    for name in dir(sim.Task)
    if not name.startswith("_") and callable(getattr(sim.Task, name)) and name not in _OWN
)
_ANSWERS_OF_ENVIRONMENT: Final = frozenset(
    name
    for name in dir(sim.Environment)
    if not name.startswith("_") and isinstance(getattr(sim.Environment, name), property | type(len) | type(read_source))
)
_RUNTIME: Final = frozenset({"Environment", "Oracle", "PushOracle"})


def check_program(simulation: str) -> Finding:
    """The finding ``plain_program``."""
    source = read_source("simulation", simulation)
    told = (
        [(source.line, source.message)]
        if not isinstance(source, ProgramSource)
        else [*_find_seed_and_override_faults(source)]
    )
    faults = [f"line {line}: {fault}" for line, fault in sorted(told)]
    bound = "a program must draw from the seed alone, and override no more than __init__, reset and additional_reset"
    otherwise = "it draws from nothing but the seed, and overrides nothing else"
    return Finding.from_fault_list("plain_program", faults, otherwise, bound)


def _find_seed_and_override_faults(source: ProgramSource) -> Iterator[tuple[int, str]]:
    aliases = _map_aliases_to_modules(source)
    for node in source.nodes:
        if fault := _describe_dependence_beyond_seed(node, aliases) or _describe_runtime_override(node):
            yield getattr(node, "lineno", 1), fault
    for node in source.nodes_of_type(ast.ClassDef):
        yield from _find_overriding_members(node)


def _map_aliases_to_modules(source: ProgramSource) -> dict[str, str]:
    """The modules that names mean."""
    return {
        alias.asname or alias.name.split(".")[0]: alias.name if alias.asname else alias.name.split(".")[0]
        for node in source.nodes_of_type(ast.Import)
        for alias in node.names
    }


def _describe_dependence_beyond_seed(node: ast.AST, aliases: Mapping[str, str]) -> str:
    """What else than the seed a node draws from."""
    match node:
        case ast.ImportFrom():
            told = _describe_nonseed_import(node)
        case ast.Name(ctx=ast.Load()) if node.id in ("id", "hash") or aliases.get(node.id) in _MODULES:
            told = f"{node.id} tells something else than the seed"
        case ast.Call():
            told = _describe_unseeded_generator(node)
        case ast.Attribute():
            owner = ast.unparse(node.value)
            allowed = _HARMLESS.get(aliases.get(owner, owner), frozenset({node.attr}))
            other = node.attr in _NAMES or node.attr not in allowed
            told = f"{owner}.{node.attr} tells something else than the seed" if other else ""
        case _:
            told = ""
    return told


def _describe_nonseed_import(node: ast.ImportFrom) -> str:
    module, taken = node.module or "", {alias.name for alias in node.names}
    other = taken & _NAMES or taken - _HARMLESS.get(module, frozenset(taken))
    return f"it takes {min(taken)} from {module}" if module in _MODULES or other else ""


def _describe_unseeded_generator(call: ast.Call) -> str:
    name = str(getattr(call.func, "attr", getattr(call.func, "id", "")))
    given = [*call.args, *(word.value for word in call.keywords)]
    unseeded = not given or (isinstance(given[0], ast.Constant) and given[0].value is None)
    seeds = name in _GENERATORS or (name == "seed" and isinstance(call.func, ast.Attribute))
    return f"{name} without a seed draws from the machine" if seeds and unseeded else ""


def _describe_runtime_override(node: ast.AST) -> str:
    """What a node puts in place of the runtime's own, for one object."""
    if isinstance(node, ast.Name) and node.id in ("setattr", "delattr") and isinstance(node.ctx, ast.Load):
        return f"{node.id} may put something else in place of the runtime's own"
    if not isinstance(node, ast.Attribute) or isinstance(node.ctx, ast.Load):
        return f"{node.attr} does so" if isinstance(node, ast.Attribute) and node.attr == "__setattr__" else ""
    owner = ast.unparse(node.value)
    replaced = node.attr in _ANSWERS or (owner.rpartition(".")[2] == "env" and node.attr in _ANSWERS_OF_ENVIRONMENT)
    return f"it puts something else in place of {owner}.{node.attr}" if replaced else ""


def _find_overriding_members(owner: ast.ClassDef) -> Iterator[tuple[int, str]]:
    bases = {str(getattr(base, "attr", getattr(base, "id", ""))) for base in owner.bases}
    if own := bases & _RUNTIME:
        yield owner.lineno, f"{owner.name} is an {min(own)} of its own"
    for node in owner.body:
        names = {node.name} if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) else set[str]()
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        names |= {target.id for target in targets if isinstance(target, ast.Name)}
        for name in sorted(names & _ANSWERS):
            yield node.lineno, f"{owner.name} overrides {name}, which the runtime answers"


def find_expectations_taken_from_program(
    tests: str, simulation: str, modules: Sequence[str] = ("task_code",)
) -> Iterator[tuple[int, str]]:
    """Where tests take what they expect from the program that they test, with the line: its constants and its methods.

    ``modules`` are those that the program can be imported as. Ids that ``env.add_object`` gave it are no expectations.
    """
    program, suite = read_source("simulation", simulation), read_source("tests", tests)
    if not isinstance(program, ProgramSource) or not isinstance(suite, ProgramSource):
        return
    classes = {node.name for node in program.nodes_of_type(ast.ClassDef)}
    for node in suite.nodes_of_type(ast.ImportFrom):
        for alias in node.names if node.module in modules else ():
            if alias.name not in classes and alias.name != "*":
                yield node.lineno, f"they take {alias.name} from the program, which it tests itself by then"
    said = _find_program_defined_attributes(program) - suite.bound_names
    for node in suite.nodes_of_type(ast.Attribute):
        if node.attr in said and isinstance(node.ctx, ast.Load):
            yield node.lineno, f"they ask the program for {node.attr} instead of saying what is right"


def _find_program_defined_attributes(program: ProgramSource) -> set[str]:
    """Attributes that a program gives its task, and methods of its own; but ids of objects, and what every task has."""
    given: set[str] = set()
    for node in program.nodes_of_type(ast.Assign):
        value = ast.unparse(node.value)
        targets = [part for target in node.targets for part in ast.walk(target)]
        given |= {one.attr for one in targets if isinstance(one, ast.Attribute) and "add_object(" not in value}
    for owner in program.nodes_of_type(ast.ClassDef):
        given |= {node.name for node in owner.body if isinstance(node, ast.FunctionDef)}
    return given - set(dir(sim.Task())) - set(dir(sim.Environment))
