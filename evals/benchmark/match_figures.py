"""Figures of correspondence: the paper's Table 1 with tests, confusions and costs, in CSV, Markdown and JSON."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from evals.benchmark.figures import csv_text
from evals.benchmark.match_types import Matching, f1_precision_recall
from evals.benchmark.rank_tests import RankTest, confidence_interval, kruskal_wallis, scheirer_ray_hare
from grs_agents.files import write_json, write_text
from grs_agents.run.experiments import markdown

COLUMNS = ("method", "model", "scenes", "runs", "F1", "F1 low", "F1 high", "precision", "recall", "pooled F1", "right",
           "wrong asset", "false alarm", "missed", "tokens in", "tokens out", "cost", "CPU s")  # fmt: skip
"""F1 is the mean over scenes and runs with its 95 % interval; precision, recall and pooled F1 are of all objects."""
SHOWN = ("method", "model", "F1", "F1 low", "F1 high", "precision", "recall", "pooled F1", "CPU s")
_OBJECTS = ("scene", "method", "model", "run", "id", "truth", "match", "asset", "confidence", "outcome", "visible",
            "reason")  # fmt: skip


def write_matchings(
    out: Path, found: Sequence[Matching], prices: Mapping[str, tuple[float, float]]
) -> dict[str, Any]:  # fmt: skip
    """Write ``figures.json``, ``table1.csv``, ``table1.md``, ``objects.csv`` and ``confusions.csv``.

    Returns:
        The content of ``figures.json``.

    Raises:
        InputError: SciPy is not installed.
    """
    usable = [one for one in found if not one.error]
    rows = [_row(key, some, prices) for key, some in _groups(usable).items()]
    told = _tests(usable)
    confusions = _confusions(usable)
    value = {"table": rows, "tests": told, "confusions": confusions, "calibration": _calibration(usable),
             "errors": [one.order.stem for one in found if one.error]}  # fmt: skip
    write_json(out / "figures.json", value)
    write_text(out / "table1.csv", csv_text(COLUMNS, rows))
    write_text(out / "table1.md", "\n".join((markdown(COLUMNS, rows), _tests_table(told))))
    write_text(out / "objects.csv", csv_text(_OBJECTS, _object_rows(usable)))
    write_text(out / "confusions.csv", csv_text(("method", "truth", "answer", "count"), confusions))
    return value


def _groups(found: Sequence[Matching]) -> dict[tuple[str, str], list[Matching]]:
    groups: dict[tuple[str, str], list[Matching]] = {}
    for one in found:
        groups.setdefault((one.order.method.name, one.order.model), []).append(one)
    return groups


def _row(
    key: tuple[str, str], some: Sequence[Matching], prices: Mapping[str, tuple[float, float]]
) -> dict[str, Any]:  # fmt: skip
    mean, low, high = confidence_interval([f1_precision_recall(one.counts)[0] for one in some])
    right, wrong, missed = (sum(one.counts[part] for one in some) for part in range(3))
    pooled, precision, recall = f1_precision_recall((right, wrong, missed))
    outcomes = Counter(answer.outcome for one in some for answer in one.answers)
    into, out = (sum(getattr(one, name) for one in some) for name in ("input_tokens", "output_tokens"))
    price = prices.get(key[1])
    return {
        "method": key[0],
        "model": key[1],
        "scenes": len({one.order.scene.name for one in some}),
        "runs": len({one.order.run for one in some}),
        "F1": f"{mean:.3f}",
        "F1 low": f"{low:.3f}",
        "F1 high": f"{high:.3f}",
        "precision": f"{precision:.3f}",
        "recall": f"{recall:.3f}",
        "pooled F1": f"{pooled:.3f}",
        "right": outcomes["right"],
        "wrong asset": outcomes["wrong asset"],
        "false alarm": outcomes["false alarm"],
        "missed": outcomes["missed"] + sum(one.unseen for one in some),
        "tokens in": into,
        "tokens out": out,
        "cost": "" if price is None else f"{(into * price[0] + out * price[1]) / 1e6:.4f}",
        "CPU s": f"{sum(one.cpu_seconds for one in some) / len(some):.1f}",
    }


def _tests(found: Sequence[Matching]) -> list[dict[str, Any]]:
    """Whether methods and models differ, and whether they interact, by the F1 of scenes and runs."""
    values = [f1_precision_recall(one.counts)[0] for one in found]
    methods, models = [one.order.method.name for one in found], [one.order.model for one in found]
    asked = [index for index, model in enumerate(models) if model != "-"]
    told = [("Kruskal-Wallis", kruskal_wallis(_by(methods, values), "method"))]
    told.append(
        ("Kruskal-Wallis", kruskal_wallis(_by([models[i] for i in asked], [values[i] for i in asked]), "model"))
    )
    if asked:
        both = scheirer_ray_hare(
            [values[i] for i in asked], [methods[i] for i in asked], [models[i] for i in asked]
        )  # fmt: skip
        told += [("Scheirer-Ray-Hare", one) for one in both]
    return [{"test": name, **one.model_dump()} for name, one in told if isinstance(one, RankTest)]


def _by(keys: Sequence[str], values: Sequence[float]) -> dict[str, list[float]]:
    groups: dict[str, list[float]] = {}
    for key, value in zip(keys, values, strict=True):
        groups.setdefault(key, []).append(value)
    return groups


def _confusions(found: Sequence[Matching]) -> list[dict[str, Any]]:
    """What was taken for what, the most frequent first."""
    pairs: Counter[tuple[str, str, str]] = Counter()
    for one in found:
        for answer in one.answers:
            if answer.outcome in ("wrong asset", "false alarm", "missed"):
                truth = "(no object)" if answer.truth is None else answer.truth or "(not in the library)"
                pairs[one.order.method.name, truth, answer.answer.asset or f"({answer.answer.match})"] += 1
    return [
        {"method": method, "truth": truth, "answer": told, "count": count}
        for (method, truth, told), count in pairs.most_common()
    ]


def _calibration(found: Sequence[Matching]) -> list[dict[str, Any]]:
    """How often matches of a stated confidence are right, for each method that states one."""
    bins: dict[tuple[str, int], list[tuple[float, bool]]] = {}
    for one in found:
        for answer in one.answers:
            stated = answer.answer.confidence
            if answer.answer.match == "asset" and stated is not None:
                key = (one.order.method.name, min(int(stated * 10), 9))
                bins.setdefault(key, []).append((stated, answer.outcome == "right"))
    return [
        {"method": method, "confidence": round(sum(stated for stated, _ in some) / len(some), 3),
         "right": round(sum(right for _, right in some) / len(some), 3), "matches": len(some)}
        for (method, _), some in sorted(bins.items())
    ]  # fmt: skip


def _object_rows(found: Sequence[Matching]) -> list[dict[str, Any]]:
    return [
        {
            "scene": one.order.scene.name,
            "method": one.order.method.name,
            "model": one.order.model,
            "run": one.order.run,
            "id": answer.id,
            "truth": "(no object)" if answer.truth is None else answer.truth,
            "match": answer.answer.match,
            "asset": answer.answer.asset or "",
            "confidence": "" if answer.answer.confidence is None else f"{answer.answer.confidence:.3f}",
            "outcome": answer.outcome,
            "visible": "" if answer.visible is None else f"{answer.visible:.2f}",
            "reason": answer.answer.reason,
        }
        for one in found
        for answer in one.answers
    ]


def _tests_table(tests: Sequence[Mapping[str, Any]]) -> str:
    rows = [
        {**test, "H": f"{test['statistic']:.2f}", "degrees of freedom": test["freedom"], "p": f"{test['p']:.3g}"}
        for test in tests
    ]
    return markdown(("test", "effect", "H", "degrees of freedom", "p"), rows) if rows else ""
