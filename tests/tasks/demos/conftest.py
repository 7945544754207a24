"""A folder of task instances, and the demonstrations of it."""

from pathlib import Path

import pytest

from grs_agents.base.foreign.files import read_json
from grs_agents.tasks.demos.attempt_store import AttemptStore
from grs_agents.tasks.demos.production import make_demonstrations
from grs_agents.tasks.demos.types import Demonstration
from grs_agents.tasks.task_folder import open_task_folder
from tests.tasks.demos.block_tasks import ORDER, two_blocks, write_instances


@pytest.fixture(scope="session")
def blocks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Instances of seeds 0 and 1."""
    return write_instances(tmp_path_factory.mktemp("demos") / "blocks", two_blocks(0), two_blocks(1))


@pytest.fixture(scope="session")
def kept(blocks: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The working folder of ``ORDER``; to be copied by those who write it to a data set."""
    work = tmp_path_factory.mktemp("work")
    make_demonstrations(open_task_folder(blocks), ORDER, work, lambda _: None)
    return work


@pytest.fixture(scope="session")
def demonstrations(blocks: Path, kept: Path) -> list[Demonstration]:
    """Two of the instances as they are, and one that is varied."""
    return list(make_demonstrations(open_task_folder(blocks), ORDER, kept, lambda _: None).demonstrations())


@pytest.fixture(scope="session")
def finger_blocks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An instance for a robot with fingers."""
    fingers = two_blocks(0).model_copy(update={"robot": "ur5e", "hand": "robotiq_2f85"})
    return write_instances(tmp_path_factory.mktemp("fingers") / "blocks", fingers)


@pytest.fixture(scope="session")
def kept_fingers(finger_blocks: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The working folder of its demonstration."""
    work = tmp_path_factory.mktemp("work")
    order = ORDER.model_copy(update={"episodes": 1, "cameras": ()})
    make_demonstrations(open_task_folder(finger_blocks), order, work, lambda _: None)
    return work


@pytest.fixture(scope="session")
def finger_demonstration(kept_fingers: Path) -> Demonstration:
    """The demonstration of fingers."""
    (one,) = AttemptStore(kept_fingers, read_json(kept_fingers / "order.json", "")).demonstrations()
    return one
