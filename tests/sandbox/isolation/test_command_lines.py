"""The profile of macOS's sandbox, as far as its text can show."""

import re
import sys
from pathlib import Path

import pytest

from grs_agents.sandbox.isolation import command_lines

READABLE = (Path("/opt/a b"), Path('/opt/q"u\\o'))
SCRATCH = Path("/private/var/folders/x/scratch/0")


def rules(text: str) -> list[tuple[str, str]]:
    """Each rule's action with its operations, and its filters."""
    found = [re.fullmatch(r"\((allow|deny) ([^(\"]*?)( \(.*\))?\)", line) for line in text.splitlines()]
    return [(f"{one[1]} {one[2]}", (one[3] or "").strip()) for one in found if one]


def test_everything_is_denied_first_and_the_rest_is_named() -> None:
    lines = command_lines.seatbelt_profile(READABLE, SCRATCH).splitlines()
    assert lines[:2] == ["(version 1)", "(deny default)"]
    assert all(filters for action, filters in rules("\n".join(lines)) if action.startswith("allow file"))


def test_only_scratch_can_be_written() -> None:
    found = [
        (action, filters)
        for action, filters in rules(command_lines.seatbelt_profile(READABLE, SCRATCH))
        if "write" in action
    ]
    assert found == [
        ("allow file-read* file-write*", f'(subpath "{SCRATCH}")'),
        ("allow file-read* file-write-data", '(literal "/dev/null")'),
    ]


def test_no_network_no_process_and_no_signal_to_others() -> None:
    found = rules(command_lines.seatbelt_profile(READABLE, SCRATCH))
    assert {("deny network*", ""), ("deny process-fork", ""), ("allow signal", "(target self)")} <= set(found)
    (executed,) = [filters for action, filters in found if action == "allow process-exec"]
    assert f'(literal "{sys.executable}")' in executed
    assert "subpath" not in executed


@pytest.mark.parametrize(("path", "quoted"), [(READABLE[0], '"/opt/a b"'), (READABLE[1], '"/opt/q\\"u\\\\o"')])
def test_paths_are_quoted(path: Path, quoted: str) -> None:
    assert f"(subpath {quoted})" in command_lines.seatbelt_profile([path], SCRATCH)
