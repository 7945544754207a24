"""A user's arm in URDF, converted to MJCF with its meshes beside it: the rest of the program reads MJCF alone."""

import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Final
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from pydantic import Field, TypeAdapter, ValidationError

from grs_agents.base.config.schema import Limits
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes
from grs_agents.base.foreign.files import read_bytes
from grs_agents.library.formats.model_file import check_xml_safety
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.sandbox.host.foreign_reader import ForeignReader
from grs_agents.sim.arms.robot_file_check import LARGEST, LARGEST_MESH, LARGEST_MESHES, check_robot_file

URDF: Final = ".urdf"
SPEEDS: Final = "grs_speeds"
"""Name of the custom text in MJCF that holds the greatest speeds of a URDF's joints as JSON."""
SLOWEST: Final = 1e-3
"""Least speed limit of a joint, rad/s or m/s: a motion takes a row of its path each time step."""
_WORKER: Final = "grs_agents.sim.arms.urdf_worker"
_LEVELS: Final = 4
"""Folders around a URDF in which its meshes are sought: those of a package in a repository of packages."""
_CONVERSION: Final = Limits(cpu_seconds=120, wall_seconds=300, memory_mib=2048, scratch_mib=1, output_mib=256)
"""24 MB of COLLADA take 3 s."""
_folders: list["tempfile.TemporaryDirectory[str]"] = []  # of this process's conversions


def find_mjcf(robot: Path) -> Path:
    """The MJCF file of an arm, checked: its own, or that of its converted URDF.

    Raises ``InputError`` if MuJoCo may not read it, see ``check_robot_file``, or the URDF cannot be converted.
    """
    if robot.suffix.lower() == URDF:
        try:
            status = robot.stat()
        except OSError as error:
            raise InputError(f"robot {robot}: cannot be read: {error.strerror}", "give the path of a URDF") from error
        robot = _convert_once(robot.resolve(), status.st_mtime_ns, status.st_size)
    check_robot_file(robot)
    return robot


def read_joint_speeds(spec: Any, robot: str) -> dict[str, float]:
    """Greatest speeds of joints by name, rad/s or m/s, that the spec of a converted URDF keeps.
    Raises ``InputError``: they are no finite numbers of at least ``SLOWEST``."""
    for text in spec.texts:
        if str(text.name) == SPEEDS:
            try:
                return TypeAdapter(dict[str, Annotated[float, Field(ge=SLOWEST, allow_inf_nan=False)]]).validate_json(
                    text.data
                )
            except ValidationError as error:
                raise InputError(f"robot {robot}: its text {SPEEDS!r} holds no speeds", "remove it") from error
    return {}


def parse_urdf(text: bytes) -> Element:
    """The root element of a safe URDF; prefixes stay in the names, as many files bind them nowhere."""
    builder, parser = TreeBuilder(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.Parse(text, True)
    return builder.close()


@lru_cache(maxsize=16)
def _convert_once(robot: Path, _changed: int, _size: int) -> Path:
    root, meshes = _find_meshes(robot)
    request = {"robot": str(robot), "root": str(root), "meshes": meshes}
    with ForeignReader(_WORKER, [robot, *(root / file for file in meshes.values())], _CONVERSION) as reader:
        files = reader.read(request, f"robot {robot}").blobs
    folder = tempfile.TemporaryDirectory(prefix="grs-urdf-")
    _folders.append(folder)
    for name, data in files.items():
        write_bytes(Path(folder.name) / Path(name).name, data)
    return Path(folder.name) / f"{robot.stem}.xml"


def _find_meshes(robot: Path) -> tuple[Path, dict[str, str]]:
    """The innermost folder with all meshes of a URDF, and their files in it by their names in the URDF."""

    def fault(message: str, remedy: str) -> InputError:
        return InputError(f"robot {robot}: {message}", remedy)

    text = read_bytes(robot, "give the path of a URDF", LARGEST)
    check_xml_safety(text, lambda message, remedy: fault(f"is no URDF: {message}", remedy))
    top = parse_urdf(text)
    if top.tag != "robot":
        raise fault(f"is no URDF: its root is <{top.tag}>", "give a file whose root is <robot>")
    if any(element.tag.startswith("xacro:") for element in top.iter()):
        raise fault("holds macros of xacro", "expand it: xacro arm.urdf.xacro > arm.urdf")
    names = list(dict.fromkeys(mesh.get("filename", "") for mesh in top.iterfind("link/*/geometry/mesh")))
    around = [folder for folder in robot.parents[1 : _LEVELS + 1] if folder != Path(folder.anchor)]
    root, missing = robot.parent, ""
    for root in (robot.parent, *around):
        source, files = SourceFolder(root, LARGEST_MESH), dict[str, Path]()
        for name in names:
            file = source.search_file(name, robot.relative_to(root).as_posix())
            if file is None:
                missing = name
                break
            files[name] = file
        else:
            sizes = {file: file.stat().st_size for file in files.values()}
            if max(sizes.values(), default=0) > LARGEST_MESH or sum(sizes.values()) > LARGEST_MESHES:
                size = f"{max(sizes.values())} bytes, {sum(sizes.values())} in all"
                bound = f"{LARGEST_MESH}, {LARGEST_MESHES} in all"
                raise fault(f"a mesh has {size}, at most {bound}", "simplify it")
            return source.root, {name: file.relative_to(source.root).as_posix() for name, file in files.items()}
    raise fault(f"its mesh {missing[:200]!r} is nowhere between {robot.parent} and {root}", "put it into its package")
