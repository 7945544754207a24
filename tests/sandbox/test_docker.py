"""What Docker is told, and what it says."""

import csv
import itertools
from pathlib import Path

import pytest

from grs_agents.sandbox import Limits, docker

LIMITS = Limits(memory_mib=100, scratch_mib=2, threads=10)
SCRATCH = (Path("/scratch/0"), Path("/scratch/1"))


def test_container_has_room_for_all_its_calls() -> None:
    command = docker.wrap("name", "image", (), SCRATCH, LIMITS)
    told = dict(itertools.pairwise(command))
    assert int(told["--memory"].removesuffix("m")) >= 2 * (100 + 2)
    assert int(told["--pids-limit"]) >= 2 * (10 + 1) + 1
    assert [command[at + 1].split(",")[0] for at, word in enumerate(command) if word == "--tmpfs"] == [
        f"/scratch/{slot}:size={2 << 20}" for slot in range(2)
    ]
    assert command[-1] == "image"


@pytest.mark.parametrize("name", ["plain", "a b", "a,b:c", 'a"b'])
def test_any_path_can_be_mounted(name: str, tmp_path: Path) -> None:
    folder = tmp_path / name
    command = docker.wrap("name", "image", [folder], SCRATCH, LIMITS)
    mounts = [command[at + 1] for at, word in enumerate(command) if word == "--mount"]
    assert ["type=bind", f"source={folder}", f"target={folder}", "readonly"] in list(csv.reader(mounts))


@pytest.mark.parametrize(
    ("log", "remedy"),
    [
        ("docker: permission denied while trying to connect to the Docker daemon socket", "usermod -aG docker"),
        (
            "docker: Cannot connect to the Docker daemon at unix:///x. Is it running?\nSee 'docker --help'",
            "start docker",
        ),
        ("docker: Error response from daemon: No such image: image", "docker pull image"),
        ("Unable to find image 'image' locally\ndocker: Error response from daemon: pull denied.", "docker pull image"),
    ],
)
def test_what_went_wrong_has_a_remedy(log: str, remedy: str) -> None:
    said, found = docker.explain(log, "image")
    assert said in log
    assert remedy in found


def test_what_python_says_is_not_dockers() -> None:
    assert docker.explain("ModuleNotFoundError: No module named 'x'", "image") == ("", "")
