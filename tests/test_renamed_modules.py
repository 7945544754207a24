"""Imports under the names that modules had before: they give the same modules."""

import subprocess
import sys
from importlib import import_module

import pytest

from tests.slow import SLOW

EARLIER = {
    "config": ("base.config", "Limits"),
    "content": ("base.content", "add_overlay_folder"),
    "errors": ("base.errors", "ConfigError"),
    "grading": ("tasks.grading", "PrimitivePolicy"),
    "nodes": ("graph", "add_fix_loop"),
    "nodes.judging": ("graph.judging", "run_tests"),
    "policies": ("graph.policies", "RoutingDecision"),
    "questions": ("base.questions", "ask_person"),
    "state": ("graph.state", "RunState"),
    "task_folder": ("tasks.task_folder", "open_task_folder"),
    "trace": ("base.trace", "read_events"),
    "varied_instances": ("tasks.varied_instances", "make_varied_instances"),
}


PROBES = [
    f"import grs_agents.{earlier} as earlier; from grs_agents.{earlier} import {name}\n"
    f"import grs_agents.{now} as now; assert earlier is now and now.{name} is {name}"
    for earlier, (now, name) in EARLIER.items()
]
FIRST = """
import os, sys
import cv2, langgraph.graph, mujoco, numpy, PIL.Image, pydantic, scipy.optimize, scipy.spatial
import xml.etree.ElementTree

for probe in PROBES:
    if (child := os.fork()) == 0:
        assert "grs_agents" not in sys.modules
        exec(probe)
        os._exit(0)
    if os.waitpid(child, 0)[1]:
        sys.exit(probe)
"""
"""Each in a child of a process that has imported nothing but packages of others."""


@pytest.mark.parametrize(
    "program",
    [
        pytest.param("\n".join(PROBES), id="all"),
        pytest.param(FIRST.replace("PROBES", repr(PROBES)), id="first", marks=SLOW),
    ],
)
def test_an_earlier_name_gives_the_module_of_today(program: str) -> None:
    """All after each other in one process, and each as the first that a process imports."""
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_name_that_never_was_is_not_found() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"grs_agents\.nowhere"):
        import_module("grs_agents.nowhere")
