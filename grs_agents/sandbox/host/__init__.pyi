from . import streams as streams
from . import zygote_process as zygote_process
from .streams import Streams as Streams
from .suite_discovery import MAX_SOURCE as MAX_SOURCE
