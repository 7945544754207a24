"""Unpack LZF, the compression of PCD files."""

from grs_agents.errors import InputError

LONGEST_LITERAL = 32


def unpacked(data: bytes, size: int, where: str) -> bytes:
    """``data`` unpacked.

    A control byte below 32 is followed by so many bytes, and one more, as they are. Any other holds a length in its
    upper three bits (7: the next byte is added) and, with the byte after it, how far back to copy from.

    Args:
        data: the packed bytes.
        size: how many come out.
        where: what errors call the file.

    Raises:
        InputError: other than ``size`` bytes come out, or it refers to what is not there.
    """
    out = bytearray()
    at, end = 0, len(data)
    while at < end and len(out) <= size:
        control = data[at]
        at += 1
        if control < LONGEST_LITERAL:
            out += data[at : at + control + 1]
            at += control + 1
            continue
        if at + 1 + (control >> 5 == 7) > end:
            break
        length = (control >> 5) + 2
        if length == 9:
            length += data[at]
            at += 1
        start = len(out) - ((control & 31) << 8) - data[at] - 1
        at += 1
        if start < 0:
            break
        chunk = out[start : start + length]
        # What is copied may overlap what is being written: then it repeats itself.
        out += chunk if len(chunk) == length else (chunk * (length // len(chunk) + 1))[:length]
    if at != end or len(out) != size:
        raise InputError(f"{where} cannot be unpacked: {len(out)} of {size} bytes came out", "write the cloud again")
    return bytes(out)
