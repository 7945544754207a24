"""The worker's part of looking at a run folder that somebody else made; ``foreign_decoding`` is the host's."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from grs_agents.base.foreign.arrays import read_npz
from grs_agents.base.foreign.pictures import read_picture
from grs_agents.sandbox.harness.answers import answer_or_refuse, send_blob


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """The arrays of an ``npz`` file, or the pixels of a ``picture``."""
    return answer_or_refuse(partial(_read, request))


def _read(request: dict[str, Any]) -> dict[str, Any]:
    if "picture" in request:
        arrays = {"pixels": read_picture(Path(request["picture"]), request["flags"])}
    else:
        file, said = (
            Path(request["npz"]),
            (request["wanted"], request["optional"], request["together"], request["text"]),
        )
        arrays = read_npz(file, *said)
    for name, array in arrays.items():
        send_blob(name, np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    return {name: {"shape": list(array.shape), "type": array.dtype.str} for name, array in arrays.items()}
