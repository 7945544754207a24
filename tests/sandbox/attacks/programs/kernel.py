"""System calls that reconfigure the machine, and ways to get back the rights that were given up."""

import ctypes
import os
import socket
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from tests.sandbox.attacks.kit import HIDDEN, REFUSED, World, call, check, gets, libc, numbered, succeeded

NAMESPACES = {
    "user": 0x10000000,
    "mount": 0x20000,
    "network": 0x40000000,
    "process": 0x20000000,
    "host name": 0x4000000,
    "queues": 0x8000000,
    "cgroup": 0x2000000,
    "time": 0x80,
    "files": 0x400,
    "everything": 0x7E020000,
}
OWN = {"files": 0x400}


@gets(*REFUSED, "EINVAL", cases={name: flag for name, flag in NAMESPACES.items() if name not in OWN})
def unshare(world: World, flag: int) -> str:
    call("unshare", flag)
    return "a namespace"


@gets(*HIDDEN, cases={name: name for name in ("user", "mnt", "net", "pid", "uts", "ipc", "cgroup")})
def join_namespace(world: World, name: str) -> str:
    pid = next(pid for pid in (world["host"], 1) if Path(f"/proc/{pid}").exists() or pid == 1)
    call("setns", os.open(f"/proc/{pid}/ns/{name}", os.O_RDONLY), 0)
    return "a namespace"


def mounted(source: bytes, kind: bytes | None, flags: int = 0, options: bytes | None = None) -> str:
    """Mount something empty over a new folder, and take it off again."""
    for name in ("point", "empty", "other"):
        Path(name).mkdir()
    call("mount", source, b"point", kind, flags, options)
    libc.umount2(b"point", 2)
    return "mounted"


MOUNTS: dict[str, Callable[[], Any]] = {
    "tmpfs": lambda: mounted(b"none", b"tmpfs"),
    "proc": lambda: mounted(b"none", b"proc"),
    "bind": lambda: mounted(b"empty", None, 4096),
    "overlay": lambda: mounted(b"none", b"overlay", 0, b"lowerdir=empty:other"),
    "devpts": lambda: mounted(b"none", b"devpts"),
    "unmount": lambda: call("umount2", b"no such mount", 2),
    "pivot_root": lambda: call("pivot_root", b".", b"."),
    "chroot": lambda: os.chroot("."),
    "fsopen": lambda: call("fsopen", b"tmpfs", 0),
    "fspick": lambda: call("fspick", -100, b"/", 0),
    "open_tree": lambda: call("open_tree", -100, b"/", 1),
    "mount_setattr": lambda: call("mount_setattr", -100, b"no such mount", 0, bytes(32), 32),
}


@gets(*REFUSED, cases={name: name for name in MOUNTS})
def mount(world: World, name: str) -> str:
    return f"done: {MOUNTS[name]()}"


BUFFER = ctypes.create_string_buffer(256)
FORBIDDEN: dict[str, tuple[Any, ...]] = {
    "bpf": ("bpf", 0, ctypes.create_string_buffer(b"\2\0\0\0\4\0\0\0\4\0\0\0\1", 72), 72),
    "perf_event_open": ("perf_event_open", ctypes.create_string_buffer(b"\1\0\0\0\x70", 112), 0, -1, -1, 0),
    "userfaultfd": ("userfaultfd", 0),
    "keyctl": ("keyctl", 0, -3, 0),
    "add_key": ("add_key", b"user", b"canary", b"x", 1, -2),
    "request_key": ("request_key", b"user", b"canary", None, 0),
    "init_module": ("init_module", b"x", 1, b""),
    "kexec_load": ("kexec_load", 0, 99, 0, 0),
    "reboot": ("reboot", 0, 0, 0, 0),
    "swapon": ("swapon", b"no such file", 0),
    "syslog": ("syslog", 10, 0, 0),
    "acct": ("acct", b"no such file"),
    "quotactl": ("quotactl", 0, b"no such device", 0, 0),
    "fanotify_init": ("fanotify_init", 0, 0),
    "vmsplice": ("vmsplice", -1, 0, 0, 0),
    "vhangup": ("vhangup",),
    "ptrace": ("ptrace", 0, 0, 0, 0),
    "lookup by handle": ("open_by_handle_at", -100, BUFFER, 0),
    "kcmp": ("kcmp", 1, 1, 0, 0, 0),
    "io_setup": ("io_setup", 1, BUFFER),
}
X86_ONLY: dict[str, tuple[Any, ...]] = {
    "ports": ("ioperm", 0, 1, 1),
    "all ports": ("iopl", 3),
    "descriptor table": ("modify_ldt", 0, BUFFER, 16),
}


@gets(*REFUSED, cases=FORBIDDEN)
def forbidden_call(world: World, arguments: tuple[Any, ...]) -> str:
    """Each would be answered by something else than a refusal if it were let through."""
    return f"done: {call(*arguments)}"


@gets(*REFUSED, cases=X86_ONLY, machine="x86_64")
def forbidden_call_of_this_processor(world: World, arguments: tuple[Any, ...]) -> str:
    return f"done: {call(*arguments)}"


@gets(*REFUSED, cases={"host": "sethostname", "domain": "setdomainname"})
def rename_the_machine(world: World, name: str) -> str:
    """To what it is called already."""
    old = socket.gethostname() if name == "sethostname" else os.uname()[4]
    if name == "setdomainname":
        old = Path("/proc/sys/kernel/domainname").read_text().strip()
    call(name, old.encode(), len(old))
    return "renamed"


@gets("nothing", cases={"terminal input": 0x5412, "console": 0x541D, "controlling terminal": 0x540E})
def ioctl(world: World, request: int) -> list[str] | None:
    """``TIOCSTI`` types into the terminal of whoever started the program."""
    return succeeded({str(at): lambda at=at: check(libc.ioctl(at, request, b"x" * 64)) for at in range(64)})


IDS: dict[str, Callable[[], Any]] = {
    "setuid": lambda: os.setuid(0),
    "setgid": lambda: os.setgid(0),
    "setreuid": lambda: os.setreuid(0, 0),
    "setresuid": lambda: os.setresuid(0, 0, 0),
    "setgroups": lambda: os.setgroups([0]),
    "setfsuid": lambda: libc.setfsuid(0),
}


@gets("nothing")
def become_root(world: World) -> list[str] | None:
    """Some of these succeed where it is root in a world of its own; what counts is what it may do then."""
    succeeded(IDS)
    powers = {
        "list": lambda: list(Path("/root").iterdir()),
        "own": lambda: os.chown("/etc", 0, 0),
        "trace": lambda: list(Path("/proc/1/fd").iterdir()),
        "device": lambda: os.mknod("device", 0o060600, os.makedev(254, 0)),
    }
    return succeeded(powers)


CAPABILITIES = (ctypes.c_uint32 * 6)(*[0xFFFFFFFF] * 6)


@gets(*REFUSED, "EINVAL")
def all_capabilities(world: World) -> str:
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)
    call("capset", header, CAPABILITIES)
    return "all capabilities"


@gets("nothing")
def capabilities(world: World) -> list[int] | None:
    """Every set of them is empty: what it may use, take up and hand on."""
    header, sets = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
    check(libc.capget(header, sets))
    return [*filter(None, sets)] or None


@gets("nothing")
def capabilities_of_a_program(world: World) -> list[int] | None:
    """None can be gained by running one. Only who has capabilities can empty that set; see the next attack."""
    left = [number for number in range(64) if libc.prctl(23, number, 0, 0, 0) == 1]
    return left if world["bounded"] and left else None


@gets("nothing")
def new_privileges(world: World) -> list[str] | None:
    """They cannot be asked for again, and a set-user-id program gives none."""
    libc.prctl(38, 0, 0, 0, 0)
    libc.prctl(47, 2, 21, 0, 0)
    libc.prctl(28, 0x2F, 0, 0, 0)
    return None if libc.prctl(39, 0, 0, 0, 0) == 1 else ["new privileges"]


ALLOW = b"\x06\0\0\0\0\0\xff\x7f"


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_char_p))


@gets("nothing")
def a_filter_that_allows_all(world: World) -> list[str] | None:
    """Filters only add up: afterwards a fork is refused as before."""
    program = _Program(1, ALLOW)
    succeeded(
        {
            "prctl": lambda: check(libc.prctl(22, 2, ctypes.byref(program), 0, 0)),
            "none": lambda: check(libc.prctl(22, 0, 0, 0, 0)),
            "seccomp": lambda: call("seccomp", 1, 0, ctypes.byref(program)),
            "notify": lambda: call("seccomp", 1, 8, ctypes.byref(program)),
        }
    )
    pid = libc.fork()
    if pid == 0:
        os._exit(0)
    return ["it forked"] if pid > 0 else None


@gets("nothing")
def a_ruleset_that_allows_all(world: World) -> list[str] | None:
    """Rules only add up: afterwards the key is as unreadable as before."""
    with suppress(OSError):
        everything = (ctypes.c_uint64 * 3)(0xFFFF, 3, 0)
        ruleset = call("landlock_create_ruleset", everything, 24, 0)
        rule = ctypes.create_string_buffer(
            (0xFFFF).to_bytes(8, "little") + os.open("/", os.O_PATH).to_bytes(4, "little")
        )
        call("landlock_add_rule", ruleset, 1, rule, 0)
        call("landlock_restrict_self", ruleset, 0)
    with suppress(OSError):
        return [Path(world["key_file"]).read_text()]
    return None


NUMBERS = {
    "beyond the table": range(475, 520),
    "large": [1000, 0xFFFF],
    "negative": [-1, -57],
    "high bits": [2**32 + 57],
}


@gets("nothing", "crashed by SIGSYS", cases=NUMBERS)
def unknown_number(world: World, numbers: Sequence[int]) -> list[int] | None:
    """Beyond every table, and with bits that a filter might not look at: the last one is ``fork``."""
    found = []
    for number in numbers:
        with suppress(OSError):
            if numbered(number, 17, 0, 0, 0, 0) == 0 and number & 0xFF == 57:
                os._exit(0)  # it forked, and this is the child
            found.append(number)
    return found or None
