"""Where generated code runs: a process without rights or reach, whose every failure comes back as a value.

The room knows nothing of simulations: its callers name the tools, what a worker imports ahead of time, and
the hooks that a test run calls.
"""

from grs_agents.sandbox.backends import REMEDIES, Backend, Choice
from grs_agents.sandbox.call import CallOutcome, CallResult, Limits
from grs_agents.sandbox.caught import Caught
from grs_agents.sandbox.channel import progress
from grs_agents.sandbox.discovery import ExpectedTests, expected_tests, parse
from grs_agents.sandbox.each import EachResult, call_each
from grs_agents.sandbox.harness import load_program, run_tests_inside, seed_everything
from grs_agents.sandbox.host import Sandbox
from grs_agents.sandbox.process import SandboxError
from grs_agents.sandbox.report import TestCase, TestReport
from grs_agents.sandbox.testing import TestRun, run_tests
from grs_agents.sandbox.traces import SIMULATION_FILE, TESTS_FILE, Trace, describe, from_stack

__all__ = [
    "REMEDIES",
    "SIMULATION_FILE",
    "TESTS_FILE",
    "Backend",
    "CallOutcome",
    "CallResult",
    "Caught",
    "Choice",
    "EachResult",
    "ExpectedTests",
    "Limits",
    "Sandbox",
    "SandboxError",
    "TestCase",
    "TestReport",
    "TestRun",
    "Trace",
    "call_each",
    "describe",
    "expected_tests",
    "from_stack",
    "load_program",
    "parse",
    "progress",
    "run_tests",
    "run_tests_inside",
    "seed_everything",
]
