"""The documentation says what the code does: keys, verbs, options, events, assets and goals; its examples run."""

import contextlib
import functools
import json
import re
import runpy
import shlex
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import pytest
from typer.core import TyperGroup
from typer.main import get_command

from grs_agents.base.config.schema import ROLE_ALIASES, ROLES, Config
from grs_agents.base.content import content_names
from grs_agents.base.trace.events import Event
from grs_agents.cli.commands import app
from grs_agents.library.library import Library
from grs_agents.sim import Goal, Outcome, p
from grs_agents.sim.instance import goal
from tests.cli.command import grs

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])


def page(name: str) -> str:
    """A page of the documentation."""
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


def rows(text: str) -> list[list[str]]:
    """The cells of every table row, with the code marks taken off."""
    lines = [line for line in text.splitlines() if line.startswith("| `")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def leaves(tree: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Dotted key to value."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        flat.update(leaves(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value})
    return flat


def test_every_configuration_key_is_documented_with_its_default() -> None:
    documented = [(cells[0].strip("`"), json.loads(cells[1].strip("`"))) for cells in rows(page("configuration.md"))]
    actual = leaves(Config().model_dump(mode="json"))
    renamed = [(key.replace("models.default.", "models.ROLE."), value) for key, value in actual.items()]
    assert sorted(documented, key=str) == sorted(renamed, key=str)


def test_every_role_is_documented() -> None:
    text = page("configuration.md")
    assert all(f"`{role}`" in text for role in [*ROLES, *ROLE_ALIASES])


def test_every_check_of_the_audit_is_documented() -> None:
    sources = [*(ROOT / "grs_agents" / "audit").glob("*.py"), *(ROOT / "grs_agents" / "graph").glob("*.py")]
    named = re.compile(r'(?:check=|from_fault_list\()"(\w+)"')
    made = {name for file in sources for name in named.findall(file.read_text(encoding="utf-8"))}
    assert {cells[0].strip("`") for cells in rows(page("audit.md"))} == made


@functools.cache
def commands() -> dict[str, Any]:
    """The verbs of the command line."""
    group = get_command(app)
    assert isinstance(group, TyperGroup)
    return dict(group.commands)


def test_every_verb_is_documented() -> None:
    documented = {cells[0].strip("`").split()[1] for cells in rows(page("cli.md")) if cells[0].startswith("`grs ")}
    assert documented == set(commands())


def test_every_option_is_documented_with_its_verbs() -> None:
    documented = {
        cells[0].split()[0].strip("`,"): {verb.strip() for verb in cells[1].split(",")}
        for cells in rows(page("cli.md"))
        if cells[0].startswith("`--")
    }
    actual: dict[str, set[str]] = {}
    for verb, command in commands().items():
        for parameter in command.params:
            for option in parameter.opts:
                if option.startswith("--") and option != "--help":
                    actual.setdefault(option, set()).add(verb)
    everywhere = {option for option, verbs in documented.items() if verbs == {"every"}}
    assert all(actual.pop(option) == set(commands()) for option in everywhere)
    assert {option: verbs for option, verbs in documented.items() if option not in everywhere} == actual


def test_every_event_is_documented() -> None:
    union = get_args(get_args(Event)[0])
    assert {cells[0].strip("`") for cells in rows(page("traces.md"))} >= {
        kind.model_fields["kind"].default for kind in union
    }


def test_the_readme_opens_with_the_two_commands() -> None:
    opening = (ROOT / "README.md").read_text(encoding="utf-8")[:1500]
    targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    for target in ("demo", "test"):
        assert f"make {target}" in opening
        assert target in targets


@pytest.mark.parametrize("file", PAGES, ids=lambda file: file.name)
def test_every_link_to_a_file_leads_somewhere(file: Path) -> None:
    text = re.sub(r"```.*?```", "", file.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", text):
        if not target.startswith(("http://", "https://")):
            assert (file.parent / target).exists(), f"{file.name} links to {target}"


@pytest.mark.parametrize("file", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=lambda file: file.name)
def test_every_command_of_a_page_exists(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    lines = re.findall(r"`grs ([a-z][^`]*)`", text) + re.findall(r"^grs ([a-z][^#\n]*)", text, re.MULTILINE)
    for words in map(str.split, lines):
        command = commands()[words[0]]
        if words[0] == "eval":
            assert all(name == "NAME" or (ROOT / "evals" / f"{name}.py").exists() for name in words[1:2]), words
            continue
        if isinstance(command, TyperGroup) and len(words) > 1:
            command = command.commands[words[1]]
        options = {"--help", *(option for parameter in command.params for option in parameter.opts)}
        assert {word for word in words if word.startswith("--")} <= options, words


def test_every_page_is_on_the_first_one_and_in_the_navigation() -> None:
    pages = {file.name for file in (ROOT / "docs").glob("*.md")} - {"index.md"}
    assert set(re.findall(r"\]\((\w+\.md)\)", page("index.md"))) == pages
    navigation = (ROOT / "mkdocs.yml").read_text("utf-8")
    assert set(re.findall(r": (\w+\.md)$", navigation, re.MULTILINE)) == {*pages, "index.md"}


def test_every_module_that_architecture_names_exists() -> None:
    text = re.sub(r"```.*?```", "", page("architecture.md"), flags=re.DOTALL)
    paths = re.findall(r"`([a-z_]+(?:/[a-z_0-9]+)+(?:\.\w+)?)`", text)
    assert len(paths) > 30
    places = [ROOT, ROOT / "grs_agents"]
    missing = [path for path in paths if not any((at / path).exists() or (at / f"{path}.py").exists() for at in places)]
    assert not missing


def test_the_site_fetches_nothing_from_elsewhere() -> None:
    settings = (ROOT / "mkdocs.yml").read_text("utf-8")
    scripts = re.search(r"^extra_javascript: \[(.*)\]", settings, re.MULTILINE)
    assert scripts and scripts[1] == "javascripts/mermaid.min.js" and "font: false" in settings
    source = (ROOT / "docs" / scripts[1]).read_text("utf-8")
    assert "stateDiagram" in source and "globalThis" in source[-200:]
    assert "hooks: [scripts/offline.py, " in settings
    refuses = runpy.run_path(str(ROOT / "scripts" / "offline.py"))["on_post_page"]
    fine = '<script src="a.js"></script><link rel="canonical" href="https://a/"><a href="https://a/">a</a>'
    assert refuses(output=fine, page=None) == fine
    for page in (
        '<script src="https://a/a.js">',
        "<link rel=stylesheet href=//a/a.css>",
        '<img alt="" src="http://a/a">',
    ):
        with pytest.raises(ValueError, match="fetches from elsewhere"):
            refuses(output=page, page=SimpleNamespace(file=SimpleNamespace(src_path="a.md")))


def test_the_page_of_the_notebook_shows_each_of_its_cells() -> None:
    shows = runpy.run_path(str(ROOT / "scripts" / "notebook_page.py"))["on_page_markdown"]
    shown = shows(page("tour.md"), {"docs_dir": str(ROOT / "docs")})
    cells = json.loads((ROOT / "docs" / "tour.ipynb").read_text("utf-8"))["cells"]
    codes = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert codes == [text.strip("\n") for text in re.findall(r"```python\n(.*?)```", shown, re.DOTALL)]
    assert len(re.findall("^# ", re.sub(r"```.*?```", "", shown, flags=re.DOTALL), re.MULTILINE)) == 1
    assert shows("as it is", {}) == "as it is"


def test_the_pictures_show_the_present_views() -> None:
    made = (ROOT / "docs" / "images" / "pictures.sha256").read_text("utf-8").strip()
    present = runpy.run_path(str(ROOT / "scripts" / "pictures.py"))["digest"]()
    assert made == present, "renew the pictures: .venv/bin/python scripts/pictures.py"


def test_the_figures_are_those_of_the_kept_results() -> None:
    script = runpy.run_path(str(ROOT / "scripts" / "figures.py"))
    assert script["render_page"](page("evals.md")) == page("evals.md"), "run: python scripts/figures.py"
    kept = {file.stem.split(".")[0] for file in script["RESULTS"].glob("*.json")}
    marks = re.findall(r"<!-- (\w+): begin -->", page("evals.md"))
    assert sorted(marks) == sorted(kept) and kept >= {*content_names("evals")} - {"twin"}


def test_a_result_becomes_a_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = runpy.run_path(str(ROOT / "scripts" / "figures.py"))
    monkeypatch.setitem(script["keep"].__globals__, "RESULTS", tmp_path)
    came = {"date": "2026-01-02", "grs-agents": "1.0", "seeds": {"seed": 3}}
    for name, value in (("one", 1), ("two", 2)):
        arguments = ["/home/me/scenes", "--json", "--out", "there", "--policy", name]
        result = {
            "experiment": "routing",
            "arguments": arguments,
            **came,
            "table": [{"value": value}],
            "rows": [0] * 99,
        }
        (tmp_path / "result").write_text(json.dumps(result))
        script["keep"](f"routing.{name}", tmp_path / "result")
    shown = script["render_page"](
        "a\n<!-- routing: begin -->\nold\n<!-- routing: end -->\n<!-- x: begin -->\n<!-- x: end -->\n"
    )
    assert "| value |\n|---|\n| 1 |\n| 2 |\n" in shown and "old" not in shown and "x: begin -->\n<!-- x: end" in shown
    assert "- `grs eval routing scenes --policy two`, version 1.0, 2026-01-02, seed 3\n" in shown
    assert "rows" not in (tmp_path / "routing.one.json").read_text()


def between(text: str, mark: str) -> str:
    """The part of a page between the comments ``mark: begin`` and ``mark: end``."""
    return text.split(f"<!-- {mark}: begin -->")[1].split(f"<!-- {mark}: end -->", maxsplit=1)[0]


def files_of(text: str) -> dict[str, str]:
    """The Python examples of a page that name their file in the first line."""
    return dict(re.findall(r"^```python\n# (\w+\.py)\n(.*?)^```", text, re.DOTALL | re.MULTILINE))


def test_every_template_is_documented_with_its_defaults() -> None:
    library = Library()
    documented = {
        name: cells[1]
        for cells in rows(between(page("simulation.md"), "templates"))
        for name in re.findall(r"`([^`]+)`", cells[0])
    }
    actual: dict[str, str] = {}
    for name in library.template_names():
        told = {stem: values for stem, values in library.template_defaults(name).items() if stem != "COLOR"}
        shown = (f"{stem} ({', '.join(map(short, values))})" for stem, values in told.items())
        actual[name] = ", ".join(shown)
    assert documented == actual


def short(value: float | str) -> str:
    """A default as the page writes it."""
    return value if isinstance(value, str) else f"{value:g}"


def test_every_other_asset_is_documented_with_its_size_and_origin() -> None:
    library = Library()
    named = {asset.name for asset in library.assets() if not asset.template and not asset.name.startswith("HOPE/")}
    seen: set[str] = set()
    for cells in rows(between(page("simulation.md"), "assets")):
        for name in re.findall(r"`([^`]+)`", cells[0]):
            seen.add(name)
            assert [float(number) for number in cells[1].split(",")] == pytest.approx(
                library.load_object_model(name).size, abs=1e-4
            ), name
            low, high = library.load_object_model(name).bounds
            centred = all(abs(first + last) < 1e-4 for first, last in zip(low, high, strict=True))
            assert centred == (cells[2] == "centre"), name
    assert seen == named


def test_every_typed_goal_is_documented_with_an_example_that_holds_water() -> None:
    examples = [cells[0].strip("`") for cells in rows(between(page("simulation.md"), "relations"))]
    things = {"cans": [1, 2, 3], "box": 4, "tray": 5, "base": 6, "middle": 7, "top": 8}
    made = [eval(example, {**vars(goal), **things}) for example in examples]
    assert all(isinstance(one, Goal) for one in made)
    assert tuple(one.relation_kind for one in made) == get_args(goal.Kind)


def test_every_outcome_is_documented() -> None:
    text = page("simulation.md").split("## Outcomes")[1].split("##")[0]
    assert [cells[0].strip("`") for cells in rows(text)] == list(get_args(Outcome))


def test_every_call_of_pybullet_is_documented() -> None:
    named = re.findall(r"`(\w+)`", between(page("simulation.md"), "p"))
    assert named == sorted(name for name in vars(p) if re.match("[a-z]+[A-Z]", name))


def test_the_programs_of_the_page_on_simulation_are_accepted(tmp_path: Path) -> None:
    programs = {name: text for name, text in files_of(page("simulation.md")).items() if "(Task)" in text}
    assert programs
    for name, text in programs.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
        done = grs("check", name, "--seeds", "1", folder=tmp_path)
        assert done.returncode == 0, done.stdout + done.stderr


def test_the_page_on_simulation_drives_its_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, text in files_of(page("simulation.md")).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    with contextlib.chdir(tmp_path):
        runpy.run_path("drive.py")
    assert capsys.readouterr().out.split()[:3] == ["success", "1.0", "1.0"]


@pytest.mark.usefixtures("brief_films")
def test_the_first_run_goes_as_its_page_says(known_scene: Path, tmp_path: Path) -> None:
    blocks = re.findall(r"```sh\n(.*?)```", page("first_run.md"), re.DOTALL)
    lines = [shlex.split(line)[1:] for block in blocks for line in block.splitlines()]
    assert lines[0][:2] == ["run", "groceries"]
    for line in lines:
        arguments = [str(known_scene) if word == "groceries" else word for word in line]
        done = grs(*arguments, folder=tmp_path)
        assert done.returncode == 0, (line, done.stdout, done.stderr)
    assert (tmp_path / "mine.html").stat().st_size
    assert len(list((tmp_path / "runs" / "mine-instances").rglob("*.json"))) >= 2
    assert (tmp_path / "runs" / "mine-mjcf").is_dir()
