"""Where generated code runs: a process without rights or reach, whose every failure comes back as a value.

The room knows nothing of simulations: its callers name the tools, what a worker imports ahead of time, and
the hooks that a test run calls.
"""

from grs_agents.sandbox.harness.captured_error import CapturedError
from grs_agents.sandbox.harness.channel import progress
from grs_agents.sandbox.harness.suite_runner import load_program, run_tests_inside, seed_everything
from grs_agents.sandbox.host.batch_calls import BatchResult, call_batch
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sandbox.host.suite_discovery import ExpectedTests, expected_tests, parse_program
from grs_agents.sandbox.host.suite_run import TestRun, run_tests
from grs_agents.sandbox.host.zygote_process import SandboxError
from grs_agents.sandbox.isolation.backends import BACKEND_REMEDIES, Backend, BackendChoice, backend_candidates
from grs_agents.sandbox.protocol.report import CallOutcome, CallResult, Limits, TestCase, TestReport
from grs_agents.sandbox.protocol.tracebacks import (
    SIMULATION_FILE,
    TESTS_FILE,
    Trace,
    describe_error,
    describe_stack_dump,
)

__all__ = [
    "BACKEND_REMEDIES",
    "SIMULATION_FILE",
    "TESTS_FILE",
    "Backend",
    "BackendChoice",
    "BatchResult",
    "CallOutcome",
    "CallResult",
    "CapturedError",
    "ExpectedTests",
    "Limits",
    "Sandbox",
    "SandboxError",
    "TestCase",
    "TestReport",
    "TestRun",
    "Trace",
    "backend_candidates",
    "call_batch",
    "describe_error",
    "describe_stack_dump",
    "expected_tests",
    "load_program",
    "parse_program",
    "progress",
    "run_tests",
    "run_tests_inside",
    "seed_everything",
]
