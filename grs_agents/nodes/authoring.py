"""The authoring nodes: task, simulation, tests, and the two fixes.

Prompts show the scene as plain JSON with rounded numbers. Each version of a program is written to the run folder with
its diff. The router and the fixers read the test report and, if there is one, the audit.
"""

import difflib
import hashlib
from typing import Any, Literal

from grs_agents import content
from grs_agents.agents import NoReply, TaskDefinition, examples, roles
from grs_agents.audit import AuditReport
from grs_agents.files import write_json, write_text
from grs_agents.library import Library
from grs_agents.nodes.services import Services, Update, logged_node
from grs_agents.perception import SceneDescription, types
from grs_agents.sandbox import TestReport
from grs_agents.sim import api_reference
from grs_agents.state import RunState
from grs_agents.trace import Note, ProgramVersion, TaskDefined

WORKSPACE = {"x": list(types.X), "y": list(types.Y), "radius": types.FARTHEST}
"""Where the arm works: metres in the robot frame, radius from its base."""


def scene_for_prompt(scene: SceneDescription, library: Library) -> dict[str, Any]:
    """Each object with its asset, place and size (metres, robot frame, table top at z = 0)."""
    objects = [
        {
            "name": item.name,
            "asset": item.asset,
            "description": item.description,
            "category": item.category,
            "color": item.color,
            "position": _round_values(item.position),
            "orientation": _round_values(item.orientation, 4),
            "size": _round_values(item.size),
            "box": {"low": _round_values(item.box.low), "high": _round_values(item.box.high)},
            "reachable": item.reachable,
            "hollow": library.asset(item.asset).hollow,
        }
        for item in scene.objects
    ]
    return {"objects": objects, "workspace": WORKSPACE}


def fixture_assets_for_prompt(library: Library) -> list[dict[str, Any]]:
    """The assets that may be added to what the photo shows: containers and zones."""
    return [
        {
            "name": asset.name,
            "category": asset.category,
            "description": asset.description,
            "size": _round_values(asset.size),
            "hollow": asset.hollow,
        }
        for asset in library.assets()
        if asset.fixture
    ]


def _round_values(values: tuple[float, ...], digits: int = 3) -> list[float]:
    return [round(float(value), digits) for value in values]


ProgramName = Literal["simulation", "tests"]
FILES: dict[ProgramName, str] = {"simulation": "simulation.py", "tests": "test_simulation.py"}


def save_program_version(state: RunState, services: Services, program: ProgramName, source: str, author: str) -> Update:
    """Keep ``source`` as the next version of ``program``: file, history, diff, event and state update."""
    old = state.get(program, "")
    number = state.get(f"{program}_version", 0) + 1
    stem = FILES[program].removesuffix(".py")
    path = f"history/{stem}_{number:03d}.py"
    diff = "".join(
        difflib.unified_diff(
            old.splitlines(keepends=True), source.splitlines(keepends=True), f"{stem} {number - 1}", f"{stem} {number}"
        )
    )
    write_text(services.folder / path, source)
    write_text(services.folder / f"history/{stem}_{number:03d}.diff", diff)
    write_text(services.folder / FILES[program], source)
    services.log.append(
        ProgramVersion(
            program=program,
            number=number,
            sha256=_sha256_of_source(source),
            parent=_sha256_of_source(old) if old else None,
            path=path,
            diff=diff,
            author_role=author,
            source="model",
        )
    )
    return {program: source, f"{program}_version": number}


def _sha256_of_source(source: str) -> str:
    return hashlib.sha256(source.encode()).hexdigest()


def format_test_and_audit(state: RunState) -> str:
    """The report of the latest tests and of the audit that followed them, as text."""
    parts = [TestReport.model_validate(state["report"]).format_as_text()] if state.get("report") else []
    if state.get("audit"):
        parts.append(AuditReport.model_validate(state["audit"]).format_as_text())
    return "\n\n".join(parts) or "(nothing was run yet)"


EXAMPLES = 3
"""How many example programs the simulation prompt shows."""


@logged_node("generate_task")
def generate_task(state: RunState, services: Services) -> Update:
    """Define a task for the scene (paper, Task Definition Generation)."""
    library = services.library
    scene = scene_for_prompt(_scene_from_state(state), library)
    task = roles.author_task(services.agents, scene, fixture_assets_for_prompt(library), _images_from_state(state))
    if isinstance(task, NoReply):
        return {"problem": str(task)}
    write_json(services.folder / "task.json", task.as_json())
    services.log.append(TaskDefined(task=task.as_json()))
    return {"task": task.as_json()}


@logged_node("generate_sim")
def generate_sim(state: RunState, services: Services) -> Update:
    """Write the simulation program (paper, Simulation Program Generation)."""
    task = _task_from_state(state)
    scene = scene_for_prompt(_scene_from_state(state), services.library)
    programs = examples.read_examples(content.content_root() / "prompts" / "examples")
    nearest = examples.select_nearest_examples(programs, task, EXAMPLES, services.config.seed)
    shown = "\n\n\n".join(example.source for example in nearest)
    source = roles.author_simulation(services.agents, task, scene, api_reference(), shown, _images_from_state(state))
    if isinstance(source, NoReply):
        return {"problem": str(source)}
    return save_program_version(state, services, "simulation", source, "simulation")


@logged_node("generate_tests")
def generate_tests(state: RunState, services: Services) -> Update:
    """Write the tests from the task and the program."""
    source = roles.author_tests(services.agents, _task_from_state(state), state["simulation"], api_reference())
    if isinstance(source, NoReply):
        return {"problem": str(source)}
    return save_program_version(state, services, "tests", source, "tests")


@logged_node("fix_code")
def fix_code(state: RunState, services: Services) -> Update:
    """Write the next version of the program; a reply without a program uses the fix up and changes nothing."""
    scene = scene_for_prompt(_scene_from_state(state), services.library)
    explanation = state.get("decision", {}).get("explanation", "fix the program")
    source = roles.fix_code(
        services.agents,
        _task_from_state(state),
        scene,
        state["simulation"],
        format_test_and_audit(state),
        explanation,
        api_reference(),
        _images_from_state(state),
    )
    return _store_fix_reply(state, services, "simulation", source)


@logged_node("fix_tests")
def fix_tests(state: RunState, services: Services) -> Update:
    """Write the next version of the tests."""
    explanation = state.get("decision", {}).get("explanation", "fix the tests")
    source = roles.fix_tests(
        services.agents,
        _task_from_state(state),
        state["simulation"],
        state["tests"],
        format_test_and_audit(state),
        explanation,
    )
    return _store_fix_reply(state, services, "tests", source)


def _store_fix_reply(state: RunState, services: Services, program: ProgramName, source: str | NoReply) -> Update:
    role = "fix_code" if program == "simulation" else "fix_tests"
    if isinstance(source, NoReply):
        services.log.append(Note(level="warning", text=str(source)))
        return {"fixes": 1, "history": [f"{role}: {source}"]}
    outcome = "unchanged" if source == state.get(program) else f"version {state.get(f'{program}_version', 0) + 1}"
    update = save_program_version(state, services, program, source, role)
    return {**update, "fixes": 1, "history": [f"{role}: {outcome}"], "audit": {}}


def _scene_from_state(state: RunState) -> SceneDescription:
    return SceneDescription.model_validate(state["scene"])


def _task_from_state(state: RunState) -> TaskDefinition:
    return TaskDefinition.model_validate(state["task"])


def _images_from_state(state: RunState) -> list[str]:
    return [state["image"]] if state.get("image") else []
