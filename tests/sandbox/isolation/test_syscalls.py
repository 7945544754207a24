"""The numbers are the kernel's."""

import re
from pathlib import Path

import pytest

from grs_agents.sandbox.isolation.kernel import NUMBERS
from grs_agents.sandbox.isolation.seccomp import ALLOWED, DENIED
from tests.needs import needs

X86_64_HEADER = Path("/usr/include/x86_64-linux-gnu/asm/unistd_64.h")
GENERIC_HEADER = Path("/usr/include/asm-generic/unistd.h")
"""Which aarch64 uses."""

OTHER_NAMES = {"fstatat": "newfstatat"}
"""What the generic header calls differently."""

OF_32_BITS = re.compile(r"_time64$|64_64$|^(fcntl64|statfs64|fstatfs64|truncate64|ftruncate64|llseek|mmap2)$")


def in_header(header: Path) -> dict[str, int]:
    found: list[tuple[str, str]] = re.findall(r"#define\s+__NR(?:3264)?_(\w+)\s+(\d+)", header.read_text())
    return {OTHER_NAMES.get(name, name): int(number) for name, number in found}


@needs(str(X86_64_HEADER))
def test_x86_64_agrees_with_the_kernel_headers() -> None:
    expected = in_header(X86_64_HEADER)
    known = NUMBERS["x86_64"]
    assert len(expected) > 300
    assert {name: known.get(name) for name in expected if expected[name] <= 470} == expected


@needs(str(GENERIC_HEADER))
def test_aarch64_agrees_with_the_kernel_headers() -> None:
    expected = {name: number for name, number in in_header(GENERIC_HEADER).items() if not OF_32_BITS.search(name)}
    known = NUMBERS["aarch64"]
    shared = expected.keys() & known.keys()
    assert len(shared) > 290
    assert {name: known[name] for name in shared} == {name: expected[name] for name in shared}


@pytest.mark.parametrize(
    ("name", "x86_64", "aarch64"),
    [
        ("read", 0, 63),
        ("openat", 257, 56),
        ("newfstatat", 262, 79),
        ("clone", 56, 220),
        ("execve", 59, 221),
        ("socket", 41, 198),
        ("ptrace", 101, 117),
        ("mount", 165, 40),
        ("mmap", 9, 222),
        ("prlimit64", 302, 261),
        ("memfd_create", 319, 279),
        ("rseq", 334, 293),
        ("io_uring_setup", 425, 425),
        ("clone3", 435, 435),
        ("landlock_restrict_self", 446, 446),
        ("file_setattr", 469, 469),
    ],
)
def test_landmarks(name: str, x86_64: int, aarch64: int) -> None:
    assert (NUMBERS["x86_64"][name], NUMBERS["aarch64"][name]) == (x86_64, aarch64)


@pytest.mark.parametrize("machine", NUMBERS)
def test_no_number_has_two_names(machine: str) -> None:
    assert len(set(NUMBERS[machine].values())) == len(NUMBERS[machine])


def test_replaced_calls_exist_on_x86_64_alone() -> None:
    replaced = {"open", "stat", "fork", "vfork", "pipe", "dup2", "select", "unlink", "chmod", "time", "arch_prctl"}
    assert replaced <= NUMBERS["x86_64"].keys()
    assert not replaced & NUMBERS["aarch64"].keys()


def test_the_policy_names_calls_that_exist() -> None:
    named = {*ALLOWED.split(), *DENIED.split()}
    assert named <= NUMBERS["x86_64"].keys() | NUMBERS["aarch64"].keys()
    assert not set(ALLOWED.split()) & set(DENIED.split())
