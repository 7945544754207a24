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


@pytest.mark.parametrize("names", [tuple(EARLIER), *(pytest.param((name,), marks=SLOW) for name in EARLIER)])
def test_an_earlier_name_gives_the_module_of_today(names: tuple[str, ...]) -> None:
    """All after each other in one process, and each as the first that a process imports."""
    probes: list[str] = []
    for earlier in names:
        now, name = EARLIER[earlier]
        probes.append(f"import grs_agents.{earlier} as earlier; from grs_agents.{earlier} import {name}")
        probes.append(f"import grs_agents.{now} as now; assert earlier is now and now.{name} is {name}")
    subprocess.run([sys.executable, "-c", "\n".join(probes)], check=True)


def test_a_name_that_never_was_is_not_found() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"grs_agents\.nowhere"):
        import_module("grs_agents.nowhere")
