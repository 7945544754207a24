"""How different the tasks of a batch are."""

from collections import Counter
from collections.abc import Sequence
from itertools import combinations
from typing import Any

from grs_agents.runs.batch.row import BatchRow


def mark_repeated_tasks(rows: Sequence[BatchRow]) -> list[BatchRow]:
    """The rows with ``repeats`` set where an earlier accepted run of the same scene has the same goals or name."""
    first: dict[tuple[str, object], str] = {}
    marked: list[BatchRow] = []
    for row in rows:
        keys = [(row.scene, row.goals), (row.scene, row.task)]
        earlier = next((first[key] for key in keys if key in first), "") if row.status == "accepted" else ""
        marked.append(row.model_copy(update={"repeats": earlier}))
        if row.status == "accepted" and not earlier:
            first.update(dict.fromkeys(keys, row.run))
    return marked


def describe_diversity(rows: Sequence[BatchRow]) -> dict[str, Any]:
    """Accepted tasks, those that repeat none, families, and the mean distance of two tasks.

    The distance of two tasks is one less the share of goals that they have in common (Jaccard): 1 where they share
    none. GenSim (arXiv:2310.01361) compares embeddings of task descriptions instead.
    """
    accepted = [row for row in rows if row.status == "accepted"]
    tasks = [row for row in accepted if not row.repeats]
    distances = [
        1 - len(set(one.goals) & set(other.goals)) / max(1, len(set(one.goals) | set(other.goals)))
        for one, other in combinations(tasks, 2)
    ]
    return {
        "accepted": len(accepted),
        "different_tasks": len(tasks),
        "families": dict(sorted(Counter(row.family for row in tasks).items())),
        "mean_distance": round(sum(distances) / len(distances), 3) if distances else None,
    }
