"""What a process gives up, read back from the kernel."""

import ctypes
import os
from pathlib import Path

import pytest

from grs_agents.sandbox.isolation import kernel, privileges
from tests.needs import needs
from tests.sandbox.confined import USERS, become, forked

pytestmark = needs("64-bit linux")


def status() -> dict[str, str]:
    lines = Path("/proc/self/status").read_text().splitlines()
    return {key: value.strip() for key, _, value in (line.partition(":") for line in lines)}


@pytest.mark.parametrize("user", USERS)
def test_no_capability_is_left(user: str) -> None:
    def drop() -> list[int]:
        become(user)
        privileges.drop_capabilities()
        return [int(status()[name], 16) for name in ("CapEff", "CapPrm", "CapInh", "CapAmb")]

    assert forked(drop).value == [0, 0, 0, 0]


@needs("root")
def test_none_can_be_gained_by_a_program() -> None:
    def drop() -> int:
        privileges.drop_bounding_set()
        privileges.drop_bounding_set()
        return int(status()["CapBnd"], 16)

    assert forked(drop).value == 0


@needs("root")
def test_root_without_capabilities_is_bound_by_permission_bits(tmp_path: Path) -> None:
    hidden = tmp_path / "hidden"
    hidden.write_text("x")
    os.chown(hidden, 65534, 65534)
    hidden.chmod(0o600)

    def read() -> str:
        privileges.drop_capabilities()
        return hidden.read_text()

    assert forked(read).error == "PermissionError"


@pytest.mark.parametrize("user", USERS)
def test_no_new_privileges_and_not_dumpable(user: str) -> None:
    def give_up() -> list[int]:
        become(user)
        privileges.forbid_new_privileges()
        privileges.hide_from_other_processes()
        get_dumpable, get_no_new_privileges = 3, 39
        return [kernel.prctl(get_dumpable), kernel.prctl(get_no_new_privileges)]

    assert forked(give_up).value == [0, 1]


@needs("root")
def test_root_is_counted_apart_yet_opens_its_files(tmp_path: Path) -> None:
    own = tmp_path / "own"
    own.write_text("x")
    own.chmod(0o600)
    get_death_signal, set_death_signal = 2, 1

    def leave() -> list[object]:
        kernel.prctl(set_death_signal, 9)
        left = privileges.use_unique_user_id()
        privileges.drop_capabilities()
        kept = bytearray(8)
        kernel.prctl(get_death_signal, ctypes.addressof(ctypes.c_char.from_buffer(kept)))
        return [left, os.getuid() >= 0x70000000, os.geteuid(), own.read_text(), kept[0]]

    assert forked(leave).value == [True, True, 0, "x", 9]


def test_without_the_right_to_it_everything_stays() -> None:
    def leave() -> list[object]:
        become(USERS[-1])
        return [privileges.use_unique_user_id(), *os.getresuid()]

    user = 65534 if USERS[-1] == "nobody" else os.getuid()
    assert forked(leave).value == [False, user, user, user]
