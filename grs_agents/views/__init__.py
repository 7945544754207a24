"""What people see of a run, made from its events. The rerun view is not imported here, since importing rerun is slow:
use ``grs_agents.views.rerun.rerun_view`` (``RerunView``, ``rebuild``) where it is wanted."""

from grs_agents.lazy_exports import attach_lazy_exports

__getattr__, __dir__, __all__ = attach_lazy_exports(__name__, __file__)
