"""Decoder of the pictures and arrays of a run folder: this process, or a worker that holds no keys."""

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
        """Pixels of the picture; None if the file lies outside this decoder's folders."""
        ...

    def read_npz(
        self,
        file: Path,
        wanted: Mapping[str, str],
        optional: Mapping[str, str],
        together: int | None,
        text: Collection[str],
    ) -> dict[str, Array] | None:
        """Arrays by name; None if the file lies outside this decoder's folders."""
        ...


_DECODER: ContextVar[Decoder | None] = ContextVar("decoder", default=None)


def current_decoder() -> Decoder | None:
    """Return the decoder of this context, or None."""
    return _DECODER.get()


@contextmanager
def decode_elsewhere(decoder: Decoder) -> Generator[None]:
    """Let ``decoder`` serve `read_picture` and `read_npz` in the block."""
    token = _DECODER.set(decoder)
    try:
        yield
    finally:
        _DECODER.reset(token)
