"""``grs show`` and ``grs replay``."""

import json
import tempfile
from pathlib import Path

from grs_agents.base import terminal
from grs_agents.base.errors import InputError
from grs_agents.base.terminal import print_escaped, print_json
from grs_agents.base.trace.log import read_events
from grs_agents.library.library import Library
from grs_agents.runs.record import read_record


def show_run(folder: Path, as_json: bool) -> None:
    """Print the steps of a run."""
    from grs_agents.views.common.event_steps import group_events_into_steps
    from grs_agents.views.terminal import step_to_dict, steps_tree, summary_table

    record = read_record(folder).model_dump(mode="json")
    rows = group_events_into_steps(read_events(folder / "events.jsonl"))
    if as_json:
        print_json({"run": record, "steps": [step_to_dict(step) for step in rows]})
        return
    console = terminal.make_console()
    console.print(steps_tree(rows))
    console.print(summary_table(record))


def show_step(folder: Path, number: int | None, as_json: bool) -> None:
    """Print a step in full; without a ``number`` the last step with a problem."""
    from grs_agents.views.common.event_steps import group_events_into_steps
    from grs_agents.views.common.step_text import find_last_failed_step, find_step_by_number, iter_step_sections
    from grs_agents.views.terminal import step_to_dict

    read_record(folder)
    rows = group_events_into_steps(read_events(folder / "events.jsonl"))
    step = find_last_failed_step(rows) if number is None else find_step_by_number(rows, number)
    if as_json:
        events = [event.model_dump(mode="json") for event in step.events] if step else []
        print_json({**step_to_dict(step), "events": events} if step else None)
    elif step is None:
        print_escaped("no step went wrong")
    else:
        problem = f": {step.problem_summary}" if step.problem_summary else ""
        print_escaped(
            f"step {step.number}: {step.node}, visit {step.visit}, {step.status} in {step.seconds:.1f} s{problem}"
        )
        for section in iter_step_sections(step):
            print_escaped(f"\n=== {section.heading}\n{section.text}".rstrip())


def make_recording(folder: Path, file: Path) -> Path:
    """Record a run from its events, as far as it has come, into ``file``. Raises InputError: no events."""
    from grs_agents.views.common.foreign_decoding import decode_in_worker
    from grs_agents.views.rerun.rerun_view import record_run

    read_record(folder)
    with decode_in_worker(folder):
        written = record_run(folder, Library(), file)
    if not written:
        raise InputError(f"{folder} holds nothing to show: the run logged no event", "run the scene again")
    return file


def play_in_window(folder: Path, seed: int | None) -> int:
    """Play a rollout of a run in MuJoCo's window."""
    from grs_agents.views.common.foreign_decoding import decode_in_worker
    from grs_agents.views.film.rollout_film import make_rollout_shot, play_in_mujoco_window

    read_record(folder)
    with decode_in_worker(folder):
        shot = make_rollout_shot(folder, seed)
    return play_in_mujoco_window(shot)


def open_run_viewer(folder: Path, beside: Path | None, web: bool, as_json: bool) -> int:
    """Open the viewer on a run, or on two runs side by side. Recordings are made from the events: the folder's
    ``trace.rrd`` may be incomplete or forged."""
    from grs_agents.views.terminal import show_activity_status

    read_record(folder)
    with tempfile.TemporaryDirectory() as temporary:
        if beside is None:
            with show_activity_status("making the recording"):
                recording = make_recording(folder, Path(temporary) / "trace.rrd")
            return open_viewer_and_wait(recording, web, as_json)
        from grs_agents.views.common.foreign_decoding import decode_in_worker
        from grs_agents.views.rerun.rerun_view import record_comparison

        read_record(beside)
        runs = [(folder, Library()), (beside, Library())]
        with decode_in_worker(folder, beside):
            recording = record_comparison(runs, Path(temporary) / "both.rrd")
        return open_viewer_and_wait(recording, web, as_json)


def open_viewer_and_wait(recording: Path, web: bool, as_json: bool) -> int:
    """Open the viewer on ``recording`` and wait until it is closed."""
    from grs_agents.views.rerun.viewer import WebAddress, open_viewer

    address = WebAddress.with_free_ports() if web else None
    with open_viewer(recording, address) as process:
        if address:
            print_escaped(json.dumps({"url": address.url}) if as_json else f"open {address.url}", flush=True)
        return process.wait()
