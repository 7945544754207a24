from pathlib import Path

import pytest

from grs_agents.agents.examples import Example, read_examples, select_nearest_examples
from grs_agents.agents.types import TaskDefinition
from grs_agents.base.content import content_root
from grs_agents.base.errors import InputError

FOLDER = content_root() / "prompts" / "examples"
TASKS = {
    "stack_cans": ("stack-the-cans", "Stack the cans of corn, peaches and tuna.", ("HOPE/Corn.urdf", "HOPE/Tuna.urdf")),
    "sort_blocks_into_zones": (
        "sort-by-color",
        "Sort the red and blue blocks into the zones of their colors.",
        ("zone/zone-template.urdf",),
    ),
    "pack_into_container": (
        "pack-groceries",
        "Put groceries in the open box.",
        ("HOPE/Butter.urdf", "container/container-template.urdf"),
    ),
    "towers_of_hanoi": ("hanoi", "Move the tower of disks to the other peg.", ("hanoi/stand.urdf",)),
}


def task(name: str, description: str, assets: tuple[str, ...]) -> TaskDefinition:
    return TaskDefinition.model_validate({"name": name, "description": description, "assets": assets})


def example(name: str, family: str, words: str) -> Example:
    return Example(name=name, family=family, shows="", source=f'"""{words}"""')


@pytest.mark.parametrize("name", TASKS)
def test_the_nearest_example_is_the_one_that_shows_how(name: str) -> None:
    chosen = select_nearest_examples(read_examples(FOLDER), task(*TASKS[name]), count=3, seed=0)
    assert chosen[0].name == name
    assert len({item.name for item in chosen}) == 3


def test_endings_capitals_and_spelling_do_not_matter() -> None:
    examples = [example("a", "A", "clearing zones"), example("b", "B", "StackedColours"), example("c", "C", "rope")]
    assert select_nearest_examples(examples, task("x", "stack by color", ("y",)), 1, seed=2)[0].name == "b"


def test_no_family_fills_the_prompt() -> None:
    examples = [example(f"s{index}", "Stacking", "stack blocks") for index in range(3)]
    chosen = select_nearest_examples(
        [*examples, example("p", "Packing", "pack")], task("stack", "stack blocks", ("z",)), 3, seed=0
    )
    assert [item.family for item in chosen] == ["Stacking", "Stacking", "Packing"]


def test_equals_are_taken_by_the_seed_and_the_choice_is_repeatable() -> None:
    examples = [example(str(index), str(index), "same words") for index in range(4)]
    wanted = task("other", "nothing in common", ("z",))
    chosen = {seed: [item.name for item in select_nearest_examples(examples, wanted, 2, seed)] for seed in (0, 3, 7)}
    assert chosen == {0: ["0", "1"], 3: ["3", "0"], 7: ["3", "0"]}


@pytest.mark.parametrize(
    ("source", "complaint"),
    [("def", "Python"), (None, "no example")],
)
def test_a_faulty_folder_is_named(tmp_path: Path, source: str | None, complaint: str) -> None:
    if source is not None:
        (tmp_path / "one.py").write_text(source, "utf-8")
    with pytest.raises(InputError, match=complaint):
        read_examples(tmp_path)
