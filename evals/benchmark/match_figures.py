"""Figures of correspondence: the paper's Table 1 with tests, confusions and costs, in CSV, Markdown and JSON."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from evals.benchmark.figures import calibration_error, csv_text
from evals.benchmark.match_types import Matching, f1_precision_recall
from evals.benchmark.rank_tests import confidence_interval, kruskal_wallis, scheirer_ray_hare
from grs_agents.base.files import write_json, write_text
from grs_agents.runs.experiments import markdown_table

_COUNTED = ("right", "wrong asset", "false alarm", "missed")
_SCORES = ("F1", "F1 low", "F1 high", "precision", "recall", "pooled F1")
COLUMNS = ("method", "model", "scenes", "runs", *_SCORES, *_COUNTED, "tokens in", "tokens out", "cost", "CPU s")
"""F1 is the mean over scenes and runs with its 95 % interval; precision, recall and pooled F1 are of all objects."""
SHOWN = ("method", "model", *_SCORES, "CPU s")
_ANSWER = ("id", "truth", "match", "asset", "confidence", "outcome", "visible", "reason")
_OBJECTS = ("scene", "method", "model", "run", *_ANSWER)


def write_matchings(
    out: Path, matchings: Sequence[Matching], prices: Mapping[str, tuple[float, float]]
) -> dict[str, Any]:
    """Write ``figures.json``, ``table1.csv``, ``table1.md``, ``objects.csv`` and ``confusions.csv``.

    Returns:
        The content of ``figures.json``.

    Raises:
        InputError: SciPy is not installed.
    """
    usable = [matching for matching in matchings if not matching.error]
    groups: dict[tuple[str, str], list[Matching]] = {}
    for matching in usable:
        groups.setdefault((matching.order.method.name, matching.order.model), []).append(matching)
    rows = [_row(key, some, prices) for key, some in groups.items()]
    tests, confusions = _tests(usable), _confusions(usable)
    stated: dict[str, list[tuple[float, bool]]] = {}  # confidence and correctness of the matches of each method
    for matching in usable:
        for answer in matching.answers:
            if answer.answer.match == "asset" and answer.answer.confidence is not None:
                pair = (answer.answer.confidence, answer.outcome == "right")
                stated.setdefault(matching.order.method.name, []).append(pair)
    value = {
        "table": rows,
        "tests": tests,
        "confusions": confusions,
        "calibration": _calibration(stated),
        "calibration error": {method: calibration_error(some) for method, some in sorted(stated.items())},
        "errors": [matching.order.stem for matching in matchings if matching.error],
    }
    write_json(out / "figures.json", value)
    write_text(out / "table1.csv", csv_text(COLUMNS, rows))
    test_rows = [
        {**test, "H": f"{test['statistic']:.2f}", "degrees of freedom": test["freedom"], "p": f"{test['p']:.3g}"}
        for test in tests
    ]
    test_table = markdown_table(("test", "effect", "H", "degrees of freedom", "p"), test_rows) if test_rows else ""
    write_text(out / "table1.md", "\n".join((markdown_table(COLUMNS, rows), test_table)))
    write_text(out / "objects.csv", csv_text(_OBJECTS, _object_rows(usable)))
    write_text(out / "confusions.csv", csv_text(("method", "truth", "answer", "count"), confusions))
    return value


def _row(key: tuple[str, str], some: Sequence[Matching], prices: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    right, wrong, missed = (sum(column) for column in zip(*(matching.counts for matching in some), strict=True))
    pooled, precision, recall = f1_precision_recall((right, wrong, missed))
    values = (*confidence_interval(_f1(some)), precision, recall, pooled)
    outcomes = Counter[str](answer.outcome for matching in some for answer in matching.answers)
    outcomes["missed"] += sum(matching.unseen for matching in some)
    price = prices.get(key[1])
    into, out = sum(matching.input_tokens for matching in some), sum(matching.output_tokens for matching in some)
    cost = "" if price is None else f"{(into * price[0] + out * price[1]) / 1e6:.4f}"
    return {
        "method": key[0],
        "model": key[1],
        "scenes": len({matching.order.scene.name for matching in some}),
        "runs": len({matching.order.run for matching in some}),
        **{name: f"{value:.3f}" for name, value in zip(_SCORES, values, strict=True)},
        **{name: outcomes[name] for name in _COUNTED},
        "tokens in": into,
        "tokens out": out,
        "cost": cost,
        "CPU s": f"{sum(matching.cpu_seconds for matching in some) / len(some):.1f}",
    }


def _f1(matchings: Sequence[Matching]) -> list[float]:
    return [f1_precision_recall(matching.counts)[0] for matching in matchings]


def _tests(matchings: Sequence[Matching]) -> list[dict[str, Any]]:
    """Effects of methods and models and their interaction on the F1 of scenes and runs."""
    by_model = [matching for matching in matchings if matching.order.model != "-"]
    models = [matching.order.model for matching in by_model]
    tests = [
        (
            "Kruskal-Wallis",
            kruskal_wallis(_by([matching.order.method.name for matching in matchings], _f1(matchings)), "method"),
        ),
        ("Kruskal-Wallis", kruskal_wallis(_by(models, _f1(by_model)), "model")),
    ]
    if by_model:
        both = scheirer_ray_hare(_f1(by_model), [matching.order.method.name for matching in by_model], models)
        tests += [("Scheirer-Ray-Hare", test) for test in both]
    return [{"test": name, **test.model_dump()} for name, test in tests if test is not None]


def _by(keys: Sequence[str], values: Sequence[float]) -> dict[str, list[float]]:
    groups: dict[str, list[float]] = {}
    for key, value in zip(keys, values, strict=True):
        groups.setdefault(key, []).append(value)
    return groups


def _confusions(matchings: Sequence[Matching]) -> list[dict[str, Any]]:
    """Confused pairs of assets, the most frequent first."""
    pairs: Counter[tuple[str, str, str]] = Counter()
    for matching in matchings:
        for answer in matching.answers:
            if answer.outcome in ("wrong asset", "false alarm", "missed"):
                truth = "(no object)" if answer.truth is None else answer.truth or "(not in the library)"
                pairs[matching.order.method.name, truth, answer.answer.asset or f"({answer.answer.match})"] += 1
    return [
        {"method": method, "truth": truth, "answer": reply, "count": count}
        for (method, truth, reply), count in pairs.most_common()
    ]


def _calibration(stated: Mapping[str, Sequence[tuple[float, bool]]]) -> list[dict[str, Any]]:
    """Reliability of the stated confidences, by tenths, for each method."""
    bins: dict[tuple[str, int], list[tuple[float, bool]]] = {}
    for method, pairs in stated.items():
        for confidence, right in pairs:
            bins.setdefault((method, min(int(confidence * 10), 9)), []).append((confidence, right))
    return [
        {
            "method": method,
            "confidence": round(sum(confidence for confidence, _ in some) / len(some), 3),
            "right": round(sum(right for _, right in some) / len(some), 3),
            "matches": len(some),
        }
        for (method, _), some in sorted(bins.items())
    ]


def _object_rows(matchings: Sequence[Matching]) -> list[dict[str, Any]]:
    return [
        {
            "scene": matching.order.scene.name,
            "method": matching.order.method.name,
            "model": matching.order.model,
            "run": matching.order.run,
            "id": answer.id,
            "truth": "(no object)" if answer.truth is None else answer.truth,
            "match": answer.answer.match,
            "asset": answer.answer.asset or "",
            "confidence": "" if answer.answer.confidence is None else f"{answer.answer.confidence:.3f}",
            "outcome": answer.outcome,
            "visible": "" if answer.visible is None else f"{answer.visible:.2f}",
            "reason": answer.answer.reason,
        }
        for matching in matchings
        for answer in matching.answers
    ]
