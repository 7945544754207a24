"""The judge by rules: agrees where goals ask for what the words say, and never where they do not."""

from dataclasses import replace
from functools import cache
from typing import Any

import pytest

from grs_agents.audit.goal_sentences import TaskInWords, describe_task_in_words
from grs_agents.library.library import Library
from grs_agents.sim import TaskInstance, rollout
from tests.models.conftest import Json
from tests.models.roles import judge

CORN, TUNA, MILK, RAISINS, RED, BLUE = range(1, 7)
BOX, BOWL, ZONE = range(7, 10)
THINGS: dict[int, tuple[str, tuple[float, float, float], str]] = {
    CORN: ("HOPE/Corn.urdf", (0.42, -0.1, 0.029), "rigid"),
    TUNA: ("HOPE/Tuna.urdf", (0.4, 0.08, 0.017), "rigid"),
    MILK: ("HOPE/Milk.urdf", (0.36, -0.28, 0.095), "rigid"),
    RAISINS: ("HOPE/Raisins.urdf", (0.38, 0.26, 0.062), "rigid"),
    RED: ("block/red_block.urdf", (0.3, -0.42, 0.02), "rigid"),
    BLUE: ("block/blue_block.urdf", (0.3, 0.42, 0.02), "rigid"),
    BOX: ("container/open_box.urdf", (0.6, 0.12, 0.045), "fixed"),
    BOWL: ("bowl/bowl.urdf", (0.58, -0.36, 0.03), "fixed"),
    ZONE: ("zone/zone.urdf", (0.56, -0.14, 0.001), "fixed"),
}
TASKS: dict[str, list[Json]] = {
    "pack": [{"kind": "inside", "objects": [CORN, TUNA], "reference": BOX}],
    "stack": [{"kind": "on", "objects": [CORN], "reference": ZONE}, {"kind": "stacked", "objects": [CORN, TUNA]}],
    "tidy": [
        {"kind": "inside", "objects": [RED], "reference": BOWL},
        {"kind": "in_zone", "objects": [RAISINS], "reference": ZONE},
    ],
    "beside": [{"kind": "near", "objects": [TUNA], "reference": MILK, "distance": 0.06}],
    "swap": [{"objects": [RED], "place": BLUE}, {"objects": [BLUE], "place": RED}],
    "unpack": [
        {"kind": "in_zone", "objects": [TUNA], "reference": ZONE},
        {"kind": "in_zone", "objects": [RED], "reference": ZONE},
    ],
    "aside": [{"objects": [TUNA], "at": (0.38, -0.15)}],
    "askew": [{"objects": [TUNA], "at": (0.46, -0.24)}],
    "amid": [{"objects": [TUNA], "at": (0.39, -0.19)}],
    "amiss": [{"objects": [TUNA], "at": (0.45, -0.2)}],
    "in line": [{"objects": [TUNA], "at": (0.43, -0.02)}],
    "together": [{"kind": "inside", "objects": [RED, BLUE], "reference": BOX}],
    "row": [{"objects": [RED], "at": (0.3, -0.02)}, {"objects": [BLUE], "at": (0.3, 0.04)}],
    "wide row": [{"objects": [RAISINS], "at": (0.3, 0.0)}, {"objects": [MILK], "at": (0.3, 0.134)}],
    "marked row": [
        {"kind": "in_zone", "objects": [RED], "reference": ZONE},
        {"kind": "in_zone", "objects": [BLUE], "reference": ZONE},
    ],
    "far row": [{"objects": [RED], "at": (0.3, -0.1)}, {"objects": [BLUE], "at": (0.3, 0.1)}],
    "around": [{"objects": [RED], "at": (0.36, -0.36)}, {"objects": [BLUE], "at": (0.36, -0.2)}],
    "on one side": [{"objects": [RED], "at": (0.3, -0.2)}, {"objects": [BLUE], "at": (0.36, -0.2)}],
    "near by far": [{"kind": "near", "objects": [TUNA], "reference": MILK, "distance": 0.2}],
    "row on zone": [
        {"kind": "in_zone", "objects": [RED, BLUE], "reference": ZONE},
        {"kind": "aligned", "objects": [RED, BLUE], "distance": 0.06},
    ],
    "row, then zone": [
        {"kind": "aligned", "objects": [RED, BLUE], "distance": 0.06},
        {"kind": "in_zone", "objects": [RED, BLUE], "reference": ZONE},
    ],
    "two cans": [
        {"kind": "on", "objects": [RED], "reference": CORN},
        {"kind": "on", "objects": [BLUE], "reference": TUNA},
    ],
    "tuna aside": [{"kind": "inside", "objects": [RED], "reference": BOWL}, {"objects": [TUNA], "at": (0.38, -0.15)}],
    "nudge": [{"objects": [MILK], "by": 0.03}, {"objects": [RAISINS], "by": 0.03}],
}

STARTS = {"unpack": {TUNA: (0.6, 0.12, 0.022), RED: (0.6, 0.12, 0.06)}}
"""Where things start in a task, if elsewhere: the red block on the tuna, which is in the box."""


def goal(asked: Json) -> Json:
    """A goal as an instance has it: a relation, another object's place, or a small way to the side."""
    count = len(asked["objects"])
    plain: Json = {"objects": asked["objects"], "replace": False, "rotations": False, "symmetries": [0.0] * count}
    if "kind" in asked:
        relation = {key: asked[key] for key in ("kind", "reference", "distance") if key in asked}
        return plain | {"matches": [[]] * count, "targets": [], "metric": "relation", "relation": relation}
    x, y, z = THINGS[asked.get("place", asked["objects"][0])][1]
    x, y = asked.get("at", (x + asked.get("by", 0.0), y))
    target = ((x, y, z), (0.0, 0.0, 0.0, 1.0))
    return plain | {"matches": [[1]], "targets": [target], "metric": "pose"}


@cache
def tell(name: str) -> TaskInWords:
    """One of the tasks, solved and told."""
    asked, starts, turn = TASKS[name], STARTS.get(name, {}), (0.0, 0.0, 0.0, 1.0)
    objects: list[Json] = [
        {"id": number, "asset": asset, "pose": (starts.get(number, position), turn), "category": category}
        for number, (asset, position, category) in THINGS.items()
    ]
    plain: dict[str, Any] = {"task": "T", "seed": 0, "max_steps": 8, "timestep": 0.004, "sixdof": False}
    goals = [goal(item) | {"max_reward": 1 / len(asked)} for item in asked]
    instance, library = TaskInstance.model_validate({**plain, "objects": objects, "goals": goals}), Library()
    done = rollout(instance, library)
    assert done.episode.outcome == "success", done.episode.detail
    return describe_task_in_words(instance, done, library)


HONEST = [
    ("unpack", "Take the red block and the tuna out of the brown box and put them on the green zone."),
    ("unpack", "Take the tuna and the red block out of the open box and put them on the green zone."),
    ("pack", "Put the corn and the tuna into the open box."),
    ("pack", "Pack both cans into the brown box."),
    ("pack", "Pick up the can of corn and the can of tuna and put everything into the cardboard box."),
    ("pack", "Place the two cans inside the box and leave the milk carton where it is."),
    ("pack", "Move all the cans into the container."),
    ("stack", "Stack the corn can and the tuna can on the green zone, in this order from the bottom to the top."),
    ("stack", "Put the corn can on the green mat, then put the tuna on top of it."),
    ("tidy", "Put the red block into the bowl and the raisins onto the green zone."),
    ("tidy", "Move the red cube into the white bowl. Then put the raisins box on the green square."),
    ("tidy", "First pick up the red cube and place it in the bowl; then put the raisins onto the green zone."),
    ("tidy", "Put the red cube into the bowl and the box of raisins onto the green zone."),
    ("tidy", "Put the red cube into the bowl and the raisin box onto the green zone."),
    ("stack", "First put the corn can on the green mat, then stack the tuna on the corn."),
    ("beside", "Place the tuna next to the milk."),
    ("beside", "Bring the can of tuna close to the milk carton."),
    ("aside", "Put the tuna left of the milk."),
    ("aside", "Seen from the robot, put the tuna left of the milk."),
    ("in line", "Put the tuna to the left of the corn."),
    ("row", "Put the red block and the blue block side by side on the table."),
    ("row", "Put the red and the blue block next to each other in a row."),
    ("row", "Line up the red block and the blue block from right to left, as the robot sees it."),
    ("wide row", "Put the raisins and the milk side by side on the table."),
    ("together", "Put the red and blue blocks into the brown box."),
    ("stack", "Put the corn can on the green zone and the tuna on the corn, and leave the milk alone."),
    ("swap", "Let the red block and the blue block exchange their places."),
    ("swap", "Swap the red and the blue block."),
    ("row on zone", "Line up the red block and the blue block on the green zone."),
    ("row, then zone", "Line up the red block and the blue block on the green zone."),
    ("two cans", "Put the red block on a can and the blue block on a can."),
]
WRONG = [
    ("aside", "Put the tuna right of the milk."),
    ("aside", "Put the tuna behind the milk."),
    ("askew", "Put the tuna left of the milk."),
    ("in line", "Put the tuna left of the milk."),
    ("amiss", "Put the tuna between the milk and the corn."),
    ("pack", "Put the corn, the tuna and the milk into the open box."),
    ("pack", "Put the corn into the open box."),
    ("pack", "Put the corn and the tuna into the bowl."),
    ("pack", "Put the corn and the tuna onto the green zone."),
    ("pack", "Put the corn and the tuna next to the open box."),
    ("pack", "Put the three cans into the open box."),
    ("pack", "Put the corn and the raisins into the open box."),
    ("pack", "Put the corn into the open box and leave the tuna where it is."),
    ("pack", "Put everything into the open box."),
    ("pack", "Put the yellow can and the purple can into the open box."),
    ("pack", "Put the tomato soup and the tuna into the open box."),
    ("pack", "Put the corn and the tuna into the red box."),
    ("pack", "Put the corn and the tuna into the open box and close it."),
    ("pack", "Open the corn and pour it into the box, then put the tuna into the box."),
    ("pack", "Stack the corn and the tuna."),
    ("pack", "Put the corn and the tuna into the open box, except the corn."),
    ("pack", "Lege den Mais und den Thunfisch in die offene Kiste."),
    ("pack", "Mets le thon et le maïs dans la boîte."),
    ("stack", "Stack the tuna can and the corn can on the green zone, in this order from the bottom to the top."),
    ("stack", "Put the corn can and the tuna can into the open box."),
    ("stack", "Stack the cans on the green zone, from the smallest to the largest from the bottom up."),
    ("stack", "Stack the corn can, the tuna can and the milk on the green zone."),
    ("stack", "Stack the corn can and the tuna can on the blue zone."),
    ("stack", "Put the tuna can beside the corn can on the green zone."),
    ("tidy", "Put the blue block into the bowl and the raisins onto the green zone."),
    ("tidy", "Put the raisins into the bowl and the red block onto the green zone."),
    ("tidy", "Put the red block into the bowl."),
    ("tidy", "Put the raisins box on the green square. Then move the red cube into the white bowl."),
    ("tidy", "Put the red block into the bowl after the raisins were put onto the green zone."),
    ("tidy", "Put the block into the bowl and the raisins onto the green zone."),
    ("pack", "First put the corn, then the tuna into the open box."),
    ("pack", "Put the corn and the tuna into the open box in this order."),
    ("tidy", "Put the block into the bowl and the raisins onto the green zone, but leave the block where it is."),
    ("tidy", "Put all the blocks into the bowl and the raisins onto the green zone."),
    ("tidy", "Put the red block into the bowl and the raisins to the right of the milk."),
    ("beside", "Place the tuna next to the corn."),
    ("beside", "Place the tuna on the milk."),
    ("beside", "Place the milk next to the tuna."),
    ("beside", "Place the tuna next to the milk, then sing."),
    ("swap", "Let the red block and the tuna exchange their places."),
    ("swap", "Put the red block on the blue block."),
    ("swap", "Put the red block where it belongs."),
    ("row", "Put the blocks on the left side of the table."),
    ("aside", "Put the tuna to the left of all the other things."),
    ("aside", "Put the tuna to the left of the cans."),
    ("together", "Put the red block into the brown box and the blue block into the other box."),
    ("together", "Put the red block into a box and the blue block into another box."),
    ("together", "Put the blocks into the containers."),
    ("tidy", "Put the red block into the bowl and one raisin onto the green zone."),
    ("tidy", "Put the red block into the bowl and two raisins onto the green zone."),
    ("tidy", "Put the red blocks into the bowl and the raisins onto the green zone."),
    ("tidy", "Put the red block into the bowl and the raisins onto the green zone first."),
    ("tidy", "Put the red block into the bowl and lay the raisins flat on the green zone."),
    ("pack", "Stack everything: put the corn and the tuna into the open box."),
    ("pack", "Line the things up: put the corn and the tuna into the open box."),
    ("pack", "Put the things next to each other: put the corn and the tuna into the open box."),
    ("pack", "Put the corn and the tuna first on the table, then into the open box."),
    ("pack", "Put the corn and the tuna into the open box and back on the table."),
    ("beside", "Put the tuna on the table, and finally next to the milk."),
    ("together", "Put the red block and the blue block next to each other into the brown box."),
    ("together", "Put the red block and the blue block into the brown box in a row."),
    ("together", "Put the red block and the blue block into the two boxes."),
    ("together", "Distribute the red block and the blue block, one on each zone."),
    ("together", "Put all the blocks but the red one into the brown box."),
    ("together", "Put no block into the brown box and the blocks into the brown box."),
    ("together", "Put the blocks into the brown box without touching each other."),
    ("stack", "Put the corn and the tuna on the green zone."),
    ("far row", "Gather the blocks on the table."),
    ("together", "Put 100% of the blocks into the brown box."),
    ("together", "Put the blocks into the brown box alone."),
    ("together", "Put the blocks into the brown box and keep the tuna in the bowl."),
    ("together", "Sort the blocks into the brown box by color, each color by itself."),
    ("together", "Put the blocks into the brown box by kind."),
    ("marked row", "Put the red block and the blue block side by side on the green zone."),
    ("marked row", "Line up the red block and the blue block on the green zone."),
    ("marked row", "Put the red block and the blue block left of the milk."),
    ("far row", "Put the red block and the blue block next to each other."),
    ("far row", "Put the blocks together."),
    ("row", "Line up the red block and the blue block from left to right."),
    ("row", "Tidy the blocks."),
    ("row", "Stack the blocks."),
    ("on one side", "Place the red block and the blue block around the milk."),
    ("around", "Place the red block around the milk and the blue block around the milk."),
    ("near by far", "Place the tuna next to the milk."),
    ("tidy", "Put the red block into the bowl and lay the raisins onto the green zone."),
    ("nudge", "Stack the milk carton on the raisins and put the tuna into the bowl."),
    ("nudge", "Fold the towel, pour the milk and sing."),
    ("nudge", "Move the milk and the raisins."),
    ("nudge", "Clear the table."),
    ("nudge", "Tidy up."),
]


UNREAD = [
    ("amid", "Put the tuna between the milk and the corn."),
    ("row", "Put the blocks together."),
    ("together", "Put the red block and the blue block together into the brown box."),
    ("around", "Place the red block and the blue block around the milk."),
    ("together", "Put the red block, the blue block and the suction cup into the open box."),
    ("together", "Use the robot arm to put the red and blue blocks into the open box."),
    ("pack", "Put the two tallest things into the open box."),
    ("pack", "Put all of the food into the open box."),
    ("far row", "Put the red block away from the blue block."),
    ("row", "Slide the red and the blue block together."),
    ("nudge", "Clear the table."),
    ("aside", "Remove the tuna from the table."),
    ("pack", "Put the red tin and the yellow tin into the open box."),
    ("unpack", "Move the tuna in the open box onto the green zone and the red block on the tuna onto the green zone."),
    ("tidy", "Put the red block on the table into the bowl and the raisins behind the milk onto the green zone."),
    ("two cans", "Put the red block and the blue block on a can."),
    ("tuna aside", "Move the red block into the bowl and the tuna."),
    ("tuna aside", "Sort the red block and the tuna by colour."),
    ("far row", "Line up the red block and the blue block."),
]
"""Words outside the grammar, true or not."""


@pytest.mark.parametrize(("task", "words"), UNREAD)
def test_words_that_the_rules_do_not_understand_are_not_judged(task: str, words: str) -> None:
    assert judge(words, tell(task))[0] == "unclear", judge(words, tell(task))


@pytest.mark.parametrize(("task", "words"), HONEST)
def test_words_that_say_what_happens_are_agreed_with(task: str, words: str) -> None:
    assert judge(words, tell(task))[0] == "agrees", judge(words, tell(task))


@pytest.mark.parametrize(("task", "words"), WRONG)
def test_words_that_say_something_else_are_not(task: str, words: str) -> None:
    assert judge(words, tell(task))[0] != "agrees"


def test_colors_that_a_camera_saw_differ_from_no_words() -> None:
    """A proxy is called by its colour in the photo, which people may see as another one."""
    told = tell("tidy")
    seen = [row | {"label": "red_block_1"} if row["id"] == RED else row for row in told.objects if row["id"] != BLUE]
    words = "Put the orange block into the bowl and the raisins onto the green zone."
    assert judge(words, replace(told, objects=tuple(seen)))[0] == "unclear"
    assert judge(words, replace(told, objects=tuple(row for row in told.objects if row["id"] != BLUE)))[0] == "differs"


SAID = [
    ("tidy", "goal 1: put the red block into the bowl", True),
    ("tidy", "goal 1: red cube into the bowl", True),
    ("tidy", "goals 1 and 2: tidy the block and the raisins up", True),
    ("tidy", "goal 2: the raisins", True),
    ("tidy", "name: tidy-block-and-raisins", True),
    ("tidy", "name: pack-raisins-and-cube-in-bowl-and-zone", True),
    ("swap", "name: swap-blocks", True),
    ("stack", "goal 2: stack the tuna can on the zone", True),
    ("tidy", "goal 1: put the red block onto the green zone", False),
    ("tidy", "goal 1: put the blue block into the bowl", False),
    ("tidy", "goal 1: leave the red block where it is", False),
    ("tidy", "goal 1: put the raisins onto the green zone", False),
    ("tidy", "goals 1 and 2: swap the red block and the raisins", False),
    ("tidy", "goal 2: pour the raisins onto the green zone", False),
    ("tidy", "goal 2: push the raisins onto the green zone", True),
    ("tidy", "goal 2: put the raisins where the squirrels like them", True),
    ("tidy", "goal 2: put the milk where the squirrels like it", True),
    ("tidy", "goal 2: put the milk onto the green zone", False),
    ("tidy", "name: pour-the-milk", False),
    ("tidy", "name: pack-tuna-and-corn", True),
    ("pack", "name: swap-corn-and-tuna", False),
    ("pack", "name: stack-corn-on-milk", False),
]


@pytest.mark.parametrize(("task", "said", "agrees"), SAID)
def test_further_words_may_say_less_and_nothing_else(task: str, said: str, agrees: bool) -> None:
    words = next(words for name, words in HONEST if name == task)
    verdict, reason = judge(words, tell(task), [said])
    assert (verdict == "agrees") == agrees, reason
