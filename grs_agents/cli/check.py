"""``grs check``."""

from collections.abc import Iterator
from pathlib import Path

from rich.table import Table
from rich.text import Text

from grs_agents.base import terminal
from grs_agents.base.config.load import EffectiveConfig
from grs_agents.base.terminal import print_json
from grs_agents.runs.program_check import CheckResult, check_user_program, open_check_order
from grs_agents.views.live_views import attach_live_views
from grs_agents.views.terminal import show_activity_status


def check_program(
    program: Path,
    tests: Path | None,
    task: Path | None,
    scene: Path | None,
    chosen: EffectiveConfig,
    out: Path | None,
    as_json: bool,
) -> int:
    """Check a program and print the result; an accepted task is kept in ``out``.

    Returns:
        Exit status, 0 if its tests pass and the audit accepts it, else 1.
    """
    with (
        open_check_order(program, tests, task, scene, chosen, attach_live_views, out) as order,
        show_activity_status("checking the program"),
    ):
        result = check_user_program(order)
    if as_json:
        value = {
            "status": "accepted" if result.accepted else "rejected",
            "reason": result.reason,
            "sentence": result.audit.sentence,
            "words": result.audit.words and result.audit.words.model_dump(mode="json"),
            "tests": result.tests and result.tests.model_dump(mode="json"),
            "audit": result.audit.model_dump(mode="json"),
        }
        print_json(value)
    else:
        title = "accepted" if result.accepted else Text(f"rejected: {result.reason}")
        table = Table(box=None, pad_edge=False, header_style="bold", title=title)
        for column in ("check", "result", "measured", "asked"):
            table.add_column(column, overflow="fold", no_wrap=column in ("check", "result"))
        for row in _list_table_rows(result):
            table.add_row(*map(Text, row))
        console = terminal.make_console()
        console.print(table)
        console.print(Text(result.audit.about))
        if result.audit.sentence:
            console.print(Text(f"sentence: {result.audit.sentence}", style="bold"))
        if (words := result.audit.words) is not None and words.verdict != "agree":
            console.print(Text(f"words: {words.verdict}, says {words.by}: {words.why}"))
        if out is not None and result.accepted:
            console.print(Text(f"{out} holds the task: grs instances, demos, export, suite and gymnasium take it"))
    return 0 if result.accepted else 1


def _list_table_rows(result: CheckResult) -> Iterator[tuple[str, ...]]:
    report, audit = result.tests, result.audit
    if report is not None and not report.cases:
        yield "tests", report.outcome, report.message
    for case in report.cases if report is not None else ():  # by method: the class is long and the same for all
        yield case.id.rpartition(".")[2], case.outcome, case.message
    for finding in audit.findings:
        yield finding.check, "passed" if finding.passed else "failed", finding.measured, finding.bound
    for rollout in audit.rollouts:
        episode = rollout.episode
        yield f"seed {rollout.seed}", episode.outcome, f"reward {episode.reward:.2f}: {episode.detail}"
    for warning in dict.fromkeys(warning for rollout in audit.rollouts for warning in rollout.warnings):
        yield "warning", "", warning
