from .checks import audit_task as audit_task
from .pose_changes import find_pose_changes as find_pose_changes
from .types import AuditReport as AuditReport
from .types import Change as Change
from .types import Finding as Finding
