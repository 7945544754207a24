"""Around a valid instance: whatever is changed, it is a valid instance again or an error that names what is wrong."""

import copy
import json
import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.base.errors import InputError
from grs_agents.sim import InstanceError, TaskInstance, parse_instance_json
from grs_agents.sim.instance.task_instance import MAX_BYTES

POSE = [[0.5, 0.0, 0.02], [0.0, 0.0, 0.0, 1.0]]
VALID: dict[str, Any] = {
    "version": 4,
    "task": "Packing",
    "seed": 3,
    "max_steps": 4,
    "timestep": 0.004,
    "objects": [
        {"id": 1, "asset": "block/red_block.urdf", "pose": POSE, "color": [1.0, 0.0, 0.0, 1.0]},
        {
            "id": 2,
            "asset": "box/box-template.urdf",
            "fill": {"DIM": [0.1, 0.1, 0.1]},
            "pose": POSE,
            "category": "fixed",
        },
    ],
    "ties": [{"kind": "point", "parent": 1, "child": 2, "parent_frame": POSE, "child_frame": POSE}],
    "goals": [
        {
            "objects": [1],
            "matches": [[1]],
            "targets": [POSE],
            "replace": False,
            "rotations": True,
            "metric": "pose",
            "max_reward": 0.5,
            "symmetries": [0.0],
            "language": "put it there",
        },
        {
            "objects": [1],
            "matches": [[]],
            "targets": [],
            "replace": False,
            "rotations": True,
            "metric": "relation",
            "max_reward": 0.5,
            "symmetries": [0.0],
            "relation": {"kind": "on", "reference": 2},
        },
    ],
    "warnings": ["a word"],
}
_ODD = (
    st.none()
    | st.booleans()
    | st.text(max_size=5)
    | st.integers(-(10**400), 10**400)
    | st.integers(-5, 300)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.just([])
    | st.just({})
    | st.just([[0.5, 0, 0], [0, 0, 0, 2]])
    | st.lists(st.integers(-3, 3), max_size=4)
    | st.dictionaries(st.text(max_size=3), st.integers(), max_size=2)
)


def places(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all entries in a tree of JSON."""
    inner = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    return [(*path, key) for key, _ in inner] + [one for key, item in inner for one in places(item, (*path, key))]


def text_of(tree: object) -> str:
    return json.dumps(tree)


def read(text: str) -> TaskInstance | None:
    """The instance, or None with a named error; anything else escapes."""
    try:
        return parse_instance_json(text)
    except InstanceError as error:
        assert isinstance(error, InputError)
        assert error.message and error.remedy and len(error.message) < 1100
        return None


def test_the_valid_one_is_read() -> None:
    instance = parse_instance_json(text_of(VALID))
    assert parse_instance_json(instance.model_dump_json()) == instance
    assert parse_instance_json(text_of(VALID).encode()) == instance


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_a_changed_value_is_refused_by_name_or_is_in_range(data: st.DataObject) -> None:
    tree = copy.deepcopy(VALID)
    for _ in range(data.draw(st.integers(1, 2))):
        *way, last = data.draw(st.sampled_from(places(tree)))
        node: Any = tree
        for step in way:
            node = node[step]
        change = data.draw(st.sampled_from(["replace", "delete", "add", "repeat"]))
        if change == "replace":
            node[last] = copy.deepcopy(data.draw(_ODD))
        elif change == "delete":
            del node[last]
        elif change == "add" and isinstance(node, dict):
            node[data.draw(st.text(max_size=8))] = copy.deepcopy(data.draw(_ODD))
        elif isinstance(node, list):
            node.extend([node[last]] * data.draw(st.integers(1, 500)))
        if not places(tree):
            break
    instance = read(text_of(tree))
    if instance is not None:
        check_ranges(instance)


def check_ranges(instance: TaskInstance) -> None:
    """Nothing out of bounds got in."""
    assert 0 <= instance.seed < 2**32 and 1 <= instance.max_steps <= 200
    assert len(instance.objects) <= 200 and len(instance.goals) <= 200 and len(instance.ties) <= 400
    numbers = [number for item in instance.objects for number in (*item.pose[0], *item.pose[1], *(item.color or ()))]
    numbers += [number for goal in instance.goals for pose in goal.targets for number in (*pose[0], *pose[1])]
    assert all(math.isfinite(number) and abs(number) <= 2 for number in numbers)
    ids = {item.id for item in instance.objects}
    assert len(ids) == len(instance.objects) and all(set(goal.objects) <= ids for goal in instance.goals)
    assert TaskInstance.model_validate_json(instance.model_dump_json(), strict=True) == instance


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_a_changed_text_is_refused_by_name_or_valid(data: st.DataObject) -> None:
    text = text_of(VALID)
    at = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(at, min(len(text), at + 20)))
    put = data.draw(
        st.text(max_size=6) | st.sampled_from(["NaN", "Infinity", "-Infinity", "1e999", "-0", "9" * 5000, "["])
    )
    instance = read(text[:at] + put + text[end:])
    if instance is not None:
        check_ranges(instance)


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=100))
def test_any_bytes_are_refused_by_name(data: bytes) -> None:
    with pytest.raises(InstanceError):
        parse_instance_json(data)


REFUSED = {
    "not a number": ('"timestep": 0.004', '"timestep": NaN', "NaN"),
    "infinite": ('"timestep": 0.004', '"timestep": Infinity', "Infinity"),
    "infinite by size": (
        "0.5, 0.0, 0.02",
        "1e999, 0.0, 0.02",
        "object 1 (block/red_block.urdf): x is inf, must be a finite number (m)",
    ),
    "giant": ('"seed": 3', f'"seed": {"9" * 4000}', "must be less than 4294967296"),
    "beyond digits": ('"seed": 3', f'"seed": {"9" * 5000}', ""),
    "unknown key": ('"seed": 3', '"seed": 3, "gravity": 0', "gravity"),
    "unknown key within": (
        '"id": 1',
        '"id": 1, "mass": 0',
        "object 1 (block/red_block.urdf): mass = 0 kg, must be at least 0.001 kg",
    ),
    "key twice": ('"seed": 3', '"seed": 3, "seed": 4', "twice"),
    "text for a number": ('"max_steps": 4', '"max_steps": "4"', "max_steps is '4', must be a whole number"),
    "a number for a flag": ('"replace": false', '"replace": 0', "goal 1: replace is 0, must be a valid boolean"),
    "far away": (
        "0.5, 0.0, 0.02",
        "5.0, 0.0, 0.02",
        "object 1 (block/red_block.urdf): x = 5 m, must be at most 2 m; correct",
    ),
    "negative id": ('"id": 1', '"id": -1', "id = -1, must be at least 0"),
    "another version": ('"version": 4', '"version": 3', "version"),
    "nested": ('"a word"', "[" * 100_000, "64 levels"),
    "lone surrogate": ('"a word"', '"\\ud800"', ""),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_named(name: str) -> None:
    old, new, told = REFUSED[name]
    text = text_of(VALID)
    assert old in text
    with pytest.raises(InstanceError) as caught:
        parse_instance_json(text.replace(old, new, 1))
    assert told in str(caught.value)


def test_sizes_are_bounded_before_anything_is_parsed() -> None:
    with pytest.raises(InstanceError, match=f"{MAX_BYTES} are the most"):
        parse_instance_json(b"[" * (MAX_BYTES + 1))
    with pytest.raises(InstanceError, match="2, 1 are the most"):
        parse_instance_json(text_of(VALID), objects=1)
