"""MuJoCo without OpenGL, and without types, as the importer uses it."""

import importlib
import os
import sys
from typing import Any


def load_mujoco() -> Any:
    """The module; imported with OpenGL off where it is not imported yet."""
    if "mujoco" in sys.modules:
        return sys.modules["mujoco"]
    wanted = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = "disabled"
    try:
        return importlib.import_module("mujoco")
    finally:
        if wanted is None:
            del os.environ["MUJOCO_GL"]
        else:
            os.environ["MUJOCO_GL"] = wanted
