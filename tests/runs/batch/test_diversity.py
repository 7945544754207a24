"""How different the tasks of a batch are."""

from pathlib import Path

from grs_agents.runs.batch.batch import BatchOrder, describe_diversity, find_scenes_given_up, mark_repeated_tasks
from grs_agents.runs.batch.results import BatchResults
from grs_agents.runs.batch.row import BatchRow


def row(run: str, task: str, goals: tuple[str, ...], scene: str = "s", status: str = "accepted") -> BatchRow:
    """A run that came to this task."""
    family = task.split("-", maxsplit=1)[0]
    return BatchRow(run=run, scene=scene, seed=0, status=status, reason="", task=task, goals=goals, family=family)


def test_the_same_goals_or_name_make_the_same_task() -> None:
    rows = mark_repeated_tasks(
        [
            row("rejected", "pack-a", ("inside A -> C",), status="rejected"),
            row("first", "pack-a", ("inside A -> C",)),
            row("renamed", "put-a", ("inside A -> C",)),
            row("namesake", "pack-a", ("inside B -> C",)),
            row("other", "pack-b", ("inside A -> C", "inside B -> C")),
            row("elsewhere", "pack-a", ("inside A -> C",), scene="t"),
        ]
    )
    assert [item.repeats for item in rows] == ["", "", "first", "first", "", ""]
    told = describe_diversity(rows)
    assert (told["accepted"], told["different_tasks"], told["families"]) == (5, 3, {"pack": 3})
    assert told["mean_distance"] == 0.333  # 1/2, 0 and 1/2


def test_one_task_has_no_distance() -> None:
    assert describe_diversity([row("a", "pack-a", ())])["mean_distance"] is None


def test_a_scene_with_too_few_different_tasks_is_named() -> None:
    rows = mark_repeated_tasks(
        [
            row("one", "pack-a", ("inside A -> C",), scene="home/table"),
            row("same", "pack-a", ("inside A -> C",), scene="home/table"),
            row("no", "pack-b", (), scene="home/table", status="rejected"),
            *(row(name, f"pack-{name}", (f"inside {name} -> C",), scene="desk") for name in "abc"),
        ]
    )
    results = BatchResults(summary={}, rows=tuple(rows))

    def given_up(tasks: int | None) -> list[str]:
        return list(find_scenes_given_up(BatchOrder(("home/table", "desk"), Path(), tasks), results))

    assert given_up(2) == ["table: 1 of 2 different tasks, given up after 3 seeds"]
    assert given_up(1) == given_up(None) == []
