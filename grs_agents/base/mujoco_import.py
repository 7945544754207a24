"""The only import of MuJoCo, whose compiled parts carry no types.

Pictures are made by casting rays, so MuJoCo is imported with OpenGL off: the search for a graphics library costs time,
starts a process (which the sandbox refuses) and fails if the user's ``MUJOCO_GL`` names a missing library.
"""

import importlib
import logging
import os
from typing import Any

_users_choice = os.environ.get("MUJOCO_GL")
os.environ["MUJOCO_GL"] = "disabled"
try:
    mujoco: Any = importlib.import_module("mujoco")
finally:
    if _users_choice is None:
        del os.environ["MUJOCO_GL"]
    else:
        os.environ["MUJOCO_GL"] = _users_choice
# Left to itself MuJoCo writes its warnings to a file in the working folder.
mujoco.set_mju_user_warning(logging.getLogger(__name__).warning)
