"""An author of the simulation that may check, look and measure before it hands its program in."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Lock
from typing import Annotated, Any

from grs_agents.agents.agent import image_block_from_file
from grs_agents.agents.types import NoReply, ToolCalling
from grs_agents.audit.static_checks import check_programs
from grs_agents.graph.auditing import audit_instances
from grs_agents.graph.authoring import (
    images_from_state,
    save_program_version,
    scene_from_state,
    task_from_state,
    write_simulation,
)
from grs_agents.graph.evidence import render_evidence
from grs_agents.graph.services import Services, Update, logged_node
from grs_agents.graph.state import RunState
from grs_agents.graph.task_instances import AuditedPrograms
from grs_agents.models.factory import is_offline
from grs_agents.perception.types import SceneDescription
from grs_agents.sim.instance.task_instance import TaskInstance


@logged_node("generate_sim")
def generate_sim_with_tools(state: RunState, services: Services) -> Update:
    """Write the simulation program, with tools at hand."""
    tools = AuthorTools(state, services)
    calling = ToolCalling(tools.functions_by_name(), services.config.author.steps, services.config.graph)
    source = write_simulation(state, services, calling=calling)
    if isinstance(source, NoReply):
        return {"problem": str(source)}
    return save_program_version(state, services, "simulation", source, "simulation")


@dataclass
class AuthorTools:
    """The tools of one author; their docstrings are what it reads."""

    state: RunState
    services: Services
    _drawn: list[TaskInstance] = field(default_factory=list[TaskInstance])  # of the draft checked last
    _lock: Lock = field(default_factory=Lock)  # a check writes files into the run folder

    def functions_by_name(self) -> dict[str, Callable[..., Any]]:
        """What the author may call; ``render`` only where the author is shown pictures."""
        tools: dict[str, Callable[..., Any]] = {
            "check": self.check,
            "describe_asset": self.describe_asset,
            "measure": self.measure,
        }
        model = self.services.config.model_for_role("simulation").model
        sees = images_from_state(self.state) and self.services.config.end_picture and not is_offline(model)
        return {**tools, "render": self.render} if sees else tools

    def check(self, program: Annotated[str, "The whole draft: Python source with one subclass of Task."]) -> str:
        """Check a draft: its static checks, task instances of several seeds, and how the robot's oracle solves them."""
        task, scene = task_from_state(self.state), scene_from_state(self.state)
        found = check_programs(program, "", task, self.services.library)
        static = [finding for finding in found if finding.program == "simulation"]
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
            instance = self._drawn[0].model_dump(mode="json")
            setup = self.services.library_root_fields
            drawn = self.services.run_tool("render", instance=instance, output=str(output), **setup)
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
        scene = scene_from_state(self.state)
        unknown = [name for name in (first, second) if name and name not in {item.name for item in scene.objects}]
        if unknown:
            return f"The scene has no {unknown[0]!r}; it has {', '.join(item.name for item in scene.objects)}."
        return _measure_distance(scene, first, second) if second else _measure_size(scene, first)


def _measure_size(scene: SceneDescription, name: str) -> str:
    box = next(item.box for item in scene.objects if item.name == name)
    x, y, z = (high - low for low, high in zip(box.low, box.high, strict=True))
    return f"{name} extends {x:.3f} m along x, {y:.3f} m along y and {z:.3f} m along z of the robot frame."


def _measure_distance(scene: SceneDescription, first: str, second: str) -> str:
    start, end = (next(item.position for item in scene.objects if item.name == name) for name in (first, second))
    apart = [b - a for a, b in zip(start, end, strict=True)]
    x, y, z = apart
    return f"{math.hypot(*apart):.3f} m from {first} to {second}: {x:.3f} along x, {y:.3f} along y, {z:.3f} along z."
