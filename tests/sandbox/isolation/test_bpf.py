"""A tree of decisions and the program made of it answer alike."""

import struct
from bisect import bisect_right

from hypothesis import given
from hypothesis import strategies as st

from grs_agents.sandbox.isolation.seccomp import (
    NUMBER,
    Branch,
    FilterAction,
    Load,
    Node,
    assemble_instructions,
    branch_by_range,
    branch_if_any_bit,
    branch_if_at_least,
    branch_if_equal,
    branch_if_one_of,
    encode_instructions,
    find_operand_offsets,
    load_argument_high_half,
    load_argument_low_half,
)
from tests.sandbox import classic_bpf

words = st.integers(0, 2**32 - 1) | st.integers(0, 9)
answers = st.integers(0, 2**31).map(FilterAction)
tests = st.sampled_from([branch_if_equal, branch_if_at_least, branch_if_any_bit])


def wider(nodes: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
    branch = st.builds(lambda test, value, then, other: test(value, then, other), tests, words, nodes, nodes)
    return (
        branch
        | st.builds(load_argument_low_half, st.integers(0, 5), nodes)
        | st.builds(load_argument_high_half, st.integers(0, 5), nodes)
    )


trees = st.recursive(answers, wider, max_leaves=30).map(lambda node: Load(NUMBER, node))


def decide(node: Node, number: int, arguments: tuple[int, ...]) -> int:
    """Walk the tree itself."""
    word = 0
    while not isinstance(node, FilterAction):
        if isinstance(node, Load):
            place = node.offset
            index, upper = divmod(place - 16, 8)
            word = number if place == NUMBER else arguments[index] >> (32 if upper else 0) & 0xFFFF_FFFF
            node = node.then
        else:
            node = node.then if classic_bpf.COMPARISONS[node.comparison](word, node.value) else node.otherwise
    return node.action


@given(trees, words, st.tuples(*[st.integers(0, 2**64 - 1) | st.integers(0, 9)] * 6))
def test_the_program_answers_as_the_tree(tree: Node, number: int, arguments: tuple[int, ...]) -> None:
    assert classic_bpf.run(encode_instructions(assemble_instructions(tree)), number, 0, arguments) == decide(
        tree, number, arguments
    )


@given(st.lists(words, max_size=600, unique=True), words)
def test_one_of_many_values(values: list[int], word: int) -> None:
    program = encode_instructions(
        assemble_instructions(Load(NUMBER, branch_if_one_of(values, FilterAction(1), FilterAction(2))))
    )
    assert classic_bpf.run(program, word) == (1 if word in values else 2)
    assert all(classic_bpf.run(program, value) == 1 for value in values)


@given(st.lists(st.integers(1, 5000), min_size=1, max_size=400, unique=True), st.integers(0, 6000))
def test_ranges_of_any_length(borders: list[int], number: int) -> None:
    starts = [0, *sorted(borders)]
    program = assemble_instructions(
        Load(NUMBER, branch_by_range([(start, FilterAction(index)) for index, start in enumerate(starts)]))
    )
    assert classic_bpf.run(encode_instructions(program), number) == bisect_right(starts, number) - 1


def test_no_jump_is_too_far_for_its_byte() -> None:
    long: Node = FilterAction(1)
    for value in range(500):
        long = branch_if_equal(value + 10, FilterAction(2), long)
    program = assemble_instructions(Load(NUMBER, Branch(0x15, 5, long, FilterAction(3))))
    assert max(max(true, false) for _, true, false, _ in program) <= 255
    assert [classic_bpf.run(encode_instructions(program), number) for number in (5, 6)] == [1, 3]


def test_an_operand_is_replaced_wherever_it_stands() -> None:
    program = assemble_instructions(
        Load(NUMBER, branch_if_equal(7, FilterAction(1), branch_if_at_least(7, FilterAction(2), FilterAction(3))))
    )
    encoded = bytearray(encode_instructions(program))
    for place in find_operand_offsets(program, 7):
        struct.pack_into("=I", encoded, place, 9)
    assert [classic_bpf.run(bytes(encoded), number) for number in (7, 9, 10)] == [3, 1, 2]
