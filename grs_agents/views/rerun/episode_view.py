"""The rerun recording of a single episode of an evaluation."""

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import rerun as rr

from grs_agents.tasks.suites.evaluation import EpisodeResult, motion_file_name
from grs_agents.views.common.safe_text import to_markdown_cell, to_viewer_markdown
from grs_agents.views.film.rollout_film import RolloutShot
from grs_agents.views.rerun.recording import Paths, RerunRecording
from grs_agents.views.rerun.rollout_view import RolloutView
from grs_agents.views.rerun.viewer_layout import build_episode_blueprint


def record_episode(shot: RolloutShot, row: EpisodeResult, path: Path) -> Path:
    """Record an episode for the rerun viewer into the file ``path``: poses, robot, goals, grasps, and its figures."""
    name = Path(motion_file_name(row)).stem
    with closing(RerunRecording(path, name, build_episode_blueprint())) as recording:
        recording.log_markdown(Paths.TASK, _describe_episode(name, row))
        seconds = np.array([RolloutView(shot.folder, shot.library).show_rollout(recording, shot.event)])
        recording.log_columns(f"{Paths.METRICS}/reward", seconds, rr.Scalars.columns(scalars=[row.strict]))
    return path


def _describe_episode(name: str, row: EpisodeResult) -> str:
    rows: Sequence[tuple[str, str]] = (
        ("outcome", row.outcome.replace("_", " ") + (f": {row.detail}" if row.detail else "")),
        ("instance", str(row.instance)),
        ("goals met at the end, at best", f"{row.progress:.0%}, {row.best_progress:.0%}"),
        ("actions, simulated seconds", f"{row.steps}, {row.seconds:.1f}"),
        ("path of the tip", f"{row.path:.2f} m"),
        ("disturbed", ", ".join(row.disturbed) or "nothing"),
        ("dropped", str(row.dropped)),
        ("perturbed", ", ".join(row.factors) or "nothing"),
    )
    cells = (f"| {title} | {to_markdown_cell(text)} |" for title, text in rows)
    return to_viewer_markdown("\n".join((f"## {name}", "", row.instruction, "", "| | |", "|---|---|", *cells)))
