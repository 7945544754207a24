"""The authoring nodes: the task, the simulation (by an author, by two that compete, or with tools) and the tests.

Each version of a program is written to the run folder with its diff.
"""

import difflib
import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Lock
from typing import Annotated, Any, Final, Literal

from grs_agents.agents import examples, roles
from grs_agents.agents.agent import image_block_from_file
from grs_agents.agents.types import NoReply, TaskDefinition, ToolCalling
from grs_agents.audit.side_words import describe_sides_in_photo
from grs_agents.audit.static_checks import check_programs
from grs_agents.audit.types import AuditReport
from grs_agents.base import content
from grs_agents.base.files import write_json, write_text
from grs_agents.base.trace.events import Note, ProgramVersion, TaskDefined
from grs_agents.graph.auditing import audit_instances
from grs_agents.graph.evidence import render_evidence
from grs_agents.graph.scene_prompt import fixture_assets_for_prompt, scene_for_prompt
from grs_agents.graph.services import Services, Update, logged_node
from grs_agents.graph.state import Draft, ProgramName, Revision, RunState
from grs_agents.graph.task_instances import AuditedPrograms
from grs_agents.sim import api_reference
from grs_agents.sim.cliport.api_documentation import Reader
from grs_agents.sim.instance.task_instance import TaskInstance

Author = Literal["simulation", "rival"]
PROGRAM_FILES: Final[dict[ProgramName, str]] = {"simulation": "simulation.py", "tests": "test_simulation.py"}
EXAMPLES: Final = 3
"""Number of example programs in the simulation prompt."""


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
    """Number of the earliest version of ``program`` with this source; 0 if there is none."""
    stem = PROGRAM_FILES[program].removesuffix(".py")
    for number in range(1, state.get(f"{program}_version", 0) + 1):
        file = services.folder / f"history/{stem}_{number:03d}.py"
        if file.is_file() and file.read_bytes() == source.encode():
            return number
    return 0


def _sha256_of_source(source: str) -> str:
    return hashlib.sha256(source.encode()).hexdigest()


@logged_node("generate_task")
def generate_task(state: RunState, services: Services) -> Update:
    """Define a task for the scene (paper, Task Definition Generation)."""
    library = services.library
    scene = scene_for_prompt(state["scene"], library, services.farthest)
    sides = describe_sides_in_photo(state["scene"].frame)
    fixtures = fixture_assets_for_prompt(library)
    task = roles.author_task(services.agents, scene, fixtures, images_from_state(state), sides)
    if isinstance(task, NoReply):
        return {"problem": str(task)}
    write_task_file(task, None, services)
    return {"task": task, "revisable": True}


def write_task_file(
    task: TaskDefinition, revised: Revision | None, services: Services, audit: AuditReport | None = None
) -> None:
    """Write ``task.json`` and its event.

    Args:
        task: the three fields.
        revised: the original and the part that was given up, of a revised task.
        services: of the run.
        audit: adds the sentence of the goals, and instructions with a verdict on each.
    """
    written = task.as_json()
    if revised is not None:
        written["revised"] = revised
    if audit is not None:
        written |= audit.words_as_json(task.description)
    write_json(services.folder / "task.json", written)
    services.log.append(TaskDefined(task=written))


@logged_node("generate_sim")
def generate_sim(state: RunState, services: Services) -> Update:
    """Write the simulation program (paper, Simulation Program Generation)."""
    source = write_simulation(state, services)
    if isinstance(source, NoReply):
        return {"problem": str(source)}
    return save_program_version(state, services, "simulation", source, "simulation")


def write_simulation(
    state: RunState, services: Services, role: Author = "simulation", calling: ToolCalling | None = None
) -> str | NoReply:
    """Ask the author ``role`` for a simulation program; ``calling`` gives it tools."""
    task, scene = state["task"], scene_for_prompt(state["scene"], services.library, services.farthest)
    programs = examples.read_examples(content.content_root() / "prompts" / "examples")
    nearest = examples.select_nearest_examples(programs, task, EXAMPLES, services.config.seed)
    shown = "\n\n\n".join(example.source for example in nearest)
    images = images_from_state(state)
    api = describe_api(services, "program", f"{task.name}\n{task.description}\n{shown}")
    return roles.author_simulation(services.agents, task, scene, api, shown, images, role, calling)


@logged_node("generate_tests")
def generate_tests(state: RunState, services: Services) -> Update:
    """Write the tests from the task and the program."""
    source = write_tests(state, services)
    if isinstance(source, NoReply):
        return {"problem": str(source)}
    return save_program_version(state, services, "tests", source, "tests")


def write_tests(state: RunState, services: Services) -> str | NoReply:
    """Ask the author of the tests for them."""
    return roles.author_tests(services.agents, state["task"], state["simulation"], describe_api(services, "tests"))


def describe_api(services: Services, reader: Reader, about: str | None = None) -> str:
    """The API reference for a prompt, with the robot and the hand of the run."""
    return api_reference(reader, about, services.robot_name_or_path, services.config.hand)


def images_from_state(state: RunState) -> list[str]:
    """The photo, in graphs whose agents see it."""
    return [state["image"]] if state.get("image") else []


def next_step_after_author(state: RunState) -> Literal["ok", "stop"]:
    """After an author: go on unless its model gave no usable reply."""
    return "stop" if state.get("problem") else "ok"


def next_steps_to_drafts(state: RunState) -> list[str]:
    """After the author of the task: both authors of a draft, unless there is no task."""
    return ["conclude"] if next_step_after_author(state) == "stop" else ["draft_sim", "draft_rival"]


@logged_node("draft_sim")
def draft_simulation(state: RunState, services: Services) -> Update:
    """Write a simulation program by the model of the role ``simulation``."""
    return _write_draft("simulation", state, services)


@logged_node("draft_rival")
def draft_rival(state: RunState, services: Services) -> Update:
    """Write a simulation program by the model of the role ``rival``."""
    return _write_draft("rival", state, services)


def _write_draft(author: Author, state: RunState, services: Services) -> Update:
    source = write_simulation(state, services, author)
    if isinstance(source, NoReply):
        return {"drafts": [Draft(author=author, problem=str(source))]}
    write_text(services.folder / f"history/draft_{author}.py", source)
    return {"drafts": [Draft(author=author, source=source)]}


@logged_node("choose_draft")
def choose_draft(state: RunState, services: Services) -> Update:
    """Keep the draft whose task instances pass more checks of the audit, then the draft with the higher mean reward.

    Words and tests, which are written for the chosen program alone, are not judged here.
    """
    # sorted, since the order in which they ended is a matter of chance
    drafts = sorted(state["drafts"], key=lambda draft: draft.author, reverse=True)
    written = [draft for draft in drafts if draft.source]
    if not written:
        return {"problem": "; ".join(draft.problem for draft in drafts)}
    scores: list[tuple[bool, int, float]] = []
    for draft in written:
        audited = AuditedPrograms(draft.source, task=state["task"], scene=state["scene"])
        _, report = audit_instances(audited, services)
        held = sum(finding.passed for finding in report.findings)
        reward = sum(report.rewards) / services.config.audit.seeds
        verdict = f"{held} of {len(report.findings)} checks hold, mean reward {reward:.2f}"
        services.log.append(Note(level="info", text=f"draft of {draft.author}: {verdict}"))
        scores.append((report.accepted, held, reward))
    best = written[scores.index(max(scores))]
    return save_program_version(state, services, "simulation", best.source, best.author)


@logged_node("generate_sim")
def generate_sim_with_tools(state: RunState, services: Services) -> Update:
    """Write the simulation program by an author that may check, look and measure before it hands its program in."""
    tools = AuthorTools(state, services)
    calling = ToolCalling(tools.functions_by_name(), services.config.author.steps, services.config.graph)
    source = write_simulation(state, services, calling=calling)
    if isinstance(source, NoReply):
        return {"problem": str(source)}
    return save_program_version(state, services, "simulation", source, "simulation")


@dataclass
class AuthorTools:
    """The tools of an author, which reads their docstrings."""

    state: RunState
    services: Services
    _drawn: list[TaskInstance] = field(default_factory=list[TaskInstance])  # of the draft checked last
    _lock: Lock = field(default_factory=Lock)  # a check writes files into the run folder

    def functions_by_name(self) -> dict[str, Callable[..., Any]]:
        """The tools; ``render`` only where the author is shown pictures."""
        tools: dict[str, Callable[..., Any]] = {
            "check": self.check,
            "describe_asset": self.describe_asset,
            "measure": self.measure,
        }
        services = self.services
        pictured = images_from_state(self.state) and services.config.end_picture
        sees = pictured and services.agents.sees_pictures("simulation")
        return {**tools, "render": self.render} if sees else tools

    def check(self, program: Annotated[str, "The whole draft: Python source with one subclass of Task."]) -> str:
        """Check a draft: its static checks, task instances of several seeds, and how the robot's oracle solves them."""
        task, scene = self.state["task"], self.state["scene"]
        findings = check_programs(program, "", task, self.services.library)
        static = [finding for finding in findings if finding.program == "simulation"]
        with self._lock:
            measured, report = audit_instances(AuditedPrograms(program, task=task, scene=scene), self.services)
            self._drawn[:] = measured.instances
        return render_evidence(None, report, static)

    def render(self) -> str | list[Any]:
        """Draw the first task instance of the draft that was checked last, before the robot begins."""
        with self._lock:
            if not self._drawn:
                return "There is no task instance to draw: check a draft that gives one first."
            output = (self.services.folder / "instances" / "author.png").resolve()
            drawn = self.services.render_instance(self._drawn[0], output)
            return "It could not be drawn." if drawn.image is None else [image_block_from_file(output)]

    def describe_asset(self, name: Annotated[str, "Of the asset, e.g. bowl/bowl.urdf."]) -> str:
        """Describe an asset of the library by its name: kind, colour, size in metres, mass and friction."""
        return json.dumps(self.services.library.asset(name).model_dump(mode="json", exclude={"origin"}))

    def measure(
        self,
        first: Annotated[str, "The name of an object of the scene; alone, its extents along x, y, z in metres."],
        second: Annotated[str, "Another object, for the distance between both centres in metres."] = "",
    ) -> str:
        """Measure in the scene, by names of objects: the size of one, or the distance between two centres, metres."""
        objects = {item.name: item for item in self.state["scene"].objects}
        unknown = [name for name in (first, second) if name and name not in objects]
        if unknown:
            return f"The scene has no {unknown[0]!r}; it has {', '.join(objects)}."
        if not second:
            box = objects[first].box
            x, y, z = (high - low for low, high in zip(box.low, box.high, strict=True))
            return f"{first} extends {x:.3f} m along x, {y:.3f} m along y and {z:.3f} m along z of the robot frame."
        start, end = objects[first].position, objects[second].position
        x, y, z = apart = [b - a for a, b in zip(start, end, strict=True)]
        return (
            f"{math.hypot(*apart):.3f} m from {first} to {second}: {x:.3f} along x, {y:.3f} along y, {z:.3f} along z."
        )
