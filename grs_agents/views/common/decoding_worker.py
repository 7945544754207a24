"""Worker side of decoding an untrusted run folder; ``foreign_decoding`` is the host side."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from grs_agents.base.foreign.arrays import read_npz
from grs_agents.base.foreign.pictures import read_picture
from grs_agents.sandbox.harness.answers import answer_or_refuse, send_blob


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """Decode the arrays of an ``npz`` file, or the pixels of a ``picture``."""
    return answer_or_refuse(partial(_read, request))


def _read(request: dict[str, Any]) -> dict[str, Any]:
    if "picture" in request:
        arrays = {"pixels": read_picture(Path(request["picture"]), request["flags"])}
    else:
        options = (request[key] for key in ("wanted", "optional", "together", "text"))
        arrays = read_npz(Path(request["npz"]), *options)
    for name, array in arrays.items():
        send_blob(name, np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    return {name: {"shape": list(array.shape), "type": array.dtype.str} for name, array in arrays.items()}
