"""Episodes of an evaluation as rollouts to be filmed or recorded."""

from hashlib import sha256
from pathlib import Path

from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.base.files import refuse_link, write_json
from grs_agents.base.foreign.files import read_json
from grs_agents.base.trace.events import Rollout
from grs_agents.tasks.suites.evaluation import (
    MOTIONS,
    ORDER,
    EpisodeResult,
    drawn_instance_name,
    motion_file_name,
    read_results,
)
from grs_agents.tasks.suites.suite import FILE, open_suite_task, read_suite
from grs_agents.views.film.rollout_film import RolloutShot


def make_episode_shot(suite_folder: Path, out: Path, row: EpisodeResult) -> RolloutShot:
    """The rollout of an episode; its instance, with the policy's instruction, is written beside its motion.

    Raises:
        InputError: the suite lacks the instance.
    """
    folder = open_suite_task(suite_folder, read_suite(suite_folder).task(row.task))
    instance = drawn_instance_name(row)
    if not row.perturb:
        refuse_link(out / "instances")  # the folder may come from somebody else
        shown = folder.read_instance(row.instance).model_copy(update={"instruction": row.instruction})
        write_json(out / instance, shown.model_dump(mode="json"))
    event = Rollout(
        seed=row.instance,
        reward=row.strict,
        outcome=row.outcome,
        steps=row.steps,
        recording=f"{MOTIONS}/{motion_file_name(row)}",
        instance=instance,
    )
    return RolloutShot(out.resolve(), event, folder.library)


def find_episode(suite_folder: Path, out: Path, name: str) -> EpisodeResult:
    """The episode whose motion is ``motions/NAME.npz``.

    Raises:
        InputError: ``out`` holds no evaluation of this suite.
        UnknownNameError: it has no such episode.
    """
    rows = {Path(motion_file_name(row)).stem: row for row in read_results(out)}
    digest = sha256((suite_folder / FILE).read_bytes()).hexdigest() if (suite_folder / FILE).is_file() else ""
    if read_json(out / ORDER, "evaluate again").get("suite") != digest:
        raise InputError(f"{out} is no evaluation of the suite {suite_folder}", "name its suite with --suite")
    if name not in rows:
        raise UnknownNameError("episode", name, rows)
    return rows[name]
