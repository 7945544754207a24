"""What people see of a run, made from its events.

The rerun view is not imported here, since importing rerun is slow: use
``grs_agents.views.rerun.rerun_view`` (``RerunView``, ``rebuild``) where it is wanted.
"""

from grs_agents.views.common.event_steps import Step, Steps, steps
from grs_agents.views.common.step_text import failed_step, find_step, sections
from grs_agents.views.live import follow
from grs_agents.views.rerun.viewer import WebAddress, live_viewer, viewer_command, viewing
from grs_agents.views.terminal import Progress, step_record, steps_tree, summary_table, working

__all__ = [
    "Progress",
    "Step",
    "Steps",
    "WebAddress",
    "failed_step",
    "find_step",
    "follow",
    "live_viewer",
    "sections",
    "step_record",
    "steps",
    "steps_tree",
    "summary_table",
    "viewer_command",
    "viewing",
    "working",
]
