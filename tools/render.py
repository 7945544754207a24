"""Draw a task instance by casting rays: a PNG of the scene before or after a rollout, no GL needed."""

import base64
from pathlib import Path
from typing import Any, Literal

from grs_agents.base import Frozen, Vec3
from grs_agents.config import Limits
from grs_agents.errors import GrsError
from grs_agents.files import write_bytes
from grs_agents.sandbox import CallResult
from grs_agents.toolkit import ToolContext, open_library, readable_folders


class Request(Frozen):
    """What to draw.

    Attributes:
        instance: a ``TaskInstance`` as JSON.
        output: the PNG file to write.
        library_roots: asset folders, later ones win; none means the library shipped with GRS.
        robot: ``ur5e``, ``panda`` or the path of an MJCF file.
        moment: after settling, or when the oracle has finished.
        position, target: of the camera and what it looks at, metres, robot frame.
        width, height: pixels.
    """

    instance: dict[str, Any]
    output: str
    library_roots: tuple[str, ...] = ()
    robot: str = "ur5e"
    moment: Literal["start", "end"] = "start"
    position: Vec3 = (1.35, 0.0, 0.75)
    target: Vec3 = (0.45, 0.0, 0.05)
    width: int = 640
    height: int = 480


class Result(Frozen):
    """The picture's file, or why there is none."""

    image: str | None
    error: str = ""


def run(request: Request, context: ToolContext) -> Result:
    """Draw in the sandbox."""
    reads = readable_folders(request.library_roots, request.robot)
    limits = context.limits.model_dump(mode="json")
    frame = {"request": request.model_dump(mode="json"), "limits": limits}
    call: CallResult = context.sandbox.call("render", frame, context.limits, reads)
    if call.value is None:
        return Result(image=None, error=call.error or call.outcome)
    if call.value["png"] is None:
        return Result(image=None, error=call.value["error"])
    return Result(image=str(write_bytes(Path(request.output), base64.b64decode(call.value["png"]))))


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """The worker's part: the picture as base64, since a worker reaches no file of the host."""
    asked, limits = Request.model_validate(request["request"]), Limits.model_validate(request["limits"])
    try:
        return {"png": base64.b64encode(_draw(asked, limits)).decode(), "error": ""}
    except (GrsError, ValueError) as error:
        return {"png": None, "error": str(error)}


def _draw(asked: Request, limits: Limits) -> bytes:
    from grs_agents import sim
    from grs_agents.sim.world import rendering

    instance = sim.TaskInstance.model_validate(asked.instance)
    library = open_library(asked.library_roots)
    sim.set_environment_defaults(library, instance.seed, asked.robot, limits)
    task = sim.InstanceTask(instance)
    env = sim.Environment(task=task, library=library, seed=instance.seed)
    env.reset()
    if asked.moment == "end":
        sim.run_oracle(env, task)
    view = rendering.View(asked.position, asked.target, height=asked.height, width=asked.width)
    picture = rendering.render_views(env.visible_scene, [view])[0]
    return rendering.encode_png(picture.color)
