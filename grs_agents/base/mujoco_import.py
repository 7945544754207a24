"""MuJoCo, whose compiled parts carry no types: the one place where it is imported.

Pictures are made by casting rays, so MuJoCo is imported with OpenGL off: looking for a graphics library costs time,
starts a process (which the sandbox refuses) and fails where the user's ``MUJOCO_GL`` names one that is not there.
"""

import importlib
import logging
import os
from typing import Any


def _import_mujoco_without_gl() -> Any:
    wanted = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = "disabled"
    try:
        return importlib.import_module("mujoco")
    finally:
        if wanted is None:
            del os.environ["MUJOCO_GL"]
        else:
            os.environ["MUJOCO_GL"] = wanted


mujoco: Any = _import_mujoco_without_gl()
# Left to itself MuJoCo writes its warnings to a file in the working folder.
mujoco.set_mju_user_warning(logging.getLogger(__name__).warning)
