"""Captures that hold many frames: recordings and folders of apps, with the choice of a frame behind a colon."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from grs_agents.base.foreign.files import is_folder, list_folder_names, path_exists
from grs_agents.perception.reading.bop import is_bop_source
from grs_agents.perception.reading.frame_assembly import SceneRecording
from grs_agents.perception.reading.phone_captures import (
    is_polycam_folder,
    is_record3d,
    is_stray_folder,
    read_polycam_folder,
    read_record3d,
    read_stray_folder,
)
from grs_agents.perception.reading.picture import SUFFIXES as PICTURES
from grs_agents.perception.reading.ros_bag import SUFFIXES as BAGS
from grs_agents.perception.reading.ros_bag import is_ros_bag, read_ros_bag

Reader = Callable[[Path, str], SceneRecording]
KINDS: tuple[tuple[Callable[[Path], bool], Reader], ...] = (
    (is_ros_bag, read_ros_bag),
    (is_record3d, read_record3d),
    (is_stray_folder, read_stray_folder),
    (is_polycam_folder, read_polycam_folder),
)
"""Recognition by name, and the reader, of each kind."""
FILES = (*BAGS, ".r3d")


@dataclass(frozen=True)
class Capture:
    """A capture, and the frame of it that is meant."""

    path: Path  # an existing file or folder
    choice: str  # its frame, and for a bag its topics; empty for the first
    reader: Reader

    def read(self) -> SceneRecording:
        """Read the chosen frame. Raises InputError: it cannot be read, or the choice names none of it."""
        return self.reader(self.path, self.choice)


def find_capture(source: Path) -> Capture | None:
    """The capture that ``PATH`` or ``PATH:CHOICE`` names; ``None`` for any other scene."""
    path, choice = split_choice(source)
    if not path_exists(path):
        return None
    found = next((Capture(path, choice, reader) for is_kind, reader in KINDS if is_kind(path)), None)
    if found is None and is_folder(path):  # a folder around a single recording, e.g. of rosbag2 without metadata.yaml
        names = list_folder_names(path)
        files = [path / name for name in names if Path(name).suffix.lower() in FILES]
        if len(files) == 1 and not any(Path(name).suffix.lower() in PICTURES for name in names):
            return find_capture(Path(f"{files[0]}:{choice}" if choice else files[0]))
    return found


def split_choice(source: Path) -> tuple[Path, str]:
    """The existing path at the beginning of ``PATH:CHOICE``, and the choice, empty without any."""
    name = str(source)
    if is_bop_source(source) or path_exists(source) or ":" not in name:
        return source, ""
    path, _, choice = name.partition(":")
    while not path_exists(Path(path)) and ":" in choice:
        more, _, choice = choice.partition(":")
        path = f"{path}:{more}"
    return (Path(path), choice) if path_exists(Path(path)) else (source, "")
