"""``grs show`` and ``grs replay``."""

import tempfile
from pathlib import Path

from grs_agents import terminal
from grs_agents.errors import InputError
from grs_agents.library import Library
from grs_agents.run import read_record
from grs_agents.terminal import say, say_json
from grs_agents.trace import RunEnded, read_events


def show_run(folder: Path, as_json: bool) -> None:
    """Print the steps of a run."""
    from grs_agents.views import step_record, steps, steps_tree, summary_table

    record = read_record(folder).model_dump(mode="json")
    rows = steps(read_events(folder / "events.jsonl"))
    if as_json:
        say_json({"run": record, "steps": [step_record(step) for step in rows]})
        return
    console = terminal.console()
    console.print(steps_tree(rows))
    console.print(summary_table(record))


def show_step(folder: Path, number: int | None, as_json: bool) -> None:
    """Print one step in full; without a ``number`` the last one that went wrong."""
    from grs_agents.views import failed_step, find_step, sections, step_record, steps

    read_record(folder)
    rows = steps(read_events(folder / "events.jsonl"))
    step = failed_step(rows) if number is None else find_step(rows, number)
    if as_json:
        events = [event.model_dump(mode="json") for event in step.events] if step else []
        say_json({**step_record(step), "events": events} if step else None)
    elif step is None:
        say("no step went wrong")
    else:
        trouble = f": {step.trouble}" if step.trouble else ""
        say(f"step {step.number}: {step.node}, visit {step.visit}, {step.status} in {step.seconds:.1f} s{trouble}")
        for section in sections(step):
            say(f"\n=== {section.heading}\n{section.text}".rstrip())


def rebuild_recording(folder: Path) -> Path:
    """The recording of a run, made from its events."""
    from grs_agents.views.rerun import rebuild

    read_record(folder)
    recording = rebuild(folder, Library())
    if not recording.is_file():
        raise InputError(f"{recording} cannot be made: the run logged no event", "run the scene again")
    return recording


def replay_run(folder: Path, beside: Path | None, web: bool) -> int:
    """Open the viewer on a run's recording, made from the events where it is not whole, or on two runs side by side."""
    read_record(folder)
    with tempfile.TemporaryDirectory() as temporary:
        if beside is None:
            return _viewed(_recording(folder, Path(temporary)), web)
        from grs_agents.views.rerun import compare

        read_record(beside)
        runs = [(folder, Library()), (beside, Library())]
        return _viewed(compare(runs, Path(temporary) / "both.rrd"), web)


def _viewed(recording: Path, web: bool) -> int:
    """Wait for the viewer of ``recording`` to be closed."""
    from grs_agents.views import WebAddress, viewing

    address = WebAddress.free() if web else None
    with viewing(recording, address) as process:
        if address:
            say(f"open {address.url}", flush=True)
        return process.wait()


def _recording(folder: Path, temporary: Path) -> Path:
    """The recording of a run; of one that was cut short or still goes on, a copy that holds its last event too."""
    from grs_agents.views import working
    from grs_agents.views.rerun import record

    events = read_events(folder / "events.jsonl")
    with working("making the recording"):
        if events and not isinstance(events[-1], RunEnded) and record(folder, Library(), temporary / "trace.rrd"):
            return temporary / "trace.rrd"
        recording = folder / "trace.rrd"
        return recording if recording.is_file() else rebuild_recording(folder)
