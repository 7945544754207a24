"""``grs check``."""

import json
import tempfile
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from grs_agents.audit import AuditReport
from grs_agents.config import Config
from grs_agents.run import CheckOrder, check
from grs_agents.sandbox import TestReport


def check_program(simulation: Path, tests: Path | None, config: Config, as_json: bool) -> int:
    """Check a program and print what was found.

    Returns:
        0 if its tests pass and the audit accepts it, 1 if not.
    """
    with tempfile.TemporaryDirectory(prefix="grs-check-") as folder:
        report, audit = check(CheckOrder(simulation, tests, config, Path(folder)))
    accepted = audit.accepted and (report is None or report.ok)
    if as_json:
        value = {
            "status": "accepted" if accepted else "rejected",
            "tests": None if report is None else report.model_dump(mode="json"),
            "audit": audit.model_dump(mode="json"),
        }
        print(json.dumps(value, indent=2))
    else:
        _print(report, audit, accepted)
    return 0 if accepted else 1


def _print(report: TestReport | None, audit: AuditReport, accepted: bool) -> None:
    console = Console()
    table = Table("check", "result", "detail", title="accepted" if accepted else "rejected")
    for case in report.cases if report is not None else ():
        table.add_row(*map(Text, (case.id, case.outcome, case.message)))
    if report is not None and not report.cases:
        table.add_row(*map(Text, ("tests", report.outcome, report.message)))
    for finding in audit.findings:
        table.add_row(*map(Text, (finding.check, "passed" if finding.passed else "failed", finding.detail)))
    for rollout in audit.rollouts:
        episode = rollout.episode
        table.add_row(
            *map(Text, (f"seed {rollout.seed}", episode.outcome, f"reward {episode.reward:.2f}: {episode.detail}"))
        )
    for warning in dict.fromkeys(warning for rollout in audit.rollouts for warning in rollout.warnings):
        table.add_row(*map(Text, ("warning", "", warning)))
    console.print(table)
    console.print(Text(audit.about))
