"""MuJoCo, whose compiled parts carry no types: the one place where it is imported."""

import importlib
from typing import Any

mujoco: Any = importlib.import_module("mujoco")
