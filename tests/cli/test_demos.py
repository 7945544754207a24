import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from grs_agents.cli.commands import app
from grs_agents.tasks.demos.production import DemoOrder
from tests.cli.command import grs
from tests.needs import needs
from tests.tasks.demos.block_tasks import two_blocks, write_instances


@pytest.fixture
def blocks(tmp_path: Path) -> Path:
    return write_instances(tmp_path / "blocks", two_blocks(0))


@needs("h5py")
def test_demonstrations_lie_beside_their_task(blocks: Path) -> None:
    done = grs("demos", "blocks", "--episodes", "1", "--format", "robomimic", "--json", folder=blocks.parent)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert (told["episodes"], told["dropped"], told["format"]) == (1, {}, "robomimic")
    assert (blocks.parent / "blocks-demos" / "demos.hdf5").is_file()
    assert [path.name for path in blocks.iterdir()] == ["instances"]
    again = grs("demos", "blocks", "--episodes", "1", "--format", "robomimic", folder=blocks.parent)
    assert (again.returncode, "is there already" in again.stderr) == (2, True)


@needs("pyarrow", "av")
@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--format", "hdf5"], "use one of: lerobot, minari, robomimic"),
        (["--control", "pick_place"], "use one of: ee_delta, joint_position"),
        (["--camera", "left"], "use one of: front, none, photo, wrist"),
        (["--camera", "front,none"], "unknown camera 'none'"),
        (["--size", "96"], "give ROWSxCOLUMNS"),
        (["--size", "95x128", "--camera", "front"], "an even number of rows and columns"),
        (["--camera", "photo", "--episodes", "1"], "photo"),
        (["--jitter", "0", "--yaw", "0"], "vary them, e.g. with --jitter 0.03"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_simulated(blocks: Path, arguments: list[str], told: str) -> None:
    done = grs("demos", "blocks", *arguments, folder=blocks.parent)
    assert done.returncode == 2
    assert told in done.stderr
    assert [path.name for path in blocks.parent.iterdir()] == ["blocks"]


@pytest.mark.parametrize(
    ("options", "cameras"),
    [
        ((), ("front", "wrist")),
        (("--camera", "none"), ()),
        (("--format", "robomimic"), ()),
        (("--format", "robomimic", "--camera", "front"), ("front",)),
    ],
)
def test_data_sets_of_lerobot_have_pictures_unless_told_otherwise(
    options: tuple[str, ...], cameras: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    orders: list[DemoOrder] = []
    monkeypatch.setattr("grs_agents.cli.demos.write_demonstrations", lambda run, order, *_: orders.append(order))
    done = CliRunner().invoke(app, ["demos", "blocks", *options])
    assert done.exit_code == 0, done.output
    assert [(order.cameras, order.size) for order in orders] == [(cameras, (224, 224))]
