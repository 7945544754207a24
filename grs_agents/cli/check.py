"""``grs check``."""

from collections.abc import Iterator
from pathlib import Path

from rich.table import Table
from rich.text import Text

from grs_agents.audit.types import AuditReport
from grs_agents.base import terminal
from grs_agents.base.config.load import EffectiveConfig
from grs_agents.base.terminal import print_json
from grs_agents.runs.program_check import CheckResult, check_user_program, open_check_order
from grs_agents.sandbox.protocol.report import TestReport
from grs_agents.views.live_views import attach_live_views
from grs_agents.views.terminal import show_activity_status


def check_program(
    program: Path, tests: Path | None, task: Path | None, scene: Path | None, chosen: EffectiveConfig, as_json: bool
) -> int:
    """Check a program and print what was found; 0 if its tests pass and the audit accepts it, 1 if not."""
    with (
        open_check_order(program, tests, task, scene, chosen, attach_live_views) as order,
        show_activity_status("checking the program"),
    ):
        found = check_user_program(order)
    if as_json:
        value = {
            "status": "accepted" if found.accepted else "rejected",
            "reason": found.reason,
            "tests": found.tests and found.tests.model_dump(mode="json"),
            "audit": found.audit.model_dump(mode="json"),
        }
        print_json(value)
    else:
        _print_check_result(found)
    return 0 if found.accepted else 1


def _print_check_result(found: CheckResult) -> None:
    console = terminal.make_console()
    table = Table(
        box=None,
        pad_edge=False,
        header_style="bold",
        title="accepted" if found.accepted else Text(f"rejected: {found.reason}"),
    )
    for column in ("check", "result", "measured", "asked"):
        table.add_column(column, overflow="fold", no_wrap=column in ("check", "result"))
    for row in (*_test_table_rows(found.tests), *_audit_table_rows(found.audit)):
        table.add_row(*map(Text, row))
    console.print(table)
    console.print(Text(found.audit.about))


def _test_table_rows(report: TestReport | None) -> Iterator[tuple[str, ...]]:
    if report is None:
        return
    if not report.cases:
        yield "tests", report.outcome, report.message
    for case in report.cases:  # their class is the same for all, and long
        yield case.id.rpartition(".")[2], case.outcome, case.message


def _audit_table_rows(audit: AuditReport) -> Iterator[tuple[str, ...]]:
    for finding in audit.findings:
        yield finding.check, "passed" if finding.passed else "failed", finding.measured, finding.bound
    for rollout in audit.rollouts:
        episode = rollout.episode
        yield f"seed {rollout.seed}", episode.outcome, f"reward {episode.reward:.2f}: {episode.detail}"
    for warning in dict.fromkeys(warning for rollout in audit.rollouts for warning in rollout.warnings):
        yield "warning", "", warning
