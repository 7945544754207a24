"""A folder of task instances, and the demonstrations of it."""

from pathlib import Path

import pytest

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
