"""Decoding of the pictures and recordings of an untrusted run folder, in a worker that holds no keys."""

import math
from collections.abc import Collection, Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.elsewhere import decode_elsewhere
from grs_agents.sandbox.host.foreign_reader import ForeignReader

_WORKER = "grs_agents.views.common.decoding_worker"
_KINDS = "buifU"
_WIDEST = 400
"""Largest array element, bytes: a string of 100 characters."""
Array = npt.NDArray[Any]


@contextmanager
def decode_in_worker(*folders: Path) -> Generator[None]:
    """Decode the pictures and arrays of the run folders ``folders`` in a worker within the context."""
    decoder = _WorkerDecoder([folder.resolve() for folder in folders])
    try:
        with decode_elsewhere(decoder):
            yield
    finally:
        decoder.close()


class _WorkerDecoder:
    """Decodes files below ``roots``."""

    def __init__(self, roots: list[Path]) -> None:
        self._roots = roots
        self._reader = ForeignReader(_WORKER, roots)

    def read_picture(self, file: Path, flags: int) -> Array | None:
        """Returns: pixels; None for a file outside the folders."""
        arrays = self._read(file, {"picture": str(file.absolute()), "flags": flags})
        return None if arrays is None else arrays["pixels"]

    def read_npz(
        self,
        file: Path,
        wanted: Mapping[str, str],
        optional: Mapping[str, str],
        together: int | None,
        text: Collection[str],
    ) -> dict[str, Array] | None:
        """Returns: arrays; None for a file outside the folders."""
        options = {"wanted": dict(wanted), "optional": dict(optional), "together": together, "text": list(text)}
        arrays = self._read(file, {"npz": str(file.absolute()), **options})
        if arrays is not None and (arrays.keys() - {*wanted, *optional} or wanted.keys() - arrays.keys()):
            raise _make_answer_error(file)
        return arrays

    def _read(self, file: Path, request: dict[str, Any]) -> dict[str, Array] | None:
        if not any(file.resolve().is_relative_to(root) for root in self._roots):
            return None
        try:
            reading = self._reader.read(request, str(file))
        except InputError as error:
            texts = (text.replace(str(file.absolute()), str(file)) for text in (error.message, error.remedy))
            raise InputError(*texts) from error
        try:
            return {name: _build_array(reading.blobs[name], header) for name, header in reading.answer.items()}
        except (ValueError, TypeError, KeyError) as error:
            raise _make_answer_error(file) from error

    def close(self) -> None:
        """End the worker."""
        self._reader.close()


def _build_array(data: bytes, header: dict[str, Any]) -> Array:
    """An array of numbers or strings with the header's shape and type. Raises ValueError: they do not fit ``data``."""
    kind, shape = np.dtype(str(header["type"])), tuple(int(side) for side in header["shape"])
    if kind.kind not in _KINDS or kind.itemsize > _WIDEST or len(shape) > 8 or min(shape, default=0) < 0:
        raise ValueError("no array of numbers or words")
    if math.prod(shape) * kind.itemsize != len(data):
        raise ValueError("of another size")
    return np.frombuffer(bytearray(data), kind).reshape(shape)


def _make_answer_error(file: Path) -> InputError:
    return InputError(f"{file} cannot be read: the worker's answer is torn", "try again")
