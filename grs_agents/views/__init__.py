"""What people see of a run, made from its events. The rerun view is not imported here, since importing rerun is slow:
use ``grs_agents.views.rerun.rerun_view`` (``RerunView``, ``rebuild``) where it is wanted."""
