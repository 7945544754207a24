"""Classic BPF, the language of seccomp filters, written as a tree of decisions.

A filter reads one 32-bit word of ``struct seccomp_data`` at a time, compares it, and ends in an answer. Every
branch of the tree ends in an answer of its own, so that branches are laid out one after the other and no jump needs
a label.
"""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce

_LOAD, _GO, _RETURN = 0x20, 0x05, 0x06
_EQUAL, _AT_LEAST, _ANY_BIT = 0x15, 0x35, 0x45
_INSTRUCTION, _OPERAND = struct.Struct("=HBBI"), 4
_FARTHEST = 255
"""How far a comparison can jump: its offsets are bytes."""

NUMBER, ARCHITECTURE = 0, 4
"""Where the number of the call and the machine it is made for lie in ``struct seccomp_data``."""


@dataclass(frozen=True)
class Answer:
    """The end of a branch: what becomes of the call."""

    action: int


@dataclass(frozen=True)
class Load:
    """Read the word at a byte offset, then go on."""

    offset: int
    then: "Node"


@dataclass(frozen=True)
class Branch:
    """Compare the word that was read last, and go one of two ways."""

    comparison: int
    value: int
    then: "Node"
    otherwise: "Node"


Node = Answer | Load | Branch
Instruction = tuple[int, int, int, int]
"""Operation, jump if true, jump if false, operand."""


def argument(index: int, then: Node) -> Load:
    """Read the lower half of an argument (little endian): all of it, where the kernel takes an ``int``."""
    return Load(16 + 8 * index, then)


def upper_half(index: int, then: Node) -> Load:
    """Read the upper half of an argument."""
    return Load(20 + 8 * index, then)


def equal(value: int, then: Node, otherwise: Node) -> Branch:
    """Whether the word is ``value``."""
    return Branch(_EQUAL, value, then, otherwise)


def at_least(value: int, then: Node, otherwise: Node) -> Branch:
    """Whether the word, unsigned, is ``value`` or more."""
    return Branch(_AT_LEAST, value, then, otherwise)


def any_bit(mask: int, then: Node, otherwise: Node) -> Branch:
    """Whether any bit of ``mask`` is set."""
    return Branch(_ANY_BIT, mask, then, otherwise)


def among(values: Iterable[int], then: Node, otherwise: Node) -> Node:
    """Whether the word is one of ``values``."""
    return reduce(lambda rest, value: equal(value, then, rest), sorted(values, reverse=True), otherwise)


def ranges(starts: Sequence[tuple[int, Node]]) -> Node:
    """Find the last start, in rising order, that the word reaches, by halving: 200 starts cost 8 comparisons."""
    if len(starts) == 1:
        return starts[0][1]
    middle = len(starts) // 2
    return at_least(starts[middle][0], ranges(starts[middle:]), ranges(starts[:middle]))


def assemble(node: Node) -> list[Instruction]:
    """Lay the tree out as instructions."""
    if isinstance(node, Answer):
        return [(_RETURN, 0, 0, node.action)]
    if isinstance(node, Load):
        return [(_LOAD, 0, 0, node.offset), *assemble(node.then)]
    then, otherwise = assemble(node.then), assemble(node.otherwise)
    if len(then) <= _FARTHEST:
        return [(node.comparison, 0, len(then), node.value), *then, *otherwise]
    return [(node.comparison, 1, 0, node.value), (_GO, 0, 0, len(then)), *then, *otherwise]


def encode(program: Iterable[Instruction]) -> bytes:
    """The program as the kernel reads it: an array of ``struct sock_filter``."""
    return b"".join(_INSTRUCTION.pack(*instruction) for instruction in program)


def places(program: Iterable[Instruction], operand: int) -> tuple[int, ...]:
    """Where ``operand`` lies in the encoded program, in bytes: it can be replaced there (``struct``'s ``=I``)."""
    return tuple(
        number * _INSTRUCTION.size + _OPERAND
        for number, instruction in enumerate(program)
        if instruction[-1] == operand
    )
