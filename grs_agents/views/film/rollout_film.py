"""A recorded rollout as images with captions, as a film file, or in MuJoCo's own window."""

import json
import os
import re
import subprocess
import sys
import tempfile
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from io import BytesIO
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from grs_agents.base import Vec3
from grs_agents.base.control_characters import escape_control_chars
from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.files import resolve_output_file, unwritable_error
from grs_agents.base.foreign.run_folder import find_member_file, resolve_member_file
from grs_agents.base.trace.events import Event, Rollout
from grs_agents.base.trace.log import read_events
from grs_agents.library.library import Library
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.views.common.foreign_decoding import decode_in_worker
from grs_agents.views.common.rollout_motion import Motion, find_grasps, read_motion, read_task_instance
from grs_agents.views.common.scene_objects import library_with_run_assets
from grs_agents.views.rerun.viewer import has_display

Image = npt.NDArray[np.uint8]
SUFFIXES = (".webp", ".mp4", ".gif")
HIGH_DEFINITION = (1280, 720)
"""Width and height of a large film, pixels."""
_ANIMATION_RATE = 12.0
"""Largest frame rate of an animated image, 1/s."""
_LAST_FRAME_DURATION = 1500
"""Duration of the last frame of an animation, ms."""
_RAYS = "rays"
_BACKENDS = ("egl", "osmesa", _RAYS) if sys.platform.startswith("linux") else ("", _RAYS)
"""Rendering backends, best first; outside Linux, "" leaves the choice to MuJoCo."""
Caption = tuple[str, str, str]
"""The goal; the action; the outcome."""
_ASSET = re.compile(r"(?<![\w./-])[\w./-]+\.urdf")  # from the start of a word alone: linear in the text
_LETTERS_PER_HEIGHT = 26
"""Height of the picture over the height of a caption's letters."""
_CAPTION_SHADE = 0.45
"""Brightness factor of the picture behind a caption."""
_MAX_CAPTION = 400
"""Characters of a caption that are measured: the film's 720 pixels have room for about 100."""


@dataclass(frozen=True)
class RolloutShot:
    """A rollout and its camera."""

    folder: Path  # the run
    event: Rollout
    library: Library = field(default_factory=Library)  # 3D assets, the run's own laid over
    width: int = 640  # pixels
    height: int = 480
    target: Vec3 = (0.41, 0.0, 0.19)  # the camera's look-at point, m
    distance: float = 1.55  # of the camera from it, m
    azimuth: float = 150.0  # of the viewing direction, degrees
    elevation: float = -30.0

    @property
    def recorded_motion(self) -> Motion:
        """Motion of the objects and of the arm."""
        return read_motion(resolve_member_file(self.folder, self.event.recording or ""))


Take = tuple[RolloutShot, Sequence[float]]
"""A shot, and the times of its frames, s."""


def find_recorded_rollout(events: Sequence[Event], folder: Path, seed: int | None = None) -> Rollout:
    """The last rollout of ``seed`` with a recording; without ``seed``, that of the lowest seed.

    Raises:
        InputError: no rollout, or none of ``seed``, was recorded.
    """
    by_seed = {event.seed: event for event in events if isinstance(event, Rollout)}
    played = {
        number: event
        for number, event in sorted(by_seed.items())
        if event.recording and event.instance and find_member_file(folder, event.recording)
    }
    if not played:
        raise InputError(f"{folder} holds no recorded rollout: no task was played", "name a run that reached the audit")
    if seed is None:
        return next(iter(played.values()))
    if seed not in played:
        raise InputError(f"{folder} holds no rollout of seed {seed}", f"name one of {', '.join(map(str, played))}")
    return played[seed]


def make_rollout_shot(folder: Path, seed: int | None = None, size: tuple[int, int] | None = None) -> RolloutShot:
    """The rollout of ``seed`` (by default the lowest) of the run in ``folder``, filmed in ``size`` (width, height)."""
    rollout = find_recorded_rollout(read_events(folder / "events.jsonl"), folder, seed)
    shot = RolloutShot(folder.resolve(), rollout, library_with_run_assets(folder, Library()))
    return shot if size is None else replace(shot, width=size[0], height=size[1])


def render_takes(takes: Sequence[Take]) -> Iterator[Image]:
    """Images (H, W, 3) of several shots of equal size, in order; a renderer's start costs as much as 30 images.
    Backends are tried in turn."""
    for backend in _BACKENDS:
        started = False
        try:
            for image in _render_with_backend(takes, backend):
                started = True
                yield image
        except InputError:  # damaged run files fail with every backend
            raise
        except GrsError:  # the next backend may work
            if started or backend == _RAYS:
                raise
        else:
            return


def _render_with_backend(takes: Sequence[Take], backend: str) -> Iterator[Image]:
    shot = takes[0][0]
    size = shot.width * shot.height * 3
    with tempfile.TemporaryFile() as errors, _start_render_worker(backend, errors.fileno()) as process:
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(_encode_render_job(takes, rays=backend == _RAYS))
        process.stdin.close()
        try:
            while data := process.stdout.read(size):
                if len(data) == size:
                    yield np.frombuffer(data, np.uint8).reshape(shot.height, shot.width, 3)
        finally:
            process.stdout.close()
            process.wait()  # a closed pipe ends it
        if process.wait() != 0:
            errors.seek(0)
            reason = (errors.read().decode("utf-8", "replace").strip().splitlines() or ["it was killed"])[-1]
            if process.returncode == InputError.exit_status:
                raise InputError(f"the rollout cannot be drawn: {reason}")
            raise GrsError(f"the rollout cannot be drawn: {reason}", "see `grs doctor`")


_NEEDED = re.compile(
    "(PATH|HOME|USER|LANG|TZ|TMPDIR|TEMP|TMP|SYSTEMROOT|WINDIR|DISPLAY|WAYLAND_DISPLAY|XAUTHORITY|VIRTUAL_ENV)$"
    "|(LC|LD|DYLD|XDG|PYTHON|PYOPENGL|MUJOCO|LIBGL|MESA|GALLIUM|EGL|__EGL|__GLX?|VK|NVIDIA|CUDA|OMP|OPENBLAS|MKL)_?"
)
"""Variables read by interpreters and graphics libraries. The process decodes untrusted files, so it gets no keys."""
_SECRET = re.compile("KEY|TOKEN|SECRET|PASS|CREDENTIAL", re.IGNORECASE)


def _start_render_worker(backend: str, errors: int) -> subprocess.Popen[bytes]:
    environment = {
        key: value
        for key, value in os.environ.items()
        if _NEEDED.match(key) and not _SECRET.search(key) and key != "MUJOCO_GL"
    }
    if backend:
        environment["MUJOCO_GL"] = "disabled" if backend == _RAYS else backend
    command = [sys.executable, "-m", "grs_agents.views.film.worker"]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, env=environment)


def _encode_render_job(takes: Sequence[Take], rays: bool = False, window: bool = False) -> bytes:
    rollouts = [
        {
            "instance": str(resolve_member_file(shot.folder, shot.event.instance or "")),
            "recording": str(resolve_member_file(shot.folder, shot.event.recording or "")),
            "roots": [str(root) for root in shot.library.roots],
            "seconds": list(seconds),
        }
        for shot, seconds in takes
    ]
    first = asdict(takes[0][0])
    look = {key: first[key] for key in ("width", "height", "target", "distance", "azimuth", "elevation")}
    return json.dumps({**look, "rollouts": rollouts, "rays": rays, "window": window}).encode()


def write_film(shot: RolloutShot, path: Path, rate: float = 15.0, show: Callable[[str], None] | None = None) -> int:
    """Write the rollout in real time to a .webp, .mp4 or .gif file. Returns: number of frames."""
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"cannot write a film to {path.name}", f"name a file that ends in {' or '.join(SUFFIXES)}")
    if not path.parent.is_dir():
        raise InputError(f"the folder of {path} does not exist", "name a file in a folder that does")
    path = resolve_output_file(path)
    animated = path.suffix.lower() != ".mp4"
    rate = min(rate, _ANIMATION_RATE) if animated else rate
    try:
        with decode_in_worker(shot.folder):
            images = render_film_frames(shot, rate, show)
            if not animated:
                import cv2

                size = (shot.width, shot.height)
                for codec in ("vp09", "mp4v"):  # VP9, which browsers play, else MPEG-4
                    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), rate, size)
                    if writer.isOpened():
                        break
                else:
                    raise InputError(
                        f"cannot write {path}: OpenCV has no encoder for it", "name a .gif, or a writable folder"
                    )
                count = 0
                for image in images:
                    writer.write(np.ascontiguousarray(image[:, :, ::-1]))
                    count += 1
                writer.release()
                return count
            frames = list(images)
        path.write_bytes(encode_animation(frames, rate, path.suffix.lower()[1:]))
    except OSError as error:
        raise unwritable_error(path, error) from error
    return len(frames)


def render_film_frames(shot: RolloutShot, rate: float, show: Callable[[str], None] | None = None) -> Iterator[Image]:
    """Images of ``shot`` with captions, ``rate`` per second; ``show`` is called with a progress text for each."""
    take = make_film_take(shot, rate)
    images = draw_take_captions(take, render_takes([take]))  # reads and checks the files now, before a film is opened

    def show_progress() -> Iterator[Image]:
        for number, image in enumerate(images, start=1):
            if show is not None:
                show(f"drawing frame {number} of {len(take[1])}")
            yield image

    return show_progress()


def make_film_take(shot: RolloutShot, rate: float) -> Take:
    """The frame times of a film with ``rate`` images per second."""
    return shot, [frame / rate for frame in range(int(shot.recorded_motion.duration_seconds * rate) + 1)]


def draw_take_captions(take: Take, images: Iterator[Image]) -> Iterator[Image]:
    """Images (H, W, 3) of a take with a caption over the lower edge of each."""
    shot, seconds = take
    instance = read_task_instance(resolve_member_file(shot.folder, shot.event.instance or ""))
    captions = write_moment_captions(shot.event, instance, shot.recorded_motion, seconds)
    return (draw_caption(image, caption) for image, caption in zip(images, captions, strict=False))


def encode_animation(images: Sequence[Image], rate: float, kind: str) -> bytes:
    """Images (H, W, 3) as an animated ``webp`` or ``gif`` that loops after a pause on its last frame."""
    frames = [Pillow.fromarray(image) for image in images]
    if kind == "gif":
        frames = [frame.quantize(128, dither=Pillow.Dither.NONE) for frame in frames]
    durations = [*[round(1000 / rate)] * (len(frames) - 1), _LAST_FRAME_DURATION]
    options = {"optimize": False} if kind == "gif" else {"quality": 60, "method": 2, "kmin": 400, "kmax": 500}
    file = BytesIO()
    frames[0].save(file, kind, save_all=True, append_images=frames[1:], duration=durations, loop=0, **options)
    return file.getvalue()


def play_in_mujoco_window(shot: RolloutShot) -> int:
    """Play the rollout in MuJoCo's window until it is closed."""
    if not has_display():
        raise InputError(
            "no display to open MuJoCo's window on", "write a film instead: grs report RUN --out film.webp"
        )
    with tempfile.TemporaryFile() as errors, _start_render_worker("", errors.fileno()) as process:
        process.communicate(_encode_render_job([(shot, ())], window=True))
        errors.seek(0)
        lines = errors.read().decode("utf-8", "replace").strip().splitlines()
    if process.returncode > 0:
        mac = ", or run: mjpython -m grs_agents replay --mujoco" if sys.platform == "darwin" else ""
        reason = lines[-1] if lines else f"exit status {process.returncode}"
        raise GrsError(
            f"MuJoCo's window cannot be opened: {reason}", f"write a film instead: grs report RUN --out film.webp{mac}"
        )
    return process.returncode


def write_moment_captions(
    event: Rollout, instance: TaskInstance, motion: Motion, seconds: Sequence[float]
) -> Iterator[Caption]:
    """The captions at ``seconds`` (simulated) of a rollout."""
    grasps = find_grasps(motion)
    names = {f"object_{item.id}": _asset_name_as_words(item.asset) for item in instance.objects}
    cause = _ASSET.sub(lambda match: _asset_name_as_words(match[0]), event.cause[:_MAX_CAPTION])
    end = motion.times[grasps[-1].end] if grasps else motion.duration_seconds
    for moment in seconds:
        frame = motion.frame_index_at(moment)
        grasp = next((grasp for grasp in grasps if frame <= grasp.end), grasps[-1] if grasps else None)
        ended = moment >= end
        if grasp is None:
            action = "nothing is picked up" if instance.primitive == "pick_place" else instance.primitive
        else:
            verb = "reaches for" if frame < grasp.start else "carries" if frame < grasp.end else "has placed"
            number = grasps.index(grasp) + 1
            action = f"action {number} of {len(grasps)}: {verb} {names.get(grasp.body, grasp.body)}"
        outcome = f"{event.outcome}, reward {event.reward:.2f}" if ended else f"{moment:.1f} s"
        held = grasp.body.removeprefix("object_") if grasp else ""
        goals_of_held = (goal for goal in instance.goals if held in map(str, goal.objects))
        goal = next(goals_of_held, next(iter(instance.goals), None))
        words = instance.instruction or (goal.language if goal is not None else instance.task)
        yield words, (cause if ended else "") or action, outcome


def _asset_name_as_words(asset: str) -> str:
    """``HOPE/TomatoSauce.urdf`` as ``tomato sauce``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|_", " ", Path(asset).stem).lower()


def draw_caption(image: Image, caption: Caption) -> Image:
    """An image (H, W, 3) with its caption over the lower edge."""
    height, width = image.shape[:2]
    size = max(9, height // _LETTERS_PER_HEIGHT)
    font, line, margin = ImageFont.load_default(size), round(1.4 * size), round(0.6 * size)
    shown = image.copy()
    band = shown[height - 2 * line - 2 * margin :]
    band[:] = (band * _CAPTION_SHADE).astype(np.uint8)
    picture = Pillow.fromarray(shown)
    draw = ImageDraw.Draw(picture)
    goal, action, outcome = (escape_control_chars(text[:_MAX_CAPTION]) for text in caption)
    right = width - margin - draw.textlength(outcome, font)
    top = height - 2 * line - margin
    draw.text((margin, top), _shorten_to_width(draw, goal, font, width - 2 * margin), (255, 255, 255), font)
    draw.text((margin, top + line), _shorten_to_width(draw, action, font, right - 2 * margin), (255, 214, 90), font)
    draw.text((right, top + line), outcome, (255, 255, 255), font)
    return np.asarray(picture)


def _shorten_to_width(
    draw: ImageDraw.ImageDraw, text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: float
) -> str:
    """``text`` shortened to ``width`` pixels, with an ellipsis."""
    if draw.textlength(text, font) <= width:
        return text
    length = bisect_right(range(1, len(text)), width, key=lambda count: draw.textlength(f"{text[:count]}…", font))
    return f"{text[:length].rstrip()}…"
