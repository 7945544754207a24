"""Classic BPF in pure Python: what a filter answers to one system call, on any machine."""

import struct

FAR, LOAD, RETURN = 0x05, 0x20, 0x06
COMPARISONS = {
    0x15: lambda word, value: word == value,
    0x35: lambda word, value: word >= value,
    0x45: lambda word, value: bool(word & value),
}


def run(program: bytes, number: int, architecture: int = 0, arguments: tuple[int, ...] = ()) -> int:
    """The answer of a filter; an instruction that does not exist or leaves the program is a ``KeyError`` or so."""
    padded = [value & 0xFFFF_FFFF_FFFF_FFFF for value in (*arguments, 0, 0, 0, 0, 0, 0)[:6]]
    data = struct.pack("<IIQ6Q", number & 0xFFFF_FFFF, architecture, 0, *padded)
    assert len(program) <= 4096 * 8
    word = at = 0
    while True:
        code, true, false, operand = struct.unpack_from("<HBBI", program, 8 * at)
        at += 1
        if code == RETURN:
            return operand
        if code == LOAD:
            (word,) = struct.unpack_from("<I", data, operand)
        elif code == FAR:
            at += operand
        else:
            at += true if COMPARISONS[code](word, operand) else false
