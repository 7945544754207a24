"""Names of files that strangers wrote: only what lies inside the source is opened, and only what is small enough."""

from pathlib import Path
from typing import Final
from urllib.parse import unquote

from grs_agents.library.importing.types import RefusedError

_CONTROL: Final = 32


class SourceFolder:
    """The folder of a source; files are named relative to it, stay inside it and have at most ``most`` bytes."""

    def __init__(self, root: Path, most: int) -> None:
        self.root, self.most = root.resolve(), most

    def resolve_file(self, name: str, beside: str = "") -> Path:
        """The file called ``name``, relative to the file ``beside`` (itself relative to the root)."""
        by = f"{beside or self.root.name} names "
        if not name or name.startswith(("/", "~")) or any(ord(letter) < _CONTROL or letter in ":\\" for letter in name):
            raise RefusedError(f"{by}{name[:120]!r}, which is no relative path", "name files relative to the file")
        resolved = ((self.root / beside).parent / name if beside else self.root / name).resolve()
        if not resolved.is_relative_to(self.root):
            raise RefusedError(f"{by}{name[:120]!r}, which leaves the source folder", "keep files inside the source")
        if not resolved.is_file():
            raise RefusedError(f"{by}{name[:120]!r}, which does not exist", "put the file there")
        if (size := resolved.stat().st_size) > self.most:
            raise RefusedError(f"{name[:120]} has {size} bytes, {self.most} are the most", "simplify it")
        return resolved

    def relative_file_name(self, path: Path) -> str:
        """The name of a file inside the folder."""
        return path.resolve().relative_to(self.root).as_posix()


def find_obj_material_files(folder: SourceFolder, obj: str) -> tuple[list[str], list[str]]:
    """The material files and colour pictures that an OBJ file names, relative to the folder."""
    materials: list[str] = []
    pictures: list[str] = []
    with folder.resolve_file(obj).open(encoding="utf-8", errors="replace") as lines:
        names = [row.split(None, 1)[1].strip() for row in lines if row.startswith("mtllib ") and row.split()[1:]]
    for name in names:
        path = folder.resolve_file(name, obj)
        materials.append(folder.relative_file_name(path))
        for line in path.read_text("utf-8", errors="replace").splitlines():
            words = line.split()
            if len(words) > 1 and words[0].lower() == "map_kd":
                picture = folder.resolve_file(unquote(words[-1]), materials[-1])
                pictures.append(folder.relative_file_name(picture))
    return materials, pictures
