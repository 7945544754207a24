"""The evidence that routers, fixers and policies get: a text, and a picture of the end of the robot's episode.

The text has the static findings, tests, episodes of the oracle and the audit under headings ``== ...``. An episode that
several tests or seeds share is shown once.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import cv2

from grs_agents.audit.types import AuditReport, StaticFinding
from grs_agents.base import Pose, Vec3
from grs_agents.base.files import write_bytes
from grs_agents.base.foreign.pictures import read_picture
from grs_agents.graph.policies.types import read_episode
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState
from grs_agents.graph.task_instances import instantiate_program_for_seeds, play_unrecorded
from grs_agents.sandbox.protocol.report import OUTCOME_MEANINGS, TestReport
from grs_agents.sandbox.protocol.tracebacks import SIMULATION_FILE, TESTS_FILE
from grs_agents.sim.arms.arm_files import resolve_robot_path
from grs_agents.sim.instance.episode import Episode
from grs_agents.sim.instance.task_instance import TaskInstance, parse_instance_json

EPISODES, ROWS, CLAUSES = 3, 24, 6
"""Bounds on the distinct episodes, the tests or rows of a table, and the shortfalls of a goal that are shown."""
_LINE: Final = 1000
"""Longer lines are cut, characters."""
_TILTED: Final = 5
"""Least tilt that is shown, degrees."""
MARKED: Final = 3
"""Bound on the objects that are outlined."""
_COLOR: Final = (255, 0, 255)  # BGR
_ROBOT_VIEW: Final = {"position": (-0.35, 0.0, 0.85), "target": (0.5, 0.0, 0.0)}
"""Camera above the robot's base that has the whole workspace in view, metres, robot frame."""
_FONT: Final = 0.45
_LINES, _OVER_NAME, _AWAY = 4, 10, 0.5
"""Lines above and below a box at which its name is tried, the weight of what it hides of other names, and
the cost of a line away from its box as a share of the area of the name."""
_Box = tuple[int, int, int, int]
_FRAME = re.compile(r'^\s*File "(?P<file>[^"]*)", line (?P<line>\d+), in (?P<function>.*)$')


def render_evidence(
    report: TestReport | None, audit: AuditReport | None = None, findings: Sequence[StaticFinding] = ()
) -> str:
    """The evidence about a pair of programs as text."""
    static = [f"{finding.program} line {finding.line}: {finding.kind}: {finding.message}" for finding in findings]
    sections = [["== static checks", *static] if static else [], _tests_section(report)]
    named: dict[str, list[str]] = {}  # tests and seeds by the text of their episode, failed tests first
    for case in sorted(report.cases if report else (), key=lambda case: case.outcome == "passed"):
        if (episode := read_episode(case.episode)) is not None:
            hook = f"{case.episode_hook} of " if case.episode_hook not in ("", "test") else ""
            named.setdefault("\n".join(_episode_lines(episode)), []).append(f"{hook}{case.id}")
    shown = dict(list(named.items())[:EPISODES])
    if audit is not None:
        held = [finding.check for finding in audit.findings if finding.passed]
        head = f"{'accepted' if audit.accepted else 'failed'}: {len(held)} of {len(audit.findings)} checks hold"
        failed = [f"- {finding.check}: FAILED: {finding.detail}" for finding in audit.failures]
        seeds = [
            f"seed {rollout.seed}: {rollout.episode.outcome}, published {rollout.episode.reward:.2f}, "
            f"strict {rollout.episode.strict:.2f}, steps {rollout.episode.steps}/{rollout.episode.max_steps}"
            for rollout in audit.rollouts
        ]
        sections.append(["== audit", f"{head}: {', '.join(held)}" if held else head, *failed, *seeds])
        if audit.rollouts:
            shortest = min(audit.rollouts, key=lambda rollout: rollout.episode.strict)
            shown.setdefault("\n".join(_episode_lines(shortest.episode)), []).append(f"audit seed {shortest.seed}")
    sections += [[f"== oracle episode ({', '.join(names)})", *text.splitlines()] for text, names in shown.items()]
    return "\n\n".join("\n".join(line[:_LINE] for line in lines) for lines in sections if lines) or "(nothing was run)"


def _tests_section(report: TestReport | None) -> list[str]:
    """The outcome of each test, failed tests first; a traceback that several tests share is shown once."""
    if report is None:
        return []
    passed = sum(case.outcome == "passed" for case in report.cases)
    head = f"{report.outcome}: {passed} of {len(report.cases)} tests passed"
    lines = ["== tests", head + (f"; {report.message}" if report.message else "")]
    if not report.cases and report.raised_in:
        lines.append(f"raised in: {report.raised_in}")
    lines += _relevant_traceback(report.traceback)
    first_with: dict[str, str] = {}  # test ids by the end of the traceback
    cases = sorted(report.cases, key=lambda case: case.outcome == "passed")
    for case in cases[:ROWS]:
        message = f": {case.message}" if case.message else ""
        is_assertion = case.outcome == "failed" and case.raised_in == "tests"
        if is_assertion:
            frames = [match for match in map(_FRAME.match, case.traceback.splitlines()) if match]
            line = next((f", line {frame['line']}" for frame in reversed(frames) if frame["file"] == TESTS_FILE), "")
            message = message.removeprefix(": AssertionError")
            lines.append(f"{case.id}: failed: assertion failed in {case.id}{line}{message}")
        else:
            place = f" (raised in {case.raised_in})" if case.raised_in else ""
            lines.append(f"{case.id}: {case.outcome}{place}{message}")
        if case.outcome == "passed":
            continue
        if case.traceback and not is_assertion:
            first = first_with.setdefault(case.traceback.partition("\n")[2][-300:], case.id)
            lines += _relevant_traceback(case.traceback) if first == case.id else [f"  as in {first}"]
        if case.output.strip():
            lines.append("  printed: " + " | ".join(case.output.strip().splitlines()[-5:])[-300:])
    if len(cases) > ROWS:
        lines.append(f"and {len(cases) - ROWS} more tests")
    outcomes = dict.fromkeys([report.outcome, *(case.outcome for case in report.cases)])
    return [*lines, *(f"({name}: {OUTCOME_MEANINGS[name]})" for name in outcomes if name in OUTCOME_MEANINGS)]


def _relevant_traceback(traceback: str) -> list[str]:
    """The last lines of a traceback: its frames in the two programs, and the exception."""
    kept: list[str] = []
    relevant = True
    for line in traceback.splitlines():
        if frame := _FRAME.match(line):
            relevant = frame["file"] in (SIMULATION_FILE, TESTS_FILE)
        elif not line.startswith("  "):
            relevant = True
        if relevant and line.strip(" ^~") and not line.startswith("Traceback "):
            kept.append(f"  {line}")
    return kept[-12:]


def _episode_lines(episode: Episode) -> Iterator[str]:
    yield f"outcome: {episode.outcome}"
    steps = f"{episode.steps}/{episode.max_steps}"
    yield f"published: {episode.reward:.2f}  strict: {episode.strict:.2f}  steps: {steps}"
    yield f"detail: {episode.detail}"
    if episode.arm_failure[0]:
        asset, why = episode.arm_failure
        yield f"physics: the arm cannot hold {asset} there: {why}"
    if episode.objects:
        yield f"concerns: {', '.join(episode.objects)}"
    goals: list[str] = []
    for goal in episode.goals:
        row = f"worth {goal.worth:.2f}, published {goal.published:.2f}, strict {goal.strict:.2f}: {goal.goal}"
        verb = "no longer" if goal.met else "misses"  # a later goal may move its objects on
        goals.append(f"{row}; {verb}: {'; '.join(goal.shortfalls[:CLAUSES])}" if goal.shortfalls else row)
    actions = [
        f"{number}. {action.asset} #{action.object} {_point(action.pick)} -> {_point(action.place)}: {action.note}"
        for number, action in enumerate(episode.actions, 1)
    ]
    objects: list[str] = []
    for motion in sorted(episode.motions, key=lambda motion: not motion.moved):
        end = f" -> {_point(motion.end)}" if motion.moved else ", not moved"
        tilt = f", tilted {motion.tilt:.0f} degrees" if motion.tilt >= _TILTED else ""
        color = f"{motion.color} " if motion.color else ""
        objects.append(f"{color}{motion.asset} #{motion.object} {_point(motion.start)}{end}{tilt}")
    tables: dict[str, Sequence[str]] = {
        "goals": goals,
        "actions": actions,
        "objects": objects,
        "warnings": episode.warnings,
    }
    for title, rows in tables.items():
        if rows:
            yield f"{title}:"
            yield from (f"  {row}" for row in rows[:ROWS])
        if len(rows) > ROWS:
            yield f"  and {len(rows) - ROWS} more"


def _point(position: Vec3) -> str:
    return f"({', '.join(f'{value:.3f}' for value in position)})"


# --- the picture


def draw_end_of_episode(state: RunState, services: Services, role: str) -> list[str]:
    """Draw the end of the robot's episode with the objects at fault outlined.

    The episode is that of the audit's seed with the lowest strict score; before an audit, a new rollout of the first
    seed.

    Returns:
        The path in the run folder; nothing where the model of ``role`` sees no pictures, or none can be drawn.
    """
    config = services.config
    if role == "fix_tests" or not (config.end_picture and state.get("image") and services.agents.sees_pictures(role)):
        return []
    path = f"history/end_{state.get('fixes', 0):03d}.png"
    output = services.folder / path
    if output.is_file():
        return [path]
    audit = state.get("audit")
    if audit and audit.rollouts:
        rollout = min(audit.rollouts, key=lambda rollout: rollout.episode.strict)
        file = services.folder / f"instances/seed_{rollout.seed}.json"
        instance = resolve_robot_path(parse_instance_json(file.read_text(encoding="utf-8")), services.folder)
    else:
        drawn, _ = instantiate_program_for_seeds(state["simulation"], [config.seed], services, state["scene"])
        if not drawn or (rollout := play_unrecorded(drawn[0], services)) is None:
            return []
        instance = drawn[0]
    marked = find_ids_of_failed_objects(rollout.episode)
    return [path] if draw_from_photo(instance, rollout.final, output, services, marked) else []


def draw_from_photo(
    instance: TaskInstance, poses: Mapping[int, Pose], output: Path, services: Services, marked: Sequence[int] = ()
) -> bool:
    """Draw a task instance as the photo's camera sees it, with textures and names; without a photo from behind the
    robot, so that its left is left.

    Args:
        instance: the instance.
        poses: pose of each object by id (m, robot frame).
        output: the PNG file.
        services: of the run.
        marked: ids of objects to outline.

    Returns:
        False if nothing could be drawn.
    """
    view = {"from_photo": True} if instance.camera is not None else {"textured": True, **_ROBOT_VIEW}
    names = {item.id: item.name or item.asset for item in instance.objects}
    picture = services.render_instance(
        instance, output, poses=dict(poses), boxed=tuple(names), marked=tuple(marked), **view
    )
    if picture.image is not None:
        write_names_beside_boxes(output, picture.boxes, names)
    return picture.image is not None


def find_ids_of_failed_objects(episode: Episode) -> list[int]:
    """Ids of the objects that miss the goal with the lowest score; else of those that the episode's end concerns."""
    for goal in sorted(episode.goals, key=lambda goal: goal.strict):
        missed = [
            motion.object
            for motion in episode.motions
            if any(clause.startswith(f"{motion.asset} #{motion.object} ") for clause in goal.shortfalls)
        ]
        if missed:
            return missed[:MARKED]
    return [motion.object for motion in episode.motions if motion.asset in episode.objects][:MARKED]


def write_names_beside_boxes(file: Path, boxes: Mapping[int, _Box], names: Mapping[int, str]) -> None:
    """Write names into a picture file, above or below boxes (left, top, right, bottom) in pixels, where they hide the
    least of boxes and of other names, with a line to the middle of the box."""
    picture = read_picture(file, cv2.IMREAD_COLOR)
    taken: list[_Box] = []
    for number, (left, top, right, bottom) in sorted(boxes.items(), key=lambda entry: entry[1][1]):
        text = f"{names[number]} #{number}"
        (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, _FONT, 1)
        x, line = max(0, min(left, picture.shape[1] - width - 4)), height + 8
        costs: dict[_Box, float] = {}
        for step in range(_LINES):
            for y in (top - 6 - step * line, bottom + height + 6 + step * line):
                if height + 3 <= y < picture.shape[0] - 4:
                    plate = (x, y - height - 3, x + width + 4, y + 4)
                    hidden = sum(_area_in_common(plate, box) for box in boxes.values())
                    hidden += _OVER_NAME * sum(_area_in_common(plate, name) for name in taken)
                    costs[plate] = hidden + step * _AWAY * line * width
        plate = min(costs, key=lambda plate: costs[plate], default=(x, 0, x + width + 4, height + 7))
        taken.append(plate)
        middle, edge = ((left + right) // 2, (top + bottom) // 2), plate[3] if plate[3] < bottom else plate[1]
        cv2.line(picture, (min(max(middle[0], plate[0]), plate[2]), edge), middle, _COLOR, 1, cv2.LINE_AA)
        cv2.rectangle(picture, plate[:2], plate[2:], (255, 255, 255), -1)
        cv2.putText(picture, text, (x + 2, plate[3] - 4), cv2.FONT_HERSHEY_SIMPLEX, _FONT, _COLOR, 1, cv2.LINE_AA)
    write_bytes(file, cv2.imencode(".png", picture)[1].tobytes())


def _area_in_common(first: _Box, second: _Box) -> int:
    """Area of the overlap of two boxes, pixels."""
    width = min(first[2], second[2]) - max(first[0], second[0])
    height = min(first[3], second[3]) - max(first[1], second[1])
    return max(width, 0) * max(height, 0)
