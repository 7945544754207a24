"""The sentence of a task: true and complete, made of goals and poses, never of the program's own words."""

import math
from typing import Any

import pytest

from grs_agents.library.library import Library
from grs_agents.sim import TaskInstance
from grs_agents.sim.wording.sentence import describe_task, paraphrase_task

Json = dict[str, Any]
FLAT = (0.0, 0.0, 0.0, 1.0)
TUNA, SAUCE, COOKIES, RED, BLUE, TALL, SHORT, BOX, BOWL, ZONE = range(1, 11)
OBJECTS: list[Json] = [
    {"id": TUNA, "asset": "HOPE/Tuna.urdf", "pose": ((0.6, -0.24, 0.017), FLAT)},
    {"id": SAUCE, "asset": "HOPE/TomatoSauce.urdf", "pose": ((0.34, 0.18, 0.041), FLAT)},
    {"id": COOKIES, "asset": "HOPE/Cookies.urdf", "pose": ((0.34, -0.09, 0.083), FLAT)},
    {"id": RED, "asset": "block/red_block.urdf", "pose": ((0.66, -0.34, 0.02), FLAT)},
    {"id": BLUE, "asset": "block/blue_block.urdf", "pose": ((0.57, -0.34, 0.02), FLAT)},
    {"id": TALL, "asset": "HOPE/Milk.urdf", "pose": ((0.34, -0.4, 0.095), FLAT)},
    {"id": SHORT, "asset": "HOPE/Milk.urdf", "pose": ((0.34, 0.4, 0.095), FLAT)},
    {"id": BOX, "asset": "container/open_box.urdf", "pose": ((0.58, 0.23, 0.045), FLAT), "category": "fixed"},
    {"id": BOWL, "asset": "bowl/bowl.urdf", "pose": ((0.61, -0.06, 0.03), FLAT), "category": "fixed"},
    {"id": ZONE, "asset": "zone/zone.urdf", "pose": ((0.47, -0.2, 0.001), FLAT), "category": "fixed", "added": True},
]


def related(kind: str, objects: list[int], reference: int | None = None, distance: float | None = None) -> Json:
    relation = {"kind": kind, "reference": reference, "distance": distance}
    return {
        "objects": objects,
        "matches": [[]] * len(objects),
        "targets": [],
        "metric": "relation",
        "relation": relation,
    }


def placed(number: int, *spots: tuple[float, ...], symmetry: float = 0.0) -> Json:
    """A pose goal; a spot is x, y, z and perhaps a yaw in degrees."""
    targets = [
        (spot[:3], (0.0, 0.0, math.sin(math.radians(spot[3]) / 2), math.cos(math.radians(spot[3]) / 2)))
        if len(spot) > 3
        else (spot, FLAT)
        for spot in spots
    ]
    turned = {"rotations": symmetry > 0, "symmetries": [symmetry]}
    return {"objects": [number], "matches": [[1] * len(spots)], "targets": targets, "metric": "pose", **turned}


def task_of(*goals: Json, **changes: Any) -> TaskInstance:
    usual = {"replace": False, "rotations": False, "max_reward": 1 / len(goals), "language": "a plain lie"}
    filled = [{**usual, "symmetries": [0.0] * len(goal["objects"]), **goal} for goal in goals]
    plain = {"task": "Lie", "seed": 0, "max_steps": 8, "timestep": 0.004}
    return TaskInstance.model_validate({**plain, "objects": OBJECTS, "goals": filled, **changes})


def tell(*goals: Json, **changes: Any) -> str:
    """The sentence of a task without a measured end."""
    return describe_task(task_of(*goals, **changes), Library()).specific


@pytest.mark.parametrize(
    ("goals", "sentence"),
    [
        (
            [related("in_zone", [TUNA, SAUCE], ZONE), related("inside", [RED], BOWL)],
            "Put the tuna can and the tomato sauce can on the green zone, and the red block in the bowl; nothing else "
            "moves. The green zone is not in the photo.",
        ),
        ([related("inside", [TALL, SHORT], BOX)], "Put both milk cartons in the open box; nothing else moves."),
        (
            [related("inside", [TALL], BOX)],
            "Put the right milk carton in the open box; nothing else moves. Sides are as the robot sees them.",
        ),
        (
            [related("stacked", [TUNA, BLUE, RED])],
            "Stack the blue block on the tuna can and the red block on the blue block; nothing else moves.",
        ),
        (
            [related("in_zone", [TUNA], ZONE), related("stacked", [TUNA, BLUE])],
            "Put the tuna can on the green zone, then stack the blue block on the tuna can; nothing else moves. The "
            "green zone is not in the photo.",
        ),
        (
            [related("near", [RED], TUNA, 0.04)],
            "Put the red block beside the tuna can, at most 4 cm from it; nothing else moves.",
        ),
        (
            [related("aligned", [TUNA, SAUCE, RED], None, 0.1)],
            "Line up the tuna can, the tomato sauce can and the red block in any order, 10 cm from centre to centre; "
            "nothing else moves.",
        ),
        (
            [placed(RED, (0.66, -0.34, 0.02), (0.66, -0.44, 0.02))],
            "Put the red block where it stood or 10 cm to the right from where it stood; nothing else moves. Sides are "
            "as the robot sees them.",
        ),
        (
            [placed(RED, (0.66, -0.44, 0.02))],
            "Move the red block 10 cm to the right; nothing else moves. Sides are as the robot sees them.",
        ),
        (
            [placed(COOKIES, (0.34, -0.09, 0.083, 43), symmetry=math.pi)],
            "Turn the cookie box by 43 degrees counterclockwise on the spot; nothing else moves.",
        ),
        (  # turns that nobody sees
            [
                placed(TUNA, (0.58, 0.23, 0.03, 80), symmetry=math.tau),
                placed(RED, (0.61, -0.06, 0.03, 88), symmetry=math.tau),
            ],
            "Put the tuna can in the middle of the open box, and the red block in the middle of the bowl; nothing else "
            "moves.",
        ),
        (
            [placed(RED, (0.61, 0.05, 0.02))],
            "Put the red block to the left of the bowl, 11 cm from centre to centre; nothing else moves. Sides are as "
            "the robot sees them.",
        ),
        (
            [placed(RED, (0.57, -0.34, 0.02)), placed(BLUE, (0.66, -0.34, 0.02))],
            "Put the red block where the blue block stood, and the blue block where the red block stood; nothing else "
            "moves.",
        ),
        (
            [placed(RED, (0.61, -0.06, 0.03), (0.47, -0.2, 0.022))],
            "Put the red block in the bowl or on the green zone; nothing else moves. The green zone is not in the "
            "photo.",
        ),
        (
            [placed(TUNA, (0.27, 0.1, 0.017)), placed(RED, (0.27, -0.04, 0.02)), placed(BLUE, (0.27, -0.18, 0.02))],
            "Line up the tuna can, the red block and the blue block from left to right, 14 cm from centre to centre, "
            "on the bare table (beginning with the tuna can 34 cm to the left and 33 cm towards the robot from where "
            "it stood); nothing else moves. Sides are as the robot sees them.",
        ),
        (
            [related("inside", [TUNA], BOX), placed(TUNA, (0.6, -0.24, 0.017))],
            "Put the tuna can in the open box, then put the tuna can back where it stood; nothing else moves.",
        ),
        (  # a stack at the place of what is moved away
            [
                placed(BLUE, (0.46, 0.1, 0.02)),
                placed(TUNA, (0.57, -0.34, 0.017)),
                placed(RED, (0.57, -0.34, 0.054)),
            ],
            "Put the tuna can where the blue block stood, and move the blue block 44 cm to the left and 11 cm towards "
            "the robot, then stack the red block on the tuna can; nothing else moves. Sides are as the robot sees "
            "them.",
        ),
        (  # a row whose objects are turned stays a row
            [
                placed(RED, (0.48, -0.26, 0.022, 14), symmetry=math.pi),
                placed(COOKIES, (0.46, -0.16, 0.085, 14), symmetry=math.pi),
            ],
            "Line up the cookie box (turned by 14 degrees counterclockwise) and the red block (turned by 14 degrees "
            "counterclockwise) from left to right, 10 cm from centre to centre, on the green zone; nothing else moves. "
            "The green zone is not in the photo. Sides are as the robot sees them.",
        ),
        (  # lengths and turns count from the start, not from the bowl
            [related("inside", [RED], BOWL), placed(RED, (0.46, -0.45, 0.02))],
            "Put the red block in the bowl, then put the red block 11 cm to the right and 20 cm towards the robot from "
            "where it stood; nothing else moves. Sides are as the robot sees them.",
        ),
        (
            [related("inside", [COOKIES], BOX), placed(COOKIES, (0.34, -0.09, 0.083, 43), symmetry=math.pi)],
            "Put the cookie box in the open box, then put the cookie box (turned by 43 degrees counterclockwise from "
            "how it stood) back where it stood; nothing else moves.",
        ),
    ],
)
def test_a_sentence_states_what_the_goals_ask_for(goals: list[Json], sentence: str) -> None:
    assert tell(*goals) == sentence


def test_a_block_turns_at_most_by_half_a_quarter_however_its_outline_is_sampled() -> None:
    """Rounding gives the settled block an outline of five corners, two of which coincide."""
    settled = (
        (0.6612200206605988, -0.3434855535832362, 0.019953621014744793),
        (-1.93593109024108e-07, 1.0402897397165078e-09, 0.013089595571346707, 0.9999143275739882),
    )
    objects = [{**item, "pose": settled} if item["id"] == RED else item for item in OBJECTS]
    goal = placed(RED, (0.47, -0.2, 0.022, 71.5), symmetry=math.pi)
    assert "(turned by 20 degrees clockwise)" in tell(goal, objects=objects)


def test_what_moves_without_a_goal_is_stated() -> None:
    """The measured end counts: the spoon that a tray carries along moves, too."""
    goal = {**related("inside", [RED], BOWL), "replace": False, "rotations": False, "symmetries": [0.0]}
    plain = {"task": "T", "seed": 0, "max_steps": 8, "timestep": 0.004, "objects": OBJECTS}
    instance = TaskInstance.model_validate({**plain, "goals": [{**goal, "max_reward": 1.0}]})
    initial = {item.id: item.pose for item in instance.objects}
    final = {**initial, RED: ((0.61, -0.06, 0.03), FLAT), BLUE: ((0.5, -0.34, 0.02), FLAT)}
    told = describe_task(instance, Library(), initial, final)
    assert told.specific == "Put the red block in the bowl; the blue block moves, too; nothing else does."
    assert told.vague == "Put a block in the bowl."


def test_vague_words_put_things_on_a_mark_even_in_its_middle() -> None:
    goal = {**placed(RED, (0.47, -0.2, 0.022)), "replace": False, "max_reward": 1.0, "language": ""}
    plain = {"task": "T", "seed": 0, "max_steps": 8, "timestep": 0.004, "objects": OBJECTS}
    told = describe_task(TaskInstance.model_validate({**plain, "goals": [goal]}), Library())
    assert told.specific.startswith("Put the red block in the middle of the green zone;")
    assert told.vague == "Put a block on the zone."


def test_a_robot_that_pushes_is_said_to_push() -> None:
    assert tell(related("in_zone", [RED, BLUE], ZONE), primitive="push").startswith(
        "Push the red block and the blue block on the green zone; nothing else moves."
    )


def test_an_instruction_replaces_the_programs_words_and_is_left_out_where_there_is_none() -> None:
    goal = {**related("inside", [RED], BOWL), "replace": False, "rotations": False, "symmetries": [0.0]}
    plain = {"task": "T", "seed": 0, "max_steps": 8, "timestep": 0.004, "objects": OBJECTS[:-1]}
    instance = TaskInstance.model_validate({**plain, "goals": [{**goal, "max_reward": 1.0, "language": "a lie"}]})
    assert instance.language == "a lie" and "instruction" not in instance.model_dump(mode="json")
    assert not {"name", "added"} & instance.model_dump(mode="json")["objects"][0].keys()
    assert instance.model_copy(update={"instruction": "Put it there."}).language == "Put it there."


def test_paraphrases_change_verbs_and_joints_alone() -> None:
    goals = (related("inside", [RED], BOX), related("stacked", [BOX, TUNA]))
    assert tell(*goals).startswith("Put the red block in the ")
    texts = paraphrase_task(task_of(*goals), Library())
    assert len({*texts, tell(*goals)}) == 4
    for text, verb in zip(texts, ("Place", "Set", "Please put"), strict=True):
        assert text.startswith(f"{verb} the red block in the ") and "tuna can" in text
        assert "nothing else moves" not in text
    (pushed, *_) = paraphrase_task(task_of(related("inside", [RED], ZONE), primitive="push"), Library())
    assert pushed.startswith("Slide the red block")
