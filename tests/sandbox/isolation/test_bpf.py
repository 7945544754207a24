"""A tree of decisions and the program made of it answer alike."""

import struct
from bisect import bisect_right

from hypothesis import given
from hypothesis import strategies as st

from grs_agents.sandbox.isolation import (
    NUMBER,
    Answer,
    Branch,
    Load,
    Node,
    among,
    any_bit,
    argument,
    assemble,
    at_least,
    encode,
    equal,
    places,
    ranges,
    upper_half,
)
from tests.sandbox import classic_bpf

words = st.integers(0, 2**32 - 1) | st.integers(0, 9)
answers = st.integers(0, 2**31).map(Answer)
tests = st.sampled_from([equal, at_least, any_bit])


def wider(nodes: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
    branch = st.builds(lambda test, value, then, other: test(value, then, other), tests, words, nodes, nodes)
    return branch | st.builds(argument, st.integers(0, 5), nodes) | st.builds(upper_half, st.integers(0, 5), nodes)


trees = st.recursive(answers, wider, max_leaves=30).map(lambda node: Load(NUMBER, node))


def decide(node: Node, number: int, arguments: tuple[int, ...]) -> int:
    """Walk the tree itself."""
    word = 0
    while not isinstance(node, Answer):
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
    assert classic_bpf.run(encode(assemble(tree)), number, 0, arguments) == decide(tree, number, arguments)


@given(st.lists(words, max_size=600, unique=True), words)
def test_one_of_many_values(values: list[int], word: int) -> None:
    program = encode(assemble(Load(NUMBER, among(values, Answer(1), Answer(2)))))
    assert classic_bpf.run(program, word) == (1 if word in values else 2)
    assert all(classic_bpf.run(program, value) == 1 for value in values)


@given(st.lists(st.integers(1, 5000), min_size=1, max_size=400, unique=True), st.integers(0, 6000))
def test_ranges_of_any_length(borders: list[int], number: int) -> None:
    starts = [0, *sorted(borders)]
    program = assemble(Load(NUMBER, ranges([(start, Answer(index)) for index, start in enumerate(starts)])))
    assert classic_bpf.run(encode(program), number) == bisect_right(starts, number) - 1


def test_no_jump_is_too_far_for_its_byte() -> None:
    long: Node = Answer(1)
    for value in range(500):
        long = equal(value + 10, Answer(2), long)
    program = assemble(Load(NUMBER, Branch(0x15, 5, long, Answer(3))))
    assert max(max(true, false) for _, true, false, _ in program) <= 255
    assert [classic_bpf.run(encode(program), number) for number in (5, 6)] == [1, 3]


def test_an_operand_is_replaced_wherever_it_stands() -> None:
    program = assemble(Load(NUMBER, equal(7, Answer(1), at_least(7, Answer(2), Answer(3)))))
    encoded = bytearray(encode(program))
    for place in places(program, 7):
        struct.pack_into("=I", encoded, place, 9)
    assert [classic_bpf.run(bytes(encoded), number) for number in (7, 9, 10)] == [3, 1, 2]
