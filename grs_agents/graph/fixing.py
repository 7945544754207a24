"""The fixing nodes: mend the program, the tests or the task, or write a program anew where mending was in vain."""

from grs_agents.agents import roles
from grs_agents.agents.roles import JudgedPrograms
from grs_agents.agents.types import NoReply
from grs_agents.base.trace.events import Note
from grs_agents.graph.authoring import (
    describe_api,
    find_equal_version,
    images_from_state,
    save_program_version,
    write_simulation,
    write_task_file,
    write_tests,
)
from grs_agents.graph.evidence import draw_end_of_episode, render_evidence
from grs_agents.graph.fix_history import describe_fix_history, list_untried_fix_strategies, record_fix
from grs_agents.graph.scene_prompt import fixture_assets_for_prompt, scene_for_prompt
from grs_agents.graph.services import Services, Update, logged_node
from grs_agents.graph.state import ProgramName, Revision, RunState, Strategy


def collect_evidence_for_fixer(state: RunState, services: Services, role: str) -> JudgedPrograms:
    """Collect the programs and the evidence that the model of a router or fixer is shown."""
    task, decision = state["task"], state.get("decision")
    scene = scene_for_prompt(state["scene"], services.library, services.farthest)
    if role not in ("fix_task", "fix_code"):  # these two place objects among all others
        scene["objects"] = [item for item in scene["objects"] if item["asset"] in task.assets]
    photo = [] if role == "route" else images_from_state(state)
    return JudgedPrograms(
        task=task,
        scene=roles.to_json_text(scene),
        code=state["simulation"],
        tests=state["tests"],
        results=render_evidence(state.get("report"), state.get("audit"), state.get("static", [])),
        history=describe_fix_history(state),
        images=(*photo, *draw_end_of_episode(state, services, role)),
        explanation=decision.explanation if decision else "judge for yourself",
    )


@logged_node("fix_code")
def fix_code(state: RunState, services: Services) -> Update:
    """Write the next version of the program; a reply without a program uses the fix up and changes nothing."""
    strategy = list_untried_fix_strategies(state).get("fix_code", "fix")
    if strategy == "rewrite":
        source = write_simulation(state, services)
    else:
        judged = collect_evidence_for_fixer(state, services, "fix_code")
        api = describe_api(services, "program", f"{judged.task.name}\n{judged.task.description}\n{judged.code}")
        source = roles.fix_code(services.agents, judged, api)
    return _record_fix_and_save_program(state, services, "simulation", strategy, source)


@logged_node("fix_tests")
def fix_tests(state: RunState, services: Services) -> Update:
    """Write the next version of the tests."""
    strategy = list_untried_fix_strategies(state).get("fix_test", "fix")
    if strategy == "rewrite":
        source = write_tests(state, services)
    else:
        source = roles.fix_tests(
            services.agents, collect_evidence_for_fixer(state, services, "fix_tests"), describe_api(services, "tests")
        )
    return _record_fix_and_save_program(state, services, "tests", strategy, source)


def _record_fix_and_save_program(
    state: RunState, services: Services, program: ProgramName, strategy: Strategy, source: str | NoReply
) -> Update:
    if isinstance(source, NoReply):
        services.log.append(Note(level="warning", text=str(source)))
        return record_fix(state, program, strategy, {}, str(source))
    if source == state.get(program):
        return record_fix(state, program, strategy, {})
    author = "fix_code" if program == "simulation" else "fix_tests"
    equals = find_equal_version(state, services, program, source)
    change = save_program_version(state, services, program, source, author)
    return record_fix(state, program, strategy, change, equals=equals)


@logged_node("fix_task")
def fix_task(state: RunState, services: Services) -> Update:
    """Revise a task that cannot be done as it is defined, once in a run; the audit judges what was given up."""
    judged = collect_evidence_for_fixer(state, services, "fix_task")
    objects = [{"name": item.name, "asset": item.asset} for item in state["scene"].objects]
    revision = roles.fix_task(services.agents, judged, objects, fixture_assets_for_prompt(services.library))
    if isinstance(revision, NoReply):
        services.log.append(Note(level="warning", text=str(revision)))
        return record_fix(state, "task", "fix", {"revisable": False}, str(revision))
    task = revision.as_definition()
    if task == state["task"]:
        return record_fix(state, "task", "fix", {"revisable": False})
    revised = Revision.model_validate({"from": state["task"], "given-up": revision.given_up})
    write_task_file(task, revised, services)
    return record_fix(state, "task", "fix", {"task": task, "revised": revised, "revisable": False})
