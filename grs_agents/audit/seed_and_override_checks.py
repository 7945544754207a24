"""Checks that a simulation program draws from its seed alone, and overrides no measurement of the runtime.

Two processes that draw alike may still depend on the clock, the machine or a rare event, which the source shows.
"""

import ast
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from grs_agents import sim
from grs_agents.audit.source_checks import ProgramSource, read_source
from grs_agents.audit.types import AuditFinding

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
"""Attributes of other modules that are deterministic."""
_NAMES: Final = frozenset(
    {
        *("SystemRandom", "urandom", "datetime64", "fromfile", "loadtxt", "genfromtxt", "memmap", "read_text"),
        *("read_bytes", "iterdir", "getpid", "environ", "getenv", "perf_counter", "monotonic", "time_ns", "utcnow"),
    }
)
_GENERATORS: Final = frozenset({"default_rng", "RandomState", "SeedSequence", "Random", "PCG64", "MT19937", "Philox"})
"""Generators that use the machine's entropy without a seed, as does ``seed``."""
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


def check_program(simulation: str) -> AuditFinding:
    """The finding ``plain_program``."""
    source = read_source("simulation", simulation)
    located: list[tuple[int, str]] = []
    if isinstance(source, ProgramSource):
        aliases = {
            alias.asname or alias.name.split(".")[0]: alias.name if alias.asname else alias.name.split(".")[0]
            for node in source.nodes_of_type(ast.Import)
            for alias in node.names
        }
        for node in source.nodes:
            if fault := _describe_dependence_or_override(node, aliases):
                located.append((getattr(node, "lineno", 1), fault))
        for owner in source.nodes_of_type(ast.ClassDef):
            bases = {str(getattr(base, "attr", getattr(base, "id", ""))) for base in owner.bases}
            if runtime := bases & _RUNTIME:
                located.append((owner.lineno, f"{owner.name} is an {min(runtime)} of its own"))
            for node in owner.body:
                names = {node.name} if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) else set[str]()
                targets = node.targets if isinstance(node, ast.Assign) else []
                targets = [node.target] if isinstance(node, ast.AnnAssign) else targets
                names |= {target.id for target in targets if isinstance(target, ast.Name)}
                for name in sorted(names & _ANSWERS):
                    located.append((node.lineno, f"{owner.name} overrides {name}, which the runtime answers"))
    else:
        located.append((source.line, source.message))
    faults = [f"line {line}: {fault}" for line, fault in sorted(located)]
    bound = "a program must draw from the seed alone, and override no more than __init__, reset and additional_reset"
    otherwise = "it draws from nothing but the seed, and overrides nothing else"
    return AuditFinding.from_fault_list("plain_program", faults, otherwise, bound)


def _describe_dependence_or_override(node: ast.AST, aliases: Mapping[str, str]) -> str:
    """Source of randomness other than the seed, or assignment to the runtime's attributes; empty if there is none."""
    match node:
        case ast.ImportFrom():
            module, names = node.module or "", {alias.name for alias in node.names}
            harmful = names & _NAMES or names - _HARMLESS.get(module, frozenset(names))
            fault = f"it takes {min(names)} from {module}" if module in _MODULES or harmful else ""
        case ast.Name(ctx=ast.Load()) if node.id in ("id", "hash") or aliases.get(node.id) in _MODULES:
            fault = f"{node.id} tells something else than the seed"
        case ast.Name(id="setattr" | "delattr", ctx=ast.Load()):
            fault = f"{node.id} may put something else in place of the runtime's own"
        case ast.Call():
            name = str(getattr(node.func, "attr", getattr(node.func, "id", "")))
            given = [*node.args, *(word.value for word in node.keywords)]
            unseeded = not given or (isinstance(given[0], ast.Constant) and given[0].value is None)
            seeds = name in _GENERATORS or (name == "seed" and isinstance(node.func, ast.Attribute))
            fault = f"{name} without a seed draws from the machine" if seeds and unseeded else ""
        case ast.Attribute():
            owner = ast.unparse(node.value)
            allowed = _HARMLESS.get(aliases.get(owner, owner), frozenset({node.attr}))
            of_environment = owner.rpartition(".")[2] == "env" and node.attr in _ANSWERS_OF_ENVIRONMENT
            if node.attr in _NAMES or node.attr not in allowed:
                fault = f"{owner}.{node.attr} tells something else than the seed"
            elif isinstance(node.ctx, ast.Load):
                fault = f"{node.attr} does so" if node.attr == "__setattr__" else ""
            elif node.attr in _ANSWERS or of_environment:
                fault = f"it puts something else in place of {owner}.{node.attr}"
            else:
                fault = ""
        case _:
            fault = ""
    return fault


def find_expectations_taken_from_program(
    tests: str, simulation: str, modules: Sequence[str] = ("task_code",)
) -> Iterator[tuple[int, str]]:
    """Find expectations that tests take from the program under test: its constants and its methods.

    Ids that ``env.add_object`` returned are no expectations.

    Args:
        modules: the names under which the program can be imported.

    Returns:
        Pairs of line and fault.
    """
    program, suite = read_source("simulation", simulation), read_source("tests", tests)
    if not isinstance(program, ProgramSource) or not isinstance(suite, ProgramSource):
        return
    classes = {node.name for node in program.nodes_of_type(ast.ClassDef)}
    for node in suite.nodes_of_type(ast.ImportFrom):
        for alias in node.names if node.module in modules else ():
            if alias.name not in classes and alias.name != "*":
                yield node.lineno, f"they take {alias.name} from the program, which it tests itself by then"
    attributes: set[str] = set()  # given to the task, and its methods; but ids of objects
    for node in program.nodes_of_type(ast.Assign):
        if "add_object(" not in ast.unparse(node.value):
            targets = [part for target in node.targets for part in ast.walk(target)]
            attributes |= {target.attr for target in targets if isinstance(target, ast.Attribute)}
    for owner in program.nodes_of_type(ast.ClassDef):
        attributes |= {node.name for node in owner.body if isinstance(node, ast.FunctionDef)}
    attributes -= set(dir(sim.Task())) | set(dir(sim.Environment)) | suite.bound_names
    for node in suite.nodes_of_type(ast.Attribute):
        if node.attr in attributes and isinstance(node.ctx, ast.Load):
            yield node.lineno, f"they ask the program for {node.attr} instead of saying what is right"
