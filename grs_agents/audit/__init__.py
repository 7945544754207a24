"""What makes a result trustworthy: checks on task instances, measured by trusted code."""

from grs_agents.audit.checks import audit
from grs_agents.audit.photo_changes import changes
from grs_agents.audit.types import AuditReport, Change, Finding

__all__ = ["AuditReport", "Change", "Finding", "audit", "changes"]
