"""Pictures of a recorded rollout: single ones, a film in a file, or MuJoCo's own window."""

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from io import BytesIO
from pathlib import Path

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.files import resolve_output_file, unwritable_error
from grs_agents.base.foreign.run_folder import find_member_file, resolve_member_file
from grs_agents.base.trace.events import Event, Rollout
from grs_agents.base.trace.log import read_events
from grs_agents.library.library import Library
from grs_agents.views.common.foreign_decoding import decode_in_worker
from grs_agents.views.common.rollout_motion import Motion, read_motion, read_task_instance
from grs_agents.views.common.scene_objects import library_with_run_assets
from grs_agents.views.film.captions import draw_captions, write_moment_captions
from grs_agents.views.rerun.viewer import has_display

Image = npt.NDArray[np.uint8]
SUFFIXES = (".webp", ".mp4", ".gif")
HIGH_DEFINITION = (1280, 720)
"""Width and height of a large film, pixels."""
_ANIMATION_RATE = 12.0
"""Frames a second of a film that is no video."""
_STANDS = 1500
"""Milliseconds that its last picture stands."""
_RAYS = "rays"


@dataclass(frozen=True)
class RolloutShot:
    """A rollout and how to look at it."""

    folder: Path  # the run
    event: Rollout
    library: Library = field(default_factory=Library)  # 3D assets, the run's own laid over
    width: int = 640  # pixels
    height: int = 480
    target: Vec3 = (0.41, 0.0, 0.19)  # what the camera looks at, m
    distance: float = 1.55  # of the camera from it, m
    azimuth: float = 150.0  # of the direction in which the camera looks, degrees
    elevation: float = -30.0

    @property
    def recorded_motion(self) -> Motion:
        """What moved."""
        return read_motion(resolve_member_file(self.folder, self.event.recording or ""))


Take = tuple[RolloutShot, Sequence[float]]
"""A shot, and the moments of it that are drawn, s."""


def find_recorded_rollout(events: Sequence[Event], folder: Path, seed: int | None = None) -> Rollout:
    """The rollout of the run's last audit that used ``seed``, or its first one, of which the recording is there."""
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
    """The rollout of ``seed``, or the first, of the run in ``folder``, to be filmed in ``size`` (width, height)."""
    rollout = find_recorded_rollout(read_events(folder / "events.jsonl"), folder, seed)
    shot = RolloutShot(folder.resolve(), rollout, library_with_run_assets(folder, Library()))
    return shot if size is None else replace(shot, width=size[0], height=size[1])


def render_takes(takes: Sequence[Take]) -> Iterator[Image]:
    """The pictures (H, W, 3) of several shots of one size, one after the other: to begin costs as much as 30 pictures.
    They are drawn with EGL, OSMesa, or rays where neither is there."""
    for backend in _rendering_backends():
        drawn = False
        try:
            for image in _render_with_backend(takes, backend):
                drawn = True
                yield image
        except InputError:  # no way of drawing mends the files of a run
            raise
        except GrsError:  # whatever is amiss, the next way of drawing may not need it
            if drawn or backend == _RAYS:
                raise
        else:
            return


def _rendering_backends() -> tuple[str, ...]:
    """What to draw with, best first; MuJoCo's own choice outside Linux."""
    return ("egl", "osmesa", _RAYS) if sys.platform.startswith("linux") else ("", _RAYS)


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
"""The variables that an interpreter and a graphics library look at. The process draws strangers' files: no keys."""
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
    """Write the rollout in real time to a .webp, .mp4 or .gif file, and return the number of frames."""
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
                return _write_mp4(images, path, rate, shot)
            frames = list(images)
        path.write_bytes(encode_animation(frames, rate, path.suffix.lower()[1:]))
    except OSError as error:
        raise unwritable_error(path, error) from error
    return len(frames)


def render_film_frames(shot: RolloutShot, rate: float, show: Callable[[str], None] | None = None) -> Iterator[Image]:
    """The pictures of ``shot`` with captions, ``rate`` of them a second; ``show`` is told what is drawn."""
    take = make_film_take(shot, rate)
    return draw_take_captions(take, _report_frame_progress(render_takes([take]), len(take[1]), show))


def make_film_take(shot: RolloutShot, rate: float) -> Take:
    """The moments of a film with ``rate`` pictures a second."""
    return shot, [frame / rate for frame in range(int(shot.recorded_motion.duration_seconds * rate) + 1)]


def draw_take_captions(take: Take, images: Iterator[Image]) -> Iterator[Image]:
    """The pictures of a take, each with its caption."""
    shot, seconds = take
    instance = read_task_instance(resolve_member_file(shot.folder, shot.event.instance or ""))
    return draw_captions(images, write_moment_captions(shot.event, instance, shot.recorded_motion, seconds))


def _report_frame_progress(images: Iterator[Image], total: int, show: Callable[[str], None] | None) -> Iterator[Image]:
    for number, image in enumerate(images, start=1):
        if show is not None:
            show(f"drawing frame {number} of {total}")
        yield image


def _write_mp4(images: Iterator[Image], path: Path, rate: float, shot: RolloutShot) -> int:
    """VP9, which browsers play; where OpenCV cannot, MPEG-4."""
    import cv2

    for name in ("vp09", "mp4v"):
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*name), rate, (shot.width, shot.height))
        if writer.isOpened():
            break
    else:
        raise InputError(f"cannot write {path}: OpenCV has no encoder for it", "name a .gif, or a writable folder")
    count = 0
    for image in images:
        writer.write(np.ascontiguousarray(image[:, :, ::-1]))
        count += 1
    writer.release()
    return count


def encode_animation(images: Sequence[Image], rate: float, kind: str) -> bytes:
    """Pictures (H, W, 3) as an animated ``webp`` or ``gif`` that begins again after its last one stood for a while."""
    from PIL import Image as Pillow

    frames = [Pillow.fromarray(image) for image in images]
    if kind == "gif":
        frames = [frame.quantize(128, dither=Pillow.Dither.NONE) for frame in frames]
    durations = [*[round(1000 / rate)] * (len(frames) - 1), _STANDS]
    more = {"optimize": False} if kind == "gif" else {"quality": 60, "method": 2, "kmin": 400, "kmax": 500}
    file = BytesIO()
    frames[0].save(file, kind, save_all=True, append_images=frames[1:], duration=durations, loop=0, **more)
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
