from .checks import audit as audit
from .photo_changes import changes as changes
from .types import AuditReport as AuditReport
from .types import Change as Change
from .types import Finding as Finding
