"""Edits of a scene: their file, which may be a stranger's, and their places in the photo."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grs_agents.base.errors import InputError
from grs_agents.perception.edits import (
    MOST_EDITS,
    Add,
    ChooseTable,
    Edit,
    Move,
    Rectangle,
    Rename,
    SceneEdits,
    SetMass,
    describe_edit,
    edits_as_text,
    inner_pixel,
    mask_from_runs,
    read_edits,
    write_edits,
)

PLACE = (3, 4)


def test_the_file_holds_an_edit_a_line_and_is_read_as_it_was_written(tmp_path: Path) -> None:
    edits: tuple[Edit, ...] = (
        Add(rectangle=Rectangle(left=1, top=2, right=9, bottom=8)),
        Rename(place=PLACE, name="sugar  bowl"),
        Move(place=PLACE, position=(0.5, -0.125), yaw=0.5),
    )
    file = tmp_path / "edits.json"
    write_edits(SceneEdits(edits=edits), file)
    assert read_edits(file).edits == edits
    lines = file.read_text().splitlines()
    assert len(lines) == 2 + len(edits)
    assert [line[9:12] for line in lines[1:-1]] == ["add", "ren", "mov"]
    assert describe_edit(read_edits(file).edits[1]) == "the object at 3, 4 is called sugar bowl"


@pytest.mark.parametrize(
    ("edit", "problem"),
    [
        ({"act": "explode", "place": [1, 1]}, "explode"),
        ({"act": "delete", "place": [1, -1]}, "greater than or equal to 0"),
        ({"act": "delete", "place": [1, 1e9]}, "integer"),
        ({"act": "delete", "place": [1, 1], "file": "/etc/passwd"}, "file"),
        ({"act": "rename", "place": [1, 1], "name": "x" * 81}, "80 characters"),
        ({"act": "rename", "place": [1, 1], "name": "a\u0007b"}, "control characters"),
        ({"act": "rename", "place": [1, 1], "name": "  "}, "must be words"),
        ({"act": "mass", "place": [1, 1], "mass": 1e6}, "less than or equal to 20"),
        ({"act": "mass", "place": [1, 1], "mass": float("nan")}, "NaN|finite|nan"),
        ({"act": "friction", "place": [1, 1], "friction": -1}, "greater than or equal to"),
        ({"act": "move", "place": [1, 1], "position": [0, 1e300]}, "less than or equal to 5"),
        ({"act": "shape", "place": [1, 1], "shape": "bowl", "size": [0.1, 0.1, 0]}, "greater than or equal to"),
        ({"act": "merge", "places": [[1, 1]]}, "at least 2"),
        ({"act": "add", "rectangle": {"left": 5, "top": 0, "right": 4, "bottom": 9}}, "left < right"),
        ({"act": "mark", "place": [1, 1], "kind": "ghost"}, "ghost|robot"),
        (
            {
                "act": "mask",
                "place": [1, 1],
                "kind": "half",
                "rectangle": {"left": 1, "top": 0, "right": 4, "bottom": 9},
            },
            "include",
        ),
    ],
)
def test_an_edit_that_is_out_of_bounds_is_refused(edit: dict[str, Any], problem: str, tmp_path: Path) -> None:
    file = tmp_path / "edits.json"
    file.write_text(json.dumps({"version": 1, "edits": [edit]}))
    with pytest.raises(InputError) as refused:
        read_edits(file)
    assert any(part in str(refused.value) for part in problem.split("|"))
    assert str(file) in str(refused.value)


def test_a_file_with_too_many_edits_or_of_another_kind_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "edits.json"
    line = '{"act": "delete", "place": [1, 1]}'
    file.write_text(f'{{"version": 1, "edits": [{",".join([line] * (MOST_EDITS + 1))}]}}')
    with pytest.raises(InputError, match=str(MOST_EDITS)):
        read_edits(file)
    file.write_text("[" * 10_000)
    with pytest.raises(InputError):
        read_edits(file)
    with pytest.raises(InputError, match="folder"):
        read_edits(tmp_path)


def test_the_table_is_chosen_before_objects_are_moved() -> None:
    move, table = Move(place=PLACE, position=(0.5, 0.0)), ChooseTable(point=(9, 9))
    assert SceneEdits(edits=(SetMass(place=PLACE, mass=1.0), table, move)).table == table
    with pytest.raises(ValueError, match="before objects or the robot are moved"):
        SceneEdits(edits=(move, table))


def test_runs_give_the_mask_of_a_rectangle() -> None:
    rectangle = Rectangle(left=1, top=1, right=4, bottom=3)
    mask = mask_from_runs(rectangle, (1, 2, 3), (4, 5))
    assert np.argwhere(mask).tolist() == [[1, 2], [1, 3]]
    with pytest.raises(InputError, match="5 pixels in a rectangle of 6"):
        mask_from_runs(rectangle, (1, 4), (4, 5))


def test_the_place_of_an_object_is_a_pixel_well_inside_its_mask() -> None:
    mask = np.zeros((20, 30), np.bool_)
    mask[4:15, 3] = True  # thin
    mask[5:12, 10:17] = True
    assert inner_pixel(mask) == (13, 8)


def test_the_text_of_no_edits_is_read_as_none(tmp_path: Path) -> None:
    (tmp_path / "edits.json").write_text(edits_as_text(SceneEdits()))
    assert read_edits(tmp_path / "edits.json").edits == ()
