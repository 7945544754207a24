"""Public cases of a user's own parts: graphs, programs, folders with blanks, and data sets that name an environment."""

import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from grs_agents.runs.record import read_record
from tests.cases.public_cases import copy_case
from tests.cli.command import Done, grs
from tests.needs import needs


def run_graph(case: str, name: str, scene: Path, tmp_path: Path) -> Done:
    """``grs run`` of a scene with a graph of a case's content folder."""
    content = copy_case(case, tmp_path)
    arguments = ("--content", str(content), "run", str(scene), "--set", f"graph={name}", "--out", "run", "-q")
    return grs(*arguments, folder=tmp_path)


def test_a_coroutine_function_is_a_node(known_scene: Path, tmp_path: Path) -> None:
    done = run_graph("graph_async_node", "asyncnode", known_scene, tmp_path)
    assert done.returncode == 0, done.stderr
    assert read_record(tmp_path / "run").status == "accepted"


def test_a_graph_that_cannot_be_built_is_refused_in_one_line(known_scene: Path, tmp_path: Path) -> None:
    done = run_graph("graph_broken_build", "broken", known_scene, tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1 and "graphs/broken.py:15: ValueError: Need to add_node" in done.stderr
    assert not (tmp_path / "run").exists()


def test_an_endless_graph_ends_in_one_line_that_names_the_setting(known_scene: Path, tmp_path: Path) -> None:
    done = run_graph("graph_endless", "endless", known_scene, tmp_path)
    assert done.returncode == 2
    [line] = done.stderr.splitlines()
    assert "graphs/endless.py) did not end within 65 steps" in line and "--set recursion_limit=N" in line


def test_a_place_in_millimetres_is_told_with_object_and_unit(tmp_path: Path) -> None:
    program = copy_case("program_millimetres", tmp_path) / "program.py"
    done = grs("check", str(program), "--seeds", "1", "--json", folder=tmp_path)
    assert done.returncode == 1
    assert "add_object('block/block.urdf'): x = 500 m, must be at most 2 m; give metres: 500 mm are 0.5" in done.stdout
    assert "Input should be" not in done.stdout


def test_transforms3d_is_answered(tmp_path: Path) -> None:
    program = copy_case("program_transforms3d", tmp_path) / "program.py"
    done = grs("check", str(program), "--seeds", "1", "--json", folder=tmp_path)
    assert "transforms3d" not in done.stdout and '"success"' in done.stdout, done.stdout


@pytest.fixture(scope="module")
def accepted(tmp_path_factory: pytest.TempPathFactory, accepted_run: Path) -> Path:
    """An accepted run, in a folder whose name a shell would split."""
    return Path(shutil.copytree(accepted_run, tmp_path_factory.mktemp("accepted") / "a run"))


def test_a_printed_command_can_be_pasted_into_a_shell(accepted: Path, tmp_path: Path) -> None:
    copy_case("printed_path_unquoted", tmp_path)
    done = grs("export", str(accepted), "--out", str(tmp_path / "ex a b"), "-q", folder=tmp_path)
    [command] = [line.removeprefix("open it: ") for line in done.stdout.splitlines() if line.startswith("open it: ")]
    assert shlex.split(command)[-1] == f"--mjcf={tmp_path / 'ex a b' / 'scene.xml'}"


@needs("h5py")
def test_the_environment_of_a_data_set_is_made_from_its_folder_and_after_a_move(accepted: Path, tmp_path: Path) -> None:
    case = copy_case("dataset_env_robomimic", tmp_path)
    made = grs("demos", str(accepted), "--episodes", "3", "--format", "robomimic", "--out", "d", folder=tmp_path)
    assert made.returncode == 0, made.stderr

    def make_environment(file: Path) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, str(case / "make_env.py"), str(file)]
        return subprocess.run(command, cwd="/", capture_output=True, text=True, check=False)

    done = make_environment(tmp_path / "d" / "demos.hdf5")
    assert "GrsEnv<GRS-v0>" in done.stdout, done.stderr
    moved = (tmp_path / "d").rename(tmp_path / "elsewhere")
    done = make_environment(moved / "demos.hdf5")
    assert "GrsEnv<GRS-v0>" in done.stdout, done.stderr
