"""The authoring nodes: task, simulation and tests.

Each version of a program is written to the run folder with its diff.
"""

import difflib
import hashlib
from typing import Any, Literal, TypeAlias

from grs_agents.agents import examples, roles
from grs_agents.agents.types import NoReply, TaskDefinition, ToolCalling
from grs_agents.base import content
from grs_agents.base.files import write_json, write_text
from grs_agents.base.trace.events import ProgramVersion, TaskDefined
from grs_agents.graph.fix_history import ProgramName
from grs_agents.graph.scene_prompt import fixture_assets_for_prompt, scene_for_prompt
from grs_agents.graph.services import Services, Update, logged_node
from grs_agents.graph.state import RunState
from grs_agents.perception.types import SceneDescription
from grs_agents.sim.cliport.api_documentation import api_reference

Json: TypeAlias = dict[str, Any]
PROGRAM_FILES: dict[ProgramName, str] = {"simulation": "simulation.py", "tests": "test_simulation.py"}


def save_program_version(state: RunState, services: Services, program: ProgramName, source: str, author: str) -> Update:
    """Keep ``source`` as the next version of ``program``: file, history, diff, event and state update."""
    old = state.get(program, "")
    number = state.get(f"{program}_version", 0) + 1
    stem = PROGRAM_FILES[program].removesuffix(".py")
    path = f"history/{stem}_{number:03d}.py"
    diff = "".join(
        difflib.unified_diff(
            old.splitlines(keepends=True), source.splitlines(keepends=True), f"{stem} {number - 1}", f"{stem} {number}"
        )
    )
    write_text(services.folder / path, source)
    write_text(services.folder / f"history/{stem}_{number:03d}.diff", diff)
    write_text(services.folder / PROGRAM_FILES[program], source)
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


def find_equal_version(state: RunState, services: Services, program: ProgramName, source: str) -> int:
    """The number of the earliest version of ``program`` with this source; 0 without one."""
    stem = PROGRAM_FILES[program].removesuffix(".py")
    for number in range(1, state.get(f"{program}_version", 0) + 1):
        file = services.folder / f"history/{stem}_{number:03d}.py"
        if file.is_file() and file.read_bytes() == source.encode():
            return number
    return 0


def _sha256_of_source(source: str) -> str:
    return hashlib.sha256(source.encode()).hexdigest()


EXAMPLES = 3
"""How many example programs the simulation prompt shows."""


@logged_node("generate_task")
def generate_task(state: RunState, services: Services) -> Update:
    """Define a task for the scene (paper, Task Definition Generation)."""
    library = services.library
    scene = scene_for_prompt(scene_from_state(state), library)
    task = roles.author_task(services.agents, scene, fixture_assets_for_prompt(library), images_from_state(state))
    if isinstance(task, NoReply):
        return {"problem": str(task)}
    write_task_file(task.as_json(), {}, services)
    return {"task": task.as_json(), "revisable": True}


def write_task_file(task: Json, revised: Json, services: Services) -> None:
    """Write ``task.json``, with what was given up if the task was revised, and the event of it."""
    told = {**task, "revised": revised} if revised else task
    write_json(services.folder / "task.json", told)
    services.log.append(TaskDefined(task=told))


@logged_node("generate_sim")
def generate_sim(state: RunState, services: Services) -> Update:
    """Write the simulation program (paper, Simulation Program Generation)."""
    source = write_simulation(state, services)
    if isinstance(source, NoReply):
        return {"problem": str(source)}
    return save_program_version(state, services, "simulation", source, "simulation")


def write_simulation(
    state: RunState,
    services: Services,
    role: Literal["simulation", "rival"] = "simulation",
    calling: ToolCalling | None = None,
) -> str | NoReply:
    """A simulation program by its author, or by the one that competes with it; ``calling`` gives it tools."""
    task = task_from_state(state)
    scene = scene_for_prompt(scene_from_state(state), services.library)
    programs = examples.read_examples(content.content_root() / "prompts" / "examples")
    nearest = examples.select_nearest_examples(programs, task, EXAMPLES, services.config.seed)
    shown = "\n\n\n".join(example.source for example in nearest)
    images = images_from_state(state)
    return roles.author_simulation(services.agents, task, scene, api_reference(), shown, images, role, calling)


@logged_node("generate_tests")
def generate_tests(state: RunState, services: Services) -> Update:
    """Write the tests from the task and the program."""
    source = write_tests(state, services)
    if isinstance(source, NoReply):
        return {"problem": str(source)}
    return save_program_version(state, services, "tests", source, "tests")


def write_tests(state: RunState, services: Services) -> str | NoReply:
    """Tests by their author."""
    return roles.author_tests(services.agents, task_from_state(state), state["simulation"], api_reference("tests"))


def scene_from_state(state: RunState) -> SceneDescription:
    """What stands on the table."""
    return SceneDescription.model_validate(state["scene"])


def task_from_state(state: RunState) -> TaskDefinition:
    """The task as it is defined now."""
    return TaskDefinition.model_validate(state["task"])


def images_from_state(state: RunState) -> list[str]:
    """The photo, in graphs whose agents see it."""
    return [state["image"]] if state.get("image") else []
