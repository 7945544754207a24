"""What stands under the picture of a film: the goal, the action that is going on, and once it is over the reward, and
why goals do not hold."""

import re
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from grs_agents.base.terminal.control_characters import escape_control_chars
from grs_agents.base.trace.events import Rollout
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.views.common.rollout_motion import Grasp, Motion, find_grasps

Picture = npt.NDArray[np.uint8]
Caption = tuple[str, str, str]
"""The goal; the action; the outcome."""
_ASSET = re.compile(r"(?<![\w./-])[\w./-]+\.urdf")  # from the start of a word alone: linear in the text
_SHARE = 26
"""Letters are as high as the picture divided by this."""
_SHADE = 0.45
"""How bright the picture stays behind the letters."""
_LONGEST = 400
"""Characters of a text that are measured: the film's 720 pixels have room for about 100."""


def write_moment_captions(
    event: Rollout, instance: TaskInstance, motion: Motion, seconds: Sequence[float]
) -> Iterator[Caption]:
    """The caption of each moment (simulated seconds) of a rollout."""
    grasps = find_grasps(motion)
    cause = _ASSET.sub(lambda match: _asset_name_as_words(match[0]), event.cause[:_LONGEST])
    over = motion.times[grasps[-1].end] if grasps else motion.duration_seconds
    for moment in seconds:
        frame = motion.frame_index_at(moment)
        current = next((grasp for grasp in grasps if frame <= grasp.end), grasps[-1] if grasps else None)
        ended = moment >= over
        outcome = f"{event.outcome}, reward {event.reward:.2f}" if ended else f"{moment:.1f} s"
        action = (cause if ended else "") or _describe_robot_action(instance, grasps, current, frame)
        yield _find_goal_sentence(instance, current), action, outcome


def _find_goal_sentence(instance: TaskInstance, grasp: Grasp | None) -> str:
    """The sentence of the goal that the grasped body is for; of the first goal without one."""
    held = grasp.body.removeprefix("object_") if grasp else ""
    about = (goal for goal in instance.goals if held in map(str, goal.objects))
    goal = next(about, next(iter(instance.goals), None))
    return goal.language if goal is not None else instance.task


def _describe_robot_action(instance: TaskInstance, grasps: list[Grasp], grasp: Grasp | None, frame: int) -> str:
    if grasp is None:
        return instance.primitive.replace("_", " ")
    names = {f"object_{item.id}": _asset_name_as_words(item.asset) for item in instance.objects}
    does = "reaches for" if frame < grasp.start else "carries" if frame < grasp.end else "has placed"
    return f"action {grasps.index(grasp) + 1} of {len(grasps)}: {does} {names.get(grasp.body, grasp.body)}"


def _asset_name_as_words(asset: str) -> str:
    """``HOPE/TomatoSauce.urdf`` as ``tomato sauce``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|_", " ", Path(asset).stem).lower()


def draw_captions(images: Iterator[Picture], captions: Iterator[Caption]) -> Iterator[Picture]:
    """The pictures (H, W, 3), each with its caption over its lower edge."""
    for image, caption in zip(images, captions, strict=False):
        yield _draw_caption(image, caption)


def _draw_caption(image: Picture, caption: Caption) -> Picture:
    height, width = image.shape[:2]
    size = max(9, height // _SHARE)
    font, line, margin = ImageFont.load_default(size), round(1.4 * size), round(0.6 * size)
    shown = image.copy()
    band = shown[height - 2 * line - 2 * margin :]
    band[:] = (band * _SHADE).astype(np.uint8)
    picture = Image.fromarray(shown)
    draw = ImageDraw.Draw(picture)
    goal, action, outcome = (escape_control_chars(text[:_LONGEST]) for text in caption)
    right = width - margin - draw.textlength(outcome, font)
    top = height - 2 * line - margin
    draw.text((margin, top), _shorten_to_width(draw, goal, font, width - 2 * margin), (255, 255, 255), font)
    draw.text((margin, top + line), _shorten_to_width(draw, action, font, right - 2 * margin), (255, 214, 90), font)
    draw.text((right, top + line), outcome, (255, 255, 255), font)
    return np.asarray(picture)


def _shorten_to_width(
    draw: ImageDraw.ImageDraw, text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: float
) -> str:
    """``text``, cut off where it is wider than ``width`` pixels."""
    if draw.textlength(text, font) <= width:
        return text
    most = bisect_right(range(1, len(text)), width, key=lambda count: draw.textlength(f"{text[:count]}…", font))
    return f"{text[:most].rstrip()}…"
