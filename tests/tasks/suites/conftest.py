"""A suite of two tasks with a block each."""

from pathlib import Path

import pytest

from grs_agents.audit.types import AuditReport, JudgedWords
from grs_agents.base.files import write_json
from grs_agents.sim.variation.types import Variation
from grs_agents.tasks.suites.suite import make_suite
from tests.tasks.envs.conftest import block_instance

VARIATION = Variation(jitter=0.02)
SPECIFIC = "the block ends at the left; nothing else moves"


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Folders of the instances of two tasks; the first has words of its own."""
    folders = [tmp_path_factory.mktemp("runs") / name for name in ("near", "far")]
    for folder, seed in zip(folders, (0, 1), strict=True):
        instance = block_instance(seed).model_copy(update={"instruction": "" if seed else SPECIFIC})
        write_json(folder / "instances" / f"seed_{seed}.json", instance.model_dump(mode="json"))
    words = {"vague": "tidy up", "default": "Put the red block to the left.", "specific": SPECIFIC}
    made = AuditReport(
        accepted=True,
        findings=(),
        changes=(),
        rollouts=(),
        rewards=(),
        sentence=words["specific"],
        vague=words["vague"],
        words=JudgedWords(verdict="agree", by="offline", why=""),
    ).words_as_json(words["default"])
    write_json(folders[0] / "task.json", {"task-description": words["default"], **made})
    return folders


@pytest.fixture(scope="session")
def suite_folder(runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("suites") / "blocks"
    make_suite(folder, runs, "blocks", 2, VARIATION, workers=1)
    return folder
