"""The evidence that the router and the fixers read: the test report and, if it was run, the audit."""

from grs_agents.audit import AuditReport
from grs_agents.sandbox import TestReport
from grs_agents.state import RunState


def evidence(state: RunState) -> str:
    """The report of the latest tests and of the audit that followed them, as text."""
    parts = [TestReport.model_validate(state["report"]).text()] if state.get("report") else []
    if state.get("audit"):
        parts.append(AuditReport.model_validate(state["audit"]).text())
    return "\n\n".join(parts) or "(nothing was run yet)"
