"""Program versions in the recording: the code, and what changed line by line."""

from pathlib import Path

import numpy as np
import rerun as rr

from grs_agents.foreign import member, read_bytes
from grs_agents.trace import ProgramVersion
from grs_agents.views.common import event_documents
from grs_agents.views.common.safe_text import drawable
from grs_agents.views.rerun.paths import Paths
from grs_agents.views.rerun.recording import Recording

_COLORS = {"+": (90, 220, 110), "-": (255, 105, 105), "@": (110, 170, 255)}
_GREY = (165, 165, 170)
_LONGEST = 400


def log_program(recording: Recording, folder: Path, event: ProgramVersion) -> None:
    """Show one version: its file as a document, its diff as coloured lines."""
    path = Paths.SIMULATION if event.program == "simulation" else Paths.TESTS
    source = read_bytes(member(folder, event.path)).decode("utf-8", "replace")
    recording.text(path, event_documents.program(event, source))
    head = f"{event.program} version {event.number}" + (f" by {event.author_role}" if event.author_role else "")
    lines = [head, *_changed(event, source)]
    columns = rr.TextLog.columns(
        text=[drawable(line) for line in lines],
        level=["INFO"] * len(lines),
        color=[(255, 255, 255), *(_COLORS.get(line[:1], _GREY) for line in lines[1:])],
    )
    recording.columns(Paths.DIFF, np.zeros(len(lines)), columns)


def _changed(event: ProgramVersion, source: str) -> list[str]:
    """The lines of the diff without its file names; of a first version only how long it is."""
    if event.parent is None or not event.diff:
        return [f"  {len(source.splitlines())} lines, new"]
    lines = [line for line in event.diff.splitlines() if not line.startswith(("---", "+++"))]
    more = [f"  ... {len(lines) - _LONGEST} more lines"] if len(lines) > _LONGEST else []
    return [*lines[:_LONGEST], *more]
