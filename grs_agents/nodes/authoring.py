"""The authoring nodes: task, simulation, tests, and the two fixes."""

from grs_agents import content
from grs_agents.agents import NoReply, TaskDefinition, examples, roles
from grs_agents.files import write_json
from grs_agents.nodes.evidence import evidence
from grs_agents.nodes.program_versions import ProgramName, new_version
from grs_agents.nodes.scene_prompt import fixtures_for_prompt, scene_for_prompt
from grs_agents.nodes.services import Services, Update, node
from grs_agents.perception import SceneDescription
from grs_agents.sim import api_reference
from grs_agents.state import RunState
from grs_agents.trace import Note, TaskDefined

EXAMPLES = 3
"""How many example programs the simulation prompt shows."""


@node
def generate_task(state: RunState, services: Services) -> Update:
    """Define a task for the scene (paper, Task Definition Generation)."""
    library = services.library
    scene = scene_for_prompt(_scene(state), library)
    task = roles.author_task(services.agents, scene, fixtures_for_prompt(library), _images(state))
    if isinstance(task, NoReply):
        return {"problem": str(task)}
    write_json(services.folder / "task.json", task.as_json())
    services.log.append(TaskDefined(task=task.as_json()))
    return {"task": task.as_json()}


@node
def generate_sim(state: RunState, services: Services) -> Update:
    """Write the simulation program (paper, Simulation Program Generation)."""
    task = _task(state)
    scene = scene_for_prompt(_scene(state), services.library)
    shown = _examples(task, services.config.seed)
    source = roles.author_simulation(services.agents, task, scene, api_reference(), shown, _images(state))
    if isinstance(source, NoReply):
        return {"problem": str(source)}
    return new_version(state, services, "simulation", source, "simulation")


@node
def generate_tests(state: RunState, services: Services) -> Update:
    """Write the tests from the task and the program."""
    source = roles.author_tests(services.agents, _task(state), state["simulation"], api_reference())
    if isinstance(source, NoReply):
        return {"problem": str(source)}
    return new_version(state, services, "tests", source, "tests")


@node
def fix_code(state: RunState, services: Services) -> Update:
    """Write the next version of the program; a reply without a program uses the fix up and changes nothing."""
    scene = scene_for_prompt(_scene(state), services.library)
    explanation = state.get("decision", {}).get("explanation", "fix the program")
    source = roles.fix_code(
        services.agents,
        _task(state),
        scene,
        state["simulation"],
        evidence(state),
        explanation,
        api_reference(),
        _images(state),
    )
    return _fixed(state, services, "simulation", source)


@node
def fix_tests(state: RunState, services: Services) -> Update:
    """Write the next version of the tests."""
    explanation = state.get("decision", {}).get("explanation", "fix the tests")
    source = roles.fix_tests(
        services.agents, _task(state), state["simulation"], state["tests"], evidence(state), explanation
    )
    return _fixed(state, services, "tests", source)


def _fixed(state: RunState, services: Services, program: ProgramName, source: str | NoReply) -> Update:
    role = "fix_code" if program == "simulation" else "fix_tests"
    if isinstance(source, NoReply):
        services.log.append(Note(level="warning", text=str(source)))
        return {"fixes": 1, "history": [f"{role}: {source}"]}
    outcome = "unchanged" if source == state.get(program) else f"version {state.get(f'{program}_version', 0) + 1}"
    update = new_version(state, services, program, source, role)
    return {**update, "fixes": 1, "history": [f"{role}: {outcome}"], "audit": {}}


def _scene(state: RunState) -> SceneDescription:
    return SceneDescription.model_validate(state["scene"])


def _task(state: RunState) -> TaskDefinition:
    return TaskDefinition.model_validate(state["task"])


def _images(state: RunState) -> list[str]:
    return [state["image"]] if state.get("image") else []


def _examples(task: TaskDefinition, seed: int) -> str:
    """The example programs that are nearest to a task."""
    found = examples.read_examples(content.content_root() / "prompts" / "examples")
    return "\n\n\n".join(example.source for example in examples.nearest(found, task, EXAMPLES, seed))
