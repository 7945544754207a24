"""What people see of a run, made from its events.

The rerun view is not imported here, since importing rerun is slow: use
``grs_agents.views.rerun_view`` (``RerunView``, ``rebuild``) where it is wanted.
"""

from grs_agents.views.steps import Step, Steps, steps
from grs_agents.views.terminal import Progress, steps_table, summary_table
from grs_agents.views.viewer import open_viewer, viewer_command

__all__ = [
    "Progress",
    "Step",
    "Steps",
    "open_viewer",
    "steps",
    "steps_table",
    "summary_table",
    "viewer_command",
]
