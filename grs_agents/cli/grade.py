"""``grs grade``."""

from pathlib import Path

from rich.table import Table
from rich.text import Text

from grs_agents.base import terminal
from grs_agents.base.terminal import print_json
from grs_agents.tasks.grading.grade import grade_task
from grs_agents.tasks.grading.trials import GradeOrder
from grs_agents.tasks.task_folder import open_task_folder
from grs_agents.views.terminal import show_activity_status


def print_grade(run: Path, order: GradeOrder, workers: int, as_json: bool) -> int:
    """Grade a task and print its difficulty with the parts of the grade."""
    folder = open_task_folder(run)
    with show_activity_status("grading the task") as show:
        grade = grade_task(folder, order, workers, lambda stage, done, total: show(f"{stage}: {done}/{total}"))
    if as_json:
        print_json({"run": str(run), "order": order.model_dump(mode="json"), **grade.model_dump(mode="json")})
        return 0
    console = terminal.make_console()
    table = Table(box=None, pad_edge=False, header_style="bold", title=f"{run}: difficulty {grade.difficulty:.2f}")
    for column in ("part", "value", "difficulty", "weight", "what it is"):
        table.add_column(column, overflow="fold", no_wrap=column != "what it is")
    for part in grade.parts:
        value = f"{part.value:.0%}" if part.unit == "share" else f"{part.value:.3g} {part.unit}"
        table.add_row(*map(Text, (part.name, value, f"{part.difficulty:.2f}", f"{part.weight:.1f}", part.meaning)))
    console.print(table)
    figures = grade.figures
    noise = ", ".join(f"{1000 * metres:g} mm {share:.0%}" for metres, share in figures.noise_success)
    console.print(Text(f"the expert solves, by how far its hand misses: {noise}"))
    crowd, yaw = figures.clutter.objects_per_square_metre, figures.tolerance.degrees
    yaws = "any yaw will do" if yaw >= 180 else f"yaw within {yaw:.0f} degrees"
    console.print(Text(f"{crowd:.0f} objects a square metre; {yaws}; {figures.demonstrations} demonstrations"))
    return 0
