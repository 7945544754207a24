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


def write_matchings(out: Path, found: Sequence[Matching], prices: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    """Write ``figures.json``, ``table1.csv``, ``table1.md``, ``objects.csv`` and ``confusions.csv``.

    Returns:
        The content of ``figures.json``.

    Raises:
        InputError: SciPy is not installed.
    """
    usable = [one for one in found if not one.error]
    rows = [_row(key, some, prices) for key, some in _groups(usable).items()]
    tests, confusions = _tests(usable), _confusions(usable)
    value = {
        "table": rows,
        "tests": tests,
        "confusions": confusions,
        "calibration": _calibration(usable),
        "calibration error": _calibration_errors(usable),
        "errors": [one.order.stem for one in found if one.error],
    }
    write_json(out / "figures.json", value)
    write_text(out / "table1.csv", csv_text(COLUMNS, rows))
    write_text(out / "table1.md", "\n".join((markdown_table(COLUMNS, rows), _tests_table(tests))))
    write_text(out / "objects.csv", csv_text(_OBJECTS, _object_rows(usable)))
    write_text(out / "confusions.csv", csv_text(("method", "truth", "answer", "count"), confusions))
    return value


def _groups(found: Sequence[Matching]) -> dict[tuple[str, str], list[Matching]]:
    groups: dict[tuple[str, str], list[Matching]] = {}
    for one in found:
        groups.setdefault((one.order.method.name, one.order.model), []).append(one)
    return groups


def _row(key: tuple[str, str], some: Sequence[Matching], prices: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    right, wrong, missed = (sum(column) for column in zip(*(one.counts for one in some), strict=True))
    pooled, precision, recall = f1_precision_recall((right, wrong, missed))
    values = (*confidence_interval(_f1(some)), precision, recall, pooled)
    outcomes = Counter[str](answer.outcome for one in some for answer in one.answers)
    outcomes["missed"] += sum(one.unseen for one in some)
    return {
        "method": key[0],
        "model": key[1],
        "scenes": len({one.order.scene.name for one in some}),
        "runs": len({one.order.run for one in some}),
        **{name: f"{value:.3f}" for name, value in zip(_SCORES, values, strict=True)},
        **{name: outcomes[name] for name in _COUNTED},
        **_tokens(some, prices.get(key[1])),
        "CPU s": f"{sum(one.cpu_seconds for one in some) / len(some):.1f}",
    }


def _tokens(some: Sequence[Matching], price: tuple[float, float] | None) -> dict[str, Any]:
    into, out = sum(one.input_tokens for one in some), sum(one.output_tokens for one in some)
    cost = "" if price is None else f"{(into * price[0] + out * price[1]) / 1e6:.4f}"
    return {"tokens in": into, "tokens out": out, "cost": cost}


def _f1(found: Sequence[Matching]) -> list[float]:
    return [f1_precision_recall(one.counts)[0] for one in found]


def _tests(found: Sequence[Matching]) -> list[dict[str, Any]]:
    """Whether methods and models differ, and whether they interact, by the F1 of scenes and runs."""
    asked = [one for one in found if one.order.model != "-"]
    models = [one.order.model for one in asked]
    tests = [
        ("Kruskal-Wallis", kruskal_wallis(_by([one.order.method.name for one in found], _f1(found)), "method")),
        ("Kruskal-Wallis", kruskal_wallis(_by(models, _f1(asked)), "model")),
    ]
    if asked:
        both = scheirer_ray_hare(_f1(asked), [one.order.method.name for one in asked], models)
        tests += [("Scheirer-Ray-Hare", one) for one in both]
    return [{"test": name, **one.model_dump()} for name, one in tests if one is not None]


def _by(keys: Sequence[str], values: Sequence[float]) -> dict[str, list[float]]:
    groups: dict[str, list[float]] = {}
    for key, value in zip(keys, values, strict=True):
        groups.setdefault(key, []).append(value)
    return groups


def _confusions(found: Sequence[Matching]) -> list[dict[str, Any]]:
    """Confused pairs of assets, the most frequent first."""
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
        {
            "method": method,
            "confidence": round(sum(stated for stated, _ in some) / len(some), 3),
            "right": round(sum(right for _, right in some) / len(some), 3),
            "matches": len(some),
        }
        for (method, _), some in sorted(bins.items())
    ]


def _calibration_errors(found: Sequence[Matching]) -> dict[str, float | None]:
    """The expected calibration error of the matches of each method."""
    stated: dict[str, list[tuple[float, bool]]] = {}
    for one in found:
        for answer in one.answers:
            if answer.answer.match == "asset" and answer.answer.confidence is not None:
                right = answer.outcome == "right"
                stated.setdefault(one.order.method.name, []).append((answer.answer.confidence, right))
    return {method: calibration_error(some) for method, some in sorted(stated.items())}


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
    return markdown_table(("test", "effect", "H", "degrees of freedom", "p"), rows) if rows else ""
