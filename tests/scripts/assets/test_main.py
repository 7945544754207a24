"""The generator writes what is committed."""

from pathlib import Path

from grs_agents.library.library import Library
from scripts.assets.__main__ import write_library


def test_the_committed_library_is_what_the_code_writes(tmp_path: Path) -> None:
    shipped = Library().roots[0]
    (tmp_path / "stray.urdf").write_text("of an older version")
    write_library(tmp_path)
    written = {file.relative_to(tmp_path).as_posix() for file in tmp_path.rglob("*") if file.is_file()}
    assert written == {file.relative_to(shipped).as_posix() for file in shipped.rglob("*") if file.is_file()}
    for name in sorted(written):  # the letters of the textures depend on the version of OpenCV
        if not name.endswith(".png"):
            assert (tmp_path / name).read_bytes() == (shipped / name).read_bytes(), name
