"""Where the pictures and arrays of a run folder are decoded: in this process, or in one that holds no keys."""

from collections.abc import Collection, Generator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Protocol

import numpy.typing as npt

Array = npt.NDArray[Any]


class Decoder(Protocol):
    """Reads files as the functions of the same names do, errors included."""

    def read_picture(self, file: Path, flags: int) -> Array | None:
        """The picture; None where the file is none of this decoder's."""
        ...

    def read_npz(
        self,
        file: Path,
        wanted: Mapping[str, str],
        optional: Mapping[str, str],
        together: int | None,
        text: Collection[str],
    ) -> dict[str, Array] | None:
        """The arrays; None where the file is none of this decoder's."""
        ...


_DECODER: ContextVar[Decoder | None] = ContextVar("decoder", default=None)


def current_decoder() -> Decoder | None:
    """The decoder that stands in for this process, if there is one."""
    return _DECODER.get()


@contextmanager
def decode_elsewhere(decoder: Decoder) -> Generator[None]:
    """Let ``decoder`` read what the block reads with `read_picture` and `read_npz`."""
    token = _DECODER.set(decoder)
    try:
        yield
    finally:
        _DECODER.reset(token)
