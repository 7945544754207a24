"""The layers: imports go down only, and sandboxed code stays light."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import networkx
import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "grs_agents"

LAYERS: tuple[frozenset[str], ...] = (
    frozenset({"base"}),
    frozenset({"sandbox"}),
    frozenset({"library"}),
    frozenset({"sim", "models"}),
    frozenset({"perception", "agents", "toolkit"}),
    frozenset({"audit", "tasks", "tools/"}),
    frozenset({"graph", "envs"}),
    frozenset({"runs", "graphs/", "views"}),
    frozenset({"api", "examples"}),
    frozenset({"serving"}),
    frozenset({"cli"}),
    frozenset({"evals/", "__main__"}),
    frozenset({"scripts/"}),
)
"""From the bottom up; a package imports only from layers below its own. A slash marks a content folder."""


def layer_of(package: str) -> int:
    """The index of a package's layer."""
    layers = [number for number, packages in enumerate(LAYERS) if package in packages]
    assert layers, f"{package} is in no layer: add it to LAYERS in {Path(__file__).name}"
    return layers[0]


def sources() -> Iterator[tuple[str, Path]]:
    """Every Python file of the library and the content, with its package."""
    for file in sorted(PACKAGE.rglob("*.py")):
        package = file.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if package not in ("__init__", "_bundled"):
            yield package, file
    for folder in ("tools", "graphs", "evals", "scripts"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            yield f"{folder}/", file


@cache
def parse(file: Path) -> ast.Module:
    """The syntax tree of a file."""
    return ast.parse(file.read_text(encoding="utf-8"))


@cache
def imports(file: Path) -> list[str]:
    """The dotted names a file imports, anywhere in it; ``from a import b`` gives ``a.b``."""
    found: list[str] = []
    for node in ast.walk(parse(file)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: imports are absolute"
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return found


SOURCES = list(sources())
MODULES = {
    ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): file
    for file in PACKAGE.rglob("*.py")
}
"""Every module of the package by its dotted name."""


def ours(file: Path) -> Iterator[tuple[str, str]]:
    """The packages that a file imports from, each with the dotted name."""
    for name in imports(file):
        root, _, rest = name.partition(".")
        if root == PACKAGE.name and rest:
            yield rest.split(".")[0], name


def test_a_package_imports_only_from_layers_below_its_own() -> None:
    climbing = [
        f"{file.relative_to(ROOT)} ({package}) imports {other}"
        for package, file in SOURCES
        for other, _ in ours(file)
        if other != package and layer_of(other) >= layer_of(package)
    ]
    assert not climbing


def test_only_a_checkout_has_experiments_and_scripts() -> None:
    # A wheel holds few of the experiments and none of what they share: nothing below may need it.
    barred = {"evals/": ("scripts",), "scripts/": ()}
    climbing = [
        f"{file.relative_to(ROOT)} imports {name}"
        for package, file in SOURCES
        for name in imports(file)
        if name.split(".")[0] in barred.get(package, ("evals", "scripts"))
    ]
    assert not climbing


def module_of(name: str) -> str | None:
    """The module that an imported dotted name is or lies in; None where it is not ours."""
    if name in MODULES:
        return name
    module = name.rpartition(".")[0]
    return module if module in MODULES else None


def test_no_modules_import_each_other_in_a_circle() -> None:
    # Imports for type checking and inside functions count: they, too, say who knows whom.
    arrows = [
        (name, other)
        for name, file in MODULES.items()
        for imported in imports(file)
        if (other := module_of(imported)) is not None and other != name
    ]
    circles = networkx.strongly_connected_components(networkx.DiGraph(arrows))
    assert [sorted(circle) for circle in circles if len(circle) > 1] == []


def test_private_names_stay_in_their_package() -> None:
    leaks = [
        f"{file.relative_to(ROOT)} imports {name}"
        for package, file in SOURCES
        for other, name in ours(file)
        if other != package and any(part.startswith("_") for part in name.split(".") if part != "__version__")
    ]
    assert not leaks


@pytest.mark.parametrize(
    "imported", ["from grs_agents.sim import *", "import grs_agents.library", "import grs_agents.sandbox"]
)
def test_what_runs_in_the_sandbox_imports_nothing_heavy(imported: str) -> None:
    heavy = ("langchain_core", "langgraph", "rerun", "cv2", "httpx", "OpenGL", "PIL", "scipy", "jinja2")
    probe = f"{imported}\nimport sys; print([name for name in {heavy!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", probe], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("worker", "heavy"),
    [
        ("perception.reading.worker", ("mujoco", "grs_agents.library", "yaml", "scipy", "trimesh")),
        ("library.importing.archives", ("mujoco", "scipy", "trimesh")),
    ],
)
def test_a_worker_that_reads_strangers_files_imports_little(worker: str, heavy: tuple[str, ...]) -> None:
    probe = f"import sys, grs_agents.{worker}; print([name for name in {heavy!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", probe], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_package_itself_imports_next_to_nothing_and_is_silent() -> None:
    probe = "import sys, grs_agents; assert not {'numpy', 'pydantic', 'mujoco', 'langchain_core'} & set(sys.modules)"
    done = subprocess.run([sys.executable, "-c", probe], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout + done.stderr == ""


@pytest.mark.parametrize("file", sorted((ROOT / "graphs").glob("*.py")), ids=lambda file: file.stem)
def test_a_graph_is_topology_without_logic(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    logic = (ast.If, ast.For, ast.While, ast.Try, ast.Lambda, ast.ClassDef)
    assert not [node for node in ast.walk(ast.parse(text)) if isinstance(node, logic)]


def test_every_public_thing_has_a_docstring() -> None:
    bare: list[str] = []
    for _, file in SOURCES:
        tree = parse(file)
        things = [node for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)]
        for thing in [tree, *(node for node in things if not node.name.startswith("_"))]:
            if not ast.get_docstring(thing):
                bare.append(f"{file.relative_to(ROOT)}: {getattr(thing, 'name', 'the module')}")
    assert not bare


def test_no_check_is_silenced() -> None:
    markers = ("type: ignore", "pyright: ignore", "noqa", "TODO", "FIXME")
    silenced = [
        f"{file.relative_to(ROOT)}:{number}: {line.strip()}"
        for _, file in SOURCES
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), start=1)
        if any(marker in line for marker in markers)
    ]
    assert not silenced
