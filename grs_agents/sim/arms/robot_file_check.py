"""Safety check of robots' MJCF files before MuJoCo reads them: no element multiplies itself or loads code, and no file
lies outside the robot's own folder. They may be untrusted, as those of task folders are."""

import itertools
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.files import read_bytes
from grs_agents.library.formats.model_file import check_xml_safety
from grs_agents.library.mesh_files import read_png_size

LARGEST: Final = 4_000_000
"""Bytes of an MJCF file; meshes count separately."""
_REFUSED: Final = {
    **dict.fromkeys(("replicate", "composite", "flexcomp", "attach", "model"), "write out what it stands for"),
    **dict.fromkeys(("plugin", "extension"), "remove it: plugins are code"),
    **dict.fromkeys(("deformable", "hfield"), "remove it: an arm is rigid and has no ground"),
    "lengthrange": "remove it: tendons and muscles of the file are not used",
}
"""Short elements that expand to any number of others, simulate during compilation, or load code."""
_FILES: Final = frozenset({"file", *(f"file{side}" for side in ("right", "left", "up", "down", "front", "back"))})
_FOLDERS: Final = ("meshdir", "texturedir", "assetdir")
_MOST: Final[dict[tuple[str, str], float]] = {
    **{("texture", side): 49_152 for side in ("width", "height")},  # a cube of 8,192 px has a height of 49,152
    ("camera", "resolution"): 8_192,
    ("numeric", "size"): 10_000,
    ("user", "dim"): 10_000,
    **{(sensor, "num"): 1_000 for sensor in ("contact", "tactile")},
}
"""Greatest value of an attribute that determines how much memory an element takes."""
_MOST_PIXELS: Final = 67_108_864
"""Pixels of all textures, built-in or read: four of 4,096 x 4,096, as detailed arms have; MuJoCo stores each apart."""
_MOST_SIZE: Final = 1 << 30
"""Greatest ``memory`` of a ``<size>``, bytes."""
_MOST_COUNT: Final = 1_000_000
"""Greatest value of its other attributes."""
_MOST_SAMPLES: Final = 1_000
_MOST_ELEMENTS: Final = {"body": 500, "geom": 2_000}
_MOST_ALL: Final = 20_000
_MOST_INCLUDED: Final = 32
LARGEST_MESH: Final = 1 << 26
LARGEST_MESHES: Final = 1 << 28
"""Bytes of a single dependency, and of all; those of the largest arm of MuJoCo's Menagerie have 40 MB."""


def check_robot_file(path: Path) -> None:
    """Check that MuJoCo may read an arm's file and all its dependencies.

    Raises:
        InputError: it cannot be read, is no XML, holds an element that multiplies itself or loads code, asks for more
            memory than an arm needs, or names a file that is too large or lies outside its folder.
    """
    _Check(path).run()


class _Check:
    """A pass over a file and its includes."""

    def __init__(self, path: Path) -> None:
        self.path, self.root = path, path.resolve().parent
        self.counts: dict[str, int] = {}
        self.bytes = 0
        self.pixels = 0
        self.seen: set[Path] = set()

    def run(self) -> None:
        """See it and all that it names."""
        parts = list(self._read_with_includes(self.path.resolve(), 0))
        folders = {""}
        for _, top in parts:
            for compiler in top.iter("compiler"):
                folders |= {self._check_name(compiler.get(key, "") or ".", "the folder") for key in _FOLDERS}
        for folder in folders:
            self._find_inside(folder or ".", [self.root])
        for home, top in parts:
            for element in top.iter():
                self._check_element(element)
                for key in sorted(_FILES & set(element.keys())):
                    if element.tag != "include":
                        self._check_named_file(element, element.attrib[key], home, folders)

    def _fault(self, message: str, remedy: str) -> InputError:
        return InputError(f"robot {self.path}: {message}", remedy)

    def _read_with_includes(self, file: Path, depth: int) -> Iterator[tuple[Path, Element]]:
        """The folder and the root element of a file and of all that it includes."""
        if file in self.seen:
            return  # MuJoCo refuses a file that is included twice
        self.seen.add(file)
        if len(self.seen) > _MOST_INCLUDED or depth > _MOST_INCLUDED:
            raise self._fault(f"more than {_MOST_INCLUDED} included files", "write them into the file")
        try:
            text = read_bytes(file, "give the path of an MJCF file", LARGEST)
        except InputError as error:
            raise self._fault(f"cannot be read: {error.message}", error.remedy) from error
        check_xml_safety(text, lambda message, remedy: self._fault(f"is no MJCF: {message}", remedy))
        try:
            top = ElementTree.fromstring(text)
        except (ElementTree.ParseError, ValueError) as error:
            raise self._fault(f"is no MJCF: {error}", "correct the file") from error
        yield file.parent, top
        for element in top.iter("include"):
            name = self._check_name(element.get("file", ""), "the included file")
            for included in self._find_inside(name, [file.parent, self.root]):
                yield from self._read_with_includes(included, depth + 1)

    def _check_name(self, name: str, what: str) -> str:
        """A name that is relative and names files alone."""
        if not name or any(letter in name for letter in "\\:\0") or PurePosixPath(name).is_absolute():
            raise self._make_outside_error(f"{what} {name[:120]!r}")
        return name

    def _make_outside_error(self, named: str) -> InputError:
        message = f"{named} lies outside the robot's own folder, or is named by an absolute path"
        return self._fault(message, f"name files inside {self.root}, relative to the robot's file")

    def _find_inside(self, name: str, homes: list[Path]) -> list[Path]:
        """The files of this name in any of ``homes``; none of them may lie outside the robot's folder."""
        found = list(dict.fromkeys((home / name).resolve() for home in homes))
        inside = [file for file in found if file.is_relative_to(self.root)]
        if not inside or any(file.exists() for file in found if file not in inside):
            raise self._make_outside_error(f"the file {name[:120]!r}")
        return [file for file in inside if file.is_file()]

    def _check_element(self, element: Element) -> None:
        tag = element.tag
        if tag in _REFUSED:
            raise self._fault(f"<{tag}> is refused", _REFUSED[tag])
        for name in (tag, ""):
            self.counts[name] = self.counts.get(name, 0) + 1
        if self.counts[tag] > _MOST_ELEMENTS.get(tag, _MOST_ALL) or self.counts[""] > _MOST_ALL:
            most = _MOST_ELEMENTS.get(tag, _MOST_ALL)
            raise self._fault(
                f"it has more than {most} elements{f' <{tag}>' if most < _MOST_ALL else ''}", "simplify it"
            )
        for key, text in element.attrib.items():
            most = _MOST_SAMPLES if key == "nsample" else _MOST.get((tag, key))
            if tag == "size":
                most = _MOST_SIZE if key == "memory" else _MOST_COUNT
            if most is not None and any(number > most for number in _read_numbers(text)):
                remedy = "remove it" if tag == "size" else "give a smaller number"
                raise self._fault(f"{key} of <{tag}> is {text[:40]!r}, more than {most:.0f}", remedy)
        if tag == "texture" and element.get("builtin", "none") != "none":
            (width, *_), (height, *_) = ((*_read_numbers(element.get(side, "")), 0.0) for side in ("width", "height"))
            # MuJoCo gives all but flat textures six square sides, whatever their height says.
            self._count_pixels("a texture", width, height if element.get("type") == "2d" else max(height, 6 * width))

    def _count_pixels(self, what: str, width: float, height: float) -> None:
        self.pixels += round(width * height)
        if self.pixels > _MOST_PIXELS:
            message = f"with {what} of {width:.0f}x{height:.0f} px its textures have more than {_MOST_PIXELS} px in all"
            raise self._fault(message, "make them smaller")

    def _check_named_file(self, element: Element, name: str, home: Path, folders: set[str]) -> None:
        """A mesh or a picture, in each of the places where MuJoCo may look for it."""
        self._check_name(name, "the file")
        bases = [place / folder for place, folder in itertools.product((home, self.root), sorted(folders))]
        sizes: list[tuple[int, int]] = []
        for file in {*self._find_inside(name, bases), *self._find_inside(PurePosixPath(name).name, bases)}:
            if element.tag == "texture" and (found := read_png_size(file)) is not None:
                sizes.append(found)
            if file in self.seen:
                continue
            self.seen.add(file)
            size = file.stat().st_size
            self.bytes += size
            if size > LARGEST_MESH or self.bytes > LARGEST_MESHES:
                bound = f"{LARGEST_MESH} bytes, {LARGEST_MESHES} with the others"
                raise self._fault(f"{name[:120]!r} has {size} bytes, at most {bound}", "simplify it")
        if sizes:  # MuJoCo reads one of the files
            width, height = max(sizes, key=lambda size: size[0] * size[1])
            self._count_pixels(repr(name[:120]), width, height)


def _read_numbers(text: str) -> tuple[float, ...]:
    """The numbers of an attribute; ``memory`` of a size may end in K, M, G or more."""
    numbers: list[float] = []
    for word in text.split():
        unit = "KMGTPE".find(word[-1].upper()) + 1
        try:
            numbers.append(float(word[:-1] if unit else word) * 1024.0**unit)
        except ValueError:  # for MuJoCo to refuse
            continue
    return tuple(numbers)
