"""A suite of two tasks with a block each."""

from pathlib import Path

import pytest

from grs_agents.base.files import write_json
from grs_agents.sim.variation.types import Variation
from grs_agents.tasks.suites.suite import make_suite
from tests.tasks.envs.conftest import block_instance

VARIATION = Variation(jitter=0.02)


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Folders of the instances of two tasks; the first has words of its own."""
    folders = [tmp_path_factory.mktemp("runs") / name for name in ("near", "far")]
    for folder, seed in zip(folders, (0, 1), strict=True):
        write_json(folder / "instances" / f"seed_{seed}.json", block_instance(seed).model_dump(mode="json"))
    words = {"vague": "tidy up", "specific": "the block ends at the left; nothing else moves"}
    instructions = {kind: {"text": text, "verdict": "agree", "by": "goals", "why": ""} for kind, text in words.items()}
    task = {"task-description": "Put the red block to the left.", "instructions": instructions}
    write_json(folders[0] / "task.json", task)
    return folders


@pytest.fixture(scope="session")
def suite_folder(runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("suites") / "blocks"
    make_suite(folder, runs, "blocks", 2, VARIATION, workers=1)
    return folder
