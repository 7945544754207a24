"""Write a plan out as a simulation program."""

import keyword
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

from grs_agents.models.offline.plan import (
    CONTAINER,
    MAX_ZONE_HEIGHT,
    ZONE,
    PlacementPlan,
    Target,
    may_leave_no_place,
)
from grs_agents.models.offline.prompt_text import FAR, GAP, PromptObject, make_identifier, split_words

_LANGUAGE_TEMPLATES = {
    "pack": "put the {} into the {}",
    "stack": "stack the {} on the {}",
    "clear": "move the {} to the {}",
}


def class_name_for_task(task: str) -> str:
    """CamelCase of a task's name."""
    return "".join(word.capitalize() for word in split_words(task)) or "PlaceObjects"


def write_program(plans: Sequence[PlacementPlan], title: str, description: str, spots: bool = False) -> str:
    """Write the program of plans that run in sequence: class ``title``, docstring ``description``.

    ``spots`` gives each object a spot inside its container or zone, instead of the whole zone.
    """
    objects = list(chain.from_iterable(plan.moved_objects for plan in plans))
    targets = list(chain.from_iterable(plan.targets for plan in plans))
    names: dict[str, str] = {}  # of the program's variables
    for name in [*(obj.name for obj in objects), *(target.name for target in targets)]:
        base, number = make_identifier(name), 2
        variable = base
        while variable in (*names.values(), *_RESERVED):
            variable, number = f"{base}_{number}", number + 1
        names[name] = variable

    # The largest random target is laid out first: the plan's place for it is free while no other place is drawn. If a
    # random target could take the places of the others, all others keep their places of the plan.
    relocated = any(obj.relocated for obj in objects)
    targets.sort(key=lambda target: -target.size[0] * target.size[1])
    drawn = [target for target in targets if target.moves]
    if not relocated and may_leave_no_place(drawn):
        targets = [replace(target, moves=target is drawn[0]) for target in targets]
    targets.sort(key=lambda target: target.moves)
    drawn = [target for target in targets if target.moves]
    known = [] if relocated else drawn[:1]

    steps = sum(len(plan.moves) for plan in plans)
    family = plans[0].family if len(plans) == 1 else ""
    text = description.replace("\\", "").replace('"', "'")
    lines = [
        "import numpy as np",
        "",
        "from grs_agents.sim import Task, utils",
        "",
        "",
        f"class {title}(Task):",
        f'    """{text}"""',
        "",
        "    def __init__(self):",
        "        super().__init__()",
        f"        self.max_steps = {steps + steps // 2 + 2}",
        f'        self.lang_template = "{_LANGUAGE_TEMPLATES.get(family, "put the {} on the {}")}"',
        '        self.task_completed_desc = "task completed."',
        "        self.additional_reset()",
        "",
        "    def reset(self, env):",
        "        super().reset(env)",
        *_object_code_lines(objects, names),
    ]
    for target in targets:
        lines += ["", *_target_code_lines(target, names, target in known)]
    for plan in plans:
        lines += ["", *_goal_code_lines(plan, names, spots, steps)]
    if relocated or drawn:
        lines[2] = "from grs_agents.sim import NoFreeSpaceError, Task, utils"
        reach = min((obj.far for obj in objects), default=FAR) + 0.03
        lines += ["", *(line.replace("REACH", f"{reach:.4g}") for line in _FIND_PLACE)]
    return "\n".join(lines) + "\n"


def _object_code_lines(objects: Sequence[PromptObject], names: dict[str, str]) -> list[str]:
    lines = ["", "        # The objects, where the photo shows them."]
    relocated = [obj for obj in objects if obj.relocated]
    for obj in objects:
        if not obj.relocated:
            pose = f"({_format_vector(obj.position)}, {_format_vector(obj.orientation)})"
            lines.append(f'        {names[obj.name]} = env.add_object("{obj.asset}", {pose})')
    if len(relocated) == len(objects):
        lines = []
    if relocated:
        lines += ["", "        # The objects that cannot be used where the photo shows them stand somewhere free."]
    for obj in relocated:
        lines += [
            f"        start = self.find_place(env, {_format_vector(obj.room)})",
            f"        start = utils.multiply(start, ((0, 0, 0), {_format_vector(obj.orientation)}))",
            f'        {names[obj.name]} = env.add_object("{obj.asset}", start)',
        ]
    return lines


def _target_code_lines(target: Target, names: dict[str, str], known: bool) -> list[str]:
    name = names[target.name]
    if target.obj:
        rotation = _format_vector(target.obj.orientation)
        return [
            f"        # The {target.label} serves where it stands.",
            f"        {name}_size = {_format_vector(target.size)}",
            f"        {name}_pose = ({_format_vector(target.obj.position)}, (0, 0, 0, 1))",
            f'        env.add_object("{target.obj.asset}", ({name}_pose[0], {rotation}), "fixed")',
        ]
    x, y = target.place
    lines = [f"        # The {target.label}.", f"        {name}_size = {_format_vector(target.size)}"]
    if target.moves:
        otherwise = f", ({x:.3f}, {y:.3f})" if known else ""
        lines.append(f"        {name}_pose = self.find_place(env, {name}_size{otherwise})")
    else:
        lines.append(f"        {name}_pose = (({x:.4f}, {y:.4f}, {target.size[2] / 2:.4f}), (0, 0, 0, 1))")
    if target.asset_name:
        template = CONTAINER if target.kind == "container" else ZONE
        lines += [
            f"        {name}_urdf = self.fill_template(",
            f'            "{template}", {{"DIM": {name}_size, "COLOR": utils.COLORS["{target.color}"]}}',
            "        )",
            f'        env.add_object({name}_urdf, {name}_pose, "fixed")',
        ]
    return lines


def _goal_code_lines(plan: PlacementPlan, names: dict[str, str], spots: bool, steps: int) -> list[str]:
    exact = plan.exact or any(obj.size[2] > MAX_ZONE_HEIGHT for obj in plan.moved_objects)
    metric, spots = "pose" if exact else "zone", spots and not exact
    extent = "spot" if spots else "size"
    rows: list[str] = []
    for move in plan.moves:
        name, target, obj = names[move.target.name], move.target, move.obj
        middle = target.obj.position[2] if target.obj else target.size[2] / 2
        offset = (move.offset[0], move.offset[1], move.offset[2] - middle)
        size = _format_vector((obj.size[0] + GAP, obj.size[1] + GAP, obj.size[2])) if spots else f"{name}_size"
        row = f'{names[obj.name]}, "{obj.label}", "{target.label}", {name}_pose, {size}'
        rows.append(f"            ({row}, {_format_vector(offset)}, {_format_vector(obj.orientation)}),")
    lines = [
        "        # One goal for each object, in the order in which the robot moves them:",
        f"        # object, its name, where to (name, pose, {extent}), offset from there, rotation.",
        "        moves = [",
        *rows,
        "        ]",
        f"        for item, label, place, pose, {extent}, offset, rotation in moves:",
        "            target = utils.multiply(pose, (offset, rotation))",
    ]
    if spots:
        lines.append("            around = utils.multiply(pose, (offset, (0, 0, 0, 1)))")
    params = "[(around, spot)]" if spots else "[(pose, size)]" if metric == "zone" else "[]"
    lines += [
        "            self.add_goal(",
        "                objs=[item],",
        "                matches=np.int32([[1]]),",
        "                targ_poses=[target],",
        "                replace=False,",
        "                rotations=True,",
        f'                metric="{metric}",',
        f"                params={params},",
        f"                step_max_reward=1 / {'len(moves)' if len(plan.moves) == steps else steps},",
        *(["                symmetries=[np.pi],"] if metric == "pose" else []),
        "                language_goal=self.lang_template.format(label, place),",
        "            )",
    ]
    return lines


def _format_vector(values: tuple[float, ...]) -> str:
    texts = (f"{value:.4f}".rstrip("0").rstrip(".") if abs(value) >= 5e-5 else "0" for value in values)
    return f"({', '.join(texts)})"


_RESERVED = frozenset(
    {
        *("self", "env", "np", "utils", "start", "moves", "item", "label", "place", "pose", "size", "spot"),
        *("offset", "rotation", "target", "around"),
        *keyword.kwlist,
    }
)
_FIND_PLACE = [
    "    def find_place(self, env, size, known=None):",
    '        """A free pose in easy reach for something of this size; the known free (x, y) where none turns up."""',
    "        reach = REACH - np.hypot(size[0], size[1]) / 2",
    "        for _ in range(20):",
    "            position, rotation = self.get_random_pose(env, size)",
    "            if position is not None and np.hypot(position[0], position[1]) < reach:",
    "                return (position[0], position[1], size[2] / 2), rotation",
    "        if known is None:",
    '            raise NoFreeSpaceError(f"no free place of {size[0]:.2f} x {size[1]:.2f} m", "use a smaller target")',
    "        return (known[0], known[1], size[2] / 2), (0, 0, 0, 1)",
]
