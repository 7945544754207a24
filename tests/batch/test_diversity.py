"""How different the tasks of a batch are."""

from grs_agents.batch import BatchRow, describe_diversity, mark_repeated_tasks


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
