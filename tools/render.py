"""Draw a task instance by casting rays: a PNG of the scene before or after a rollout, no GL needed."""

import base64
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field

from grs_agents.base import Frozen, Pose, Vec3
from grs_agents.base.config.schema import Limits
from grs_agents.base.errors import GrsError
from grs_agents.base.files import write_bytes
from grs_agents.library.library import Library
from grs_agents.sandbox.protocol.report import CallResult
from grs_agents.toolkit import ToolContext, ToolRequest, list_folders_to_read, open_library

if TYPE_CHECKING:
    from grs_agents.sim import TaskInstance
    from grs_agents.sim.rendering.cameras import LookAtCamera, RenderedImage, VisibleScene

Box = tuple[int, int, int, int]
MARK = (255, 0, 255)
"""The colour of outlines."""
_LINE = 2
"""Their width in pixels."""
_PHOTO_SIDE = 800
"""Longer side of a picture through the photo's camera, in pixels."""


class Request(ToolRequest):
    """What to draw."""

    instance: dict[str, Any]
    """A ``TaskInstance`` as JSON."""
    output: str
    """The PNG file to write."""
    library_roots: tuple[str, ...] = ()
    """Asset folders, later ones win; none means the library shipped with GRS."""
    moment: Literal["start", "end"] = "start"
    """After settling, or when the oracle has finished."""
    poses: dict[int, Pose] | None = None
    """Positions (metres) and rotations (xyzw) of objects by id, to draw them there; nothing is simulated then."""
    textured: bool = False
    """With textures, light and table as films show them, without the robot; nothing is simulated then."""
    marked: tuple[int, ...] = ()
    """Ids of objects to outline."""
    boxed: tuple[int, ...] = ()
    """Ids of objects whose boxes are returned without an outline."""
    from_photo: bool = False
    """Through the photo's camera, which the instance must have, with textures; the other lens is ignored. The picture
    is wider than the photo if an object of the task lies beyond its edge."""
    position: Vec3 = (1.35, 0.0, 0.75)
    """Of the camera, metres, robot frame."""
    target: Vec3 = (0.45, 0.0, 0.05)
    """What the camera looks at, metres, robot frame."""
    width: int = 640
    """Of the picture, in pixels."""
    height: int = 480
    """Of the picture, in pixels."""


class Result(Frozen):
    """The picture's file, or why there is none; and where the marked and boxed objects that can be seen are in it.

    Attributes:
        image: the file.
        boxes: left, top, right and bottom pixel by object id.
    """

    image: str | None
    boxes: dict[int, Box] = Field(default_factory=dict[int, Box])
    error: str = ""


def run(request: Request, context: ToolContext) -> Result:
    """Draw in the sandbox."""
    reads = list_folders_to_read(request.library_roots, str(request.instance.get("robot", "")))
    limits = context.limits.model_dump(mode="json")
    frame = {"request": request.model_dump(mode="json"), "limits": limits}
    call: CallResult = context.sandbox.call("render", frame, context.limits, reads)
    if call.value is None:
        return Result(image=None, error=call.error or call.outcome)
    if call.value["png"] is None:
        return Result(image=None, error=call.value["error"])
    image = write_bytes(Path(request.output), base64.b64decode(call.value["png"]))
    return Result(image=str(image), boxes=call.value["boxes"])


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """The worker's part: the picture as base64, since a worker reaches no file of the host."""
    asked, limits = Request.model_validate(request["request"]), Limits.model_validate(request["limits"])
    try:
        png, boxes = _draw_scene(asked, limits)
        return {"png": base64.b64encode(png).decode(), "error": "", "boxes": boxes}
    except (GrsError, ValueError) as error:
        return {"png": None, "error": str(error)}


def _draw_scene(asked: Request, limits: Limits) -> tuple[bytes, dict[int, Box]]:
    from grs_agents import sim
    from grs_agents.sim.rendering.cameras import LookAtCamera, encode_png
    from grs_agents.sim.rendering.pictures import render_views

    instance = sim.TaskInstance.model_validate(asked.instance)
    library = open_library(asked.library_roots)
    sim.set_environment_defaults(library, instance.seed, instance.robot, limits, hand=instance.hand)
    view = LookAtCamera(asked.position, asked.target, height=asked.height, width=asked.width)
    if asked.poses is not None:
        placed = [item.model_copy(update={"pose": asked.poses.get(item.id, item.pose)}) for item in instance.objects]
        instance = instance.model_copy(update={"objects": tuple(placed)})
    if asked.textured or asked.from_photo:
        picture = _draw_textured(instance, library, None if asked.from_photo else view)
    else:
        picture = render_views(_prepare_visible_scene(asked, instance, library), [view])[0]
    boxes = {number: box for number in asked.marked if (box := _outline_object(picture, number)) is not None}
    boxes |= {number: box for number in asked.boxed if (box := _find_box(picture.owner == number)) is not None}
    return encode_png(picture.color), boxes


def _draw_textured(instance: "TaskInstance", library: Library, view: "LookAtCamera | None") -> "RenderedImage":
    """Draw through the lens of ``view``, or of the photo's camera."""
    import numpy as np

    from grs_agents.sim.rendering.cameras import lens_from_field_of_view, photo_lens_and_pose, view_pose
    from grs_agents.sim.rendering.pictures import render_from_camera
    from grs_agents.sim.rendering.stage import scene_props_from_instance
    from grs_agents.sim.world.footprints import object_prism_at_pose
    from grs_agents.sim.world.spec import load_object_model

    props = replace(scene_props_from_instance(instance), arm=None)
    if view is None:
        if instance.camera is None:
            raise ValueError("the instance has no camera of a photo")
        prisms = [object_prism_at_pose(load_object_model(item, library), item.pose) for item in instance.task_objects]
        shown = np.array([(*point, z) for prism in prisms for point in prism.outline for z in (prism.low, prism.high)])
        return render_from_camera(props, library, *photo_lens_and_pose(instance.camera, _PHOTO_SIDE, shown))
    lens = lens_from_field_of_view(view.field_of_view, view.height, view.width)
    return render_from_camera(props, library, lens, view_pose(view))


def _prepare_visible_scene(asked: Request, instance: "TaskInstance", library: Library) -> "VisibleScene":
    """The scene at the poses asked for, else after settling or after the rollout."""
    from grs_agents.sim.arms.registry import get_arm
    from grs_agents.sim.rendering.cameras import VisibleScene
    from grs_agents.sim.tabletop_episode import follow_oracle, open_instance_episode

    if asked.poses is not None:
        arm = get_arm(instance.robot, instance.mounted_hand)
        return VisibleScene(instance.objects, library, arm=arm, background=instance.background)
    episode = open_instance_episode(instance, library)
    episode.reset()
    if asked.moment == "end":
        follow_oracle(episode.task.oracle(episode.sim), episode)
    return episode.sim.visible_scene


def _outline_object(picture: "RenderedImage", number: int) -> Box | None:
    """Paint the pixels around an object; gives its box in pixels, None where it is not seen."""
    import numpy as np

    mask = picture.owner == number
    box = _find_box(mask)
    if box is None:
        return None
    padded = np.pad(mask, _LINE)
    around = [
        padded[down : down + mask.shape[0], right : right + mask.shape[1]]
        for down in range(2 * _LINE + 1)
        for right in range(2 * _LINE + 1)
    ]
    picture.color[np.any(around, axis=0) & ~mask] = MARK
    return box


def _find_box(mask: Any) -> Box | None:
    """Box of the pixels of a mask (H, W); None for an empty mask."""
    rows, columns = mask.any(axis=1).nonzero()[0], mask.any(axis=0).nonzero()[0]
    return (int(columns[0]), int(rows[0]), int(columns[-1]), int(rows[-1])) if rows.size else None
