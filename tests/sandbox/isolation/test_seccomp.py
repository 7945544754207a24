"""The filter: what it answers to every call on both machines, and what the kernel makes of it here."""

import ctypes
import errno
import fcntl
import mmap
import os
import resource
import signal
import socket
import subprocess
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from grs_agents.sandbox.isolation import kernel, seccomp
from grs_agents.sandbox.isolation.kernel import NUMBERS
from grs_agents.sandbox.isolation.seccomp import assemble_instructions, encode_instructions
from tests.needs import needs
from tests.sandbox import classic_bpf
from tests.sandbox.confined import Got, forked, without_new_privileges

PID = 4242
ARCHITECTURES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
I386, ARM, RISCV64 = 0x40000003, 0x40000028, 0xC00000F3
ALLOW, KILL = 0x7FFF0000, 0x80000000
EPERM, ENOSYS = 0x00050000 + errno.EPERM, 0x00050000 + errno.ENOSYS

PROGRAMS = {
    (machine, abi): encode_instructions(assemble_instructions(seccomp.build_policy_tree(machine, PID, abi)))
    for machine in ("x86_64", "aarch64")
    for abi in (2, 7)
}

BY_ARGUMENTS = {
    *("clone", "kill", "tkill", "tgkill", "rt_sigqueueinfo", "rt_tgsigqueueinfo"),
    *("prlimit64", "fallocate", "ioctl", "fcntl", "prctl", "openat", "open"),
}

DANGEROUS = """
fork vfork clone3 execve execveat socket socketpair connect bind listen accept accept4 sendto sendmsg recvmsg ptrace
process_vm_readv process_vm_writev process_madvise kcmp pidfd_open pidfd_getfd pidfd_send_signal memfd_create
memfd_secret shmget shmat msgget semget mq_open io_uring_setup io_uring_enter io_setup bpf perf_event_open userfaultfd
unshare setns mount umount2 pivot_root chroot open_tree move_mount fsopen mount_setattr keyctl add_key request_key
personality mknod mknodat init_module finit_module kexec_load reboot swapon iopl ioperm modify_ldt quotactl
settimeofday clock_settime adjtimex sethostname name_to_handle_at open_by_handle_at setpriority sched_setaffinity
sched_setscheduler ioprio_set fanotify_init inotify_init1 setrlimit chmod fchmod fchmodat fchmodat2 chown fchownat
utimensat setxattr removexattr setuid setresuid setgroups capset seccomp setsid setpgid mlock vmsplice syslog openat2
"""
"""Written down a second time, apart from the policy."""


def answer(machine: str, name: str, *arguments: int, abi: int = 7) -> int:
    number = NUMBERS[machine][name]
    return classic_bpf.run(PROGRAMS[machine, abi], number, ARCHITECTURES[machine], arguments)


@pytest.mark.parametrize("machine", ARCHITECTURES)
def test_every_number_has_the_answer_of_its_name(machine: str) -> None:
    names = {number: name for name, number in NUMBERS[machine].items()}
    allowed, denied = set(seccomp.ALLOWED.split()), set(seccomp.DENIED.split())
    for number in range(1024):
        name = names.get(number, "")
        if name not in BY_ARGUMENTS:
            expected = ALLOW if name in allowed else EPERM if name in denied else ENOSYS
            found = classic_bpf.run(PROGRAMS[machine, 7], number, ARCHITECTURES[machine], (-1, -1, -1, -1, -1, -1))
            assert found == expected, (number, name)


@pytest.mark.parametrize("machine", ARCHITECTURES)
@pytest.mark.parametrize("arguments", [(), (1, 1, 1, 1, 1, 1), (-1, -1, -1, -1, -1, -1)])
def test_nothing_dangerous_passes(machine: str, arguments: tuple[int, ...]) -> None:
    known = [name for name in DANGEROUS.split() if name in NUMBERS[machine]]
    assert len(known) > 75
    assert not [name for name in known if answer(machine, name, *arguments) == ALLOW]


@pytest.mark.parametrize("machine", ARCHITECTURES)
def test_calls_for_another_machine_kill(machine: str) -> None:
    program = PROGRAMS[machine, 7]
    for architecture in {I386, ARM, RISCV64, *ARCHITECTURES.values()} - {ARCHITECTURES[machine]}:
        assert {classic_bpf.run(program, number, architecture) for number in range(600)} == {KILL}
    x32 = [0x40000000 + number for number in range(600)]
    assert {classic_bpf.run(program, number, ARCHITECTURES[machine]) for number in (*x32, -1)} == {KILL}


CASES = [
    ("clone", (0x3D0F00,), ALLOW),  # what the C library asks for when it starts a thread
    ("clone", (0x1200011,), EPERM),  # ... and a process
    ("clone", (0,), EPERM),
    ("clone", (0x3D0F00 | 0x10000000,), EPERM),
    ("clone", (0x3D0F00 | 0x40000000,), EPERM),
    ("clone", (0x1_0000_0000_0000 | 0x11,), EPERM),  # the bit of a thread, but in the upper half
    *[
        (name, arguments, expected)
        for name in ("kill", "tkill", "tgkill", "rt_sigqueueinfo", "rt_tgsigqueueinfo")
        for arguments, expected in (
            ((PID, 9), ALLOW),
            ((0, 9), EPERM),
            ((-1, 9), EPERM),
            ((-PID, 9), EPERM),
            ((1, 9), EPERM),
            ((PID + 1, 9), EPERM),
        )
    ],
    ("prlimit64", (0, 7, 0, 1), ALLOW),
    ("prlimit64", (PID, 7, 0, 1), ALLOW),
    ("prlimit64", (1, 7, 0, 1), EPERM),
    ("prlimit64", (0, 7, 0x1000, 0), EPERM),
    ("prlimit64", (0, 7, 0x1_0000_0000, 0), EPERM),  # an address whose lower half is 0
    ("fallocate", (3, 0, 0, 4096), ALLOW),
    ("fallocate", (3, 1, 0, 4096), EPERM),
    ("openat", (3, 0, os.O_RDWR | os.O_CREAT | os.O_DIRECTORY), ALLOW),
    ("openat", (3, 0, os.O_RDWR | os.O_TMPFILE), EPERM),
    ("ioctl", (0, 0x5401), ALLOW),
    ("ioctl", (0, 0x541B), ALLOW),
    *[("ioctl", (0, command), EPERM) for command in (0x5412, 0x541C, 0x8901, 0x8902, 0x8910, 0x40086602, 0x540E)],
    ("ioctl", (0, 0x1_0000_5412), EPERM),  # the kernel reads the lower half
    *[("fcntl", (3, command), ALLOW) for command in (0, 1, 2, 3, 4, 6, 1030)],
    *[("fcntl", (3, command), EPERM) for command in (8, 10, 15, 1024, 1026, 1033)],
    ("fcntl", (3, 1031, 65536), ALLOW),
    ("fcntl", (3, 1031, 65537), EPERM),
    ("fcntl", (3, 1031, 0x1_0000_0000), EPERM),
    *[("prctl", (option,), ALLOW) for option in (15, 16, 3, 2, 39)],
    *[("prctl", (option,), EPERM) for option in (1, 4, 22, 24, 28, 35, 36, 47, 59, 0x59616D61)],
]


@pytest.mark.parametrize("machine", ARCHITECTURES)
def test_arguments_decide(machine: str) -> None:
    wrong = [case for case in CASES if answer(machine, case[0], *case[1]) != case[2]]
    assert not wrong


@pytest.mark.parametrize("machine", ARCHITECTURES)
@pytest.mark.parametrize("mode", [os.O_RDONLY, os.O_WRONLY, os.O_RDWR, os.O_ACCMODE])
def test_a_file_open_for_reading_is_not_truncated_if_landlock_lets_it(machine: str, mode: int) -> None:
    writes = mode in {os.O_WRONLY, os.O_RDWR}
    truncates = mode | os.O_TRUNC | os.O_CLOEXEC
    assert answer(machine, "openat", 3, 0, truncates, abi=2) == (ALLOW if writes else EPERM)
    assert answer(machine, "openat", 3, 0, mode | os.O_CLOEXEC, abi=2) == ALLOW
    assert answer(machine, "openat", 3, 0, truncates, abi=7) == ALLOW
    assert answer(machine, "truncate", abi=2) == EPERM
    assert answer(machine, "truncate", abi=7) == ALLOW


def filtered(check: Callable[[], object]) -> Got:
    """What the check gets behind the filter alone."""
    return without_new_privileges(lambda: seccomp.install_filter(7), check)


@needs("seccomp")
def test_the_kernel_answers_as_the_model_does() -> None:
    machine = kernel.detect_architecture()
    assert machine is not None
    denied = [name for name in seccomp.DENIED.split() if name in NUMBERS[machine]]
    unknown = ["clone3", "inotify_init1", "openat2", "signalfd4", "timerfd_create", "listmount", "vmsplice"]

    def errors() -> dict[str, int | None]:
        answers: dict[str, int | None] = {}
        for name in denied + unknown:
            answers[name] = None
            try:
                kernel.make_system_call(name)
            except OSError as error:
                answers[name] = error.errno
        return answers

    got = filtered(errors)
    assert got.value == dict.fromkeys(denied, errno.EPERM) | dict.fromkeys(unknown, errno.ENOSYS)


def start_a_program() -> None:
    subprocess.run(["/bin/true"], check=True)


def lease() -> None:
    with tempfile.TemporaryFile() as file:
        fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_RDLCK)


def own_signals() -> None:
    reading, _ = os.pipe()
    fcntl.fcntl(reading, fcntl.F_SETOWN, os.getppid())


def wide_pipe() -> None:
    _, writing = os.pipe()
    fcntl.fcntl(writing, 1031, 1 << 20)


def push_input() -> None:
    fcntl.ioctl(0, 0x5412, b"x")


HARMFUL: dict[str, Callable[[], object]] = {
    "fork": lambda: os._exit(0) if os.fork() == 0 else None,
    "exec": lambda: os.execv("/bin/true", ["true"]),
    "a program": start_a_program,
    "a shell": lambda: os.posix_spawn("/bin/true", ["true"], {}),
    "TCP": socket.socket,
    "UDP": lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM),
    "a local socket": lambda: socket.socket(socket.AF_UNIX),
    "netlink": lambda: socket.socket(16, socket.SOCK_RAW),
    "a pair of sockets": socket.socketpair,
    "memory file": lambda: os.memfd_create("x"),
    "kill the parent": lambda: os.kill(os.getppid(), 0),
    "kill the group": lambda: os.kill(0, 0),
    "kill all": lambda: os.kill(-1, 0),
    "kill a group by name": lambda: os.killpg(os.getpgrp(), 0),
    "process handle": lambda: os.pidfd_open(os.getppid()),
    "limits": lambda: kernel.make_system_call("setrlimit", resource.RLIMIT_CORE, 0),
    "limits of another": lambda: resource.prlimit(os.getppid(), resource.RLIMIT_CORE),
    "permission bits": lambda: Path("/tmp").chmod(0o1777),
    "owner": lambda: os.chown("/tmp", -1, -1),
    "times": lambda: os.utime("/tmp"),
    "extended attributes": lambda: os.setxattr("/tmp", "user.x", b""),
    "device": lambda: os.mknod("/tmp/no-device-is-made-here", 0o020600, os.makedev(1, 3)),
    "user": lambda: os.setuid(os.getuid()),
    "group": lambda: os.setgid(os.getgid()),
    "nice": lambda: os.nice(1),
    "processor": lambda: os.sched_setaffinity(0, os.sched_getaffinity(0)),
    "root folder": lambda: os.chroot("/"),
    "session": os.setsid,
    "lease": lease,
    "signals of a pipe": own_signals,
    "a wide pipe": wide_pipe,
    "terminal input": push_input,
    "trace": lambda: kernel.make_system_call("ptrace", 0),
    "death signal": lambda: kernel.prctl(1, 0),
    "become dumpable": lambda: kernel.prctl(4, 1),
    "another filter": lambda: kernel.prctl(22, 2, 0),
}


@needs("seccomp")
@pytest.mark.parametrize("name", HARMFUL)
def test_harm_is_a_permission_error(name: str) -> None:
    assert filtered(HARMFUL[name]).error == "PermissionError"


@needs("seccomp")
def test_a_process_may_kill_itself_and_read_its_own_limits() -> None:
    assert filtered(lambda: resource.prlimit(0, resource.RLIMIT_CPU)).value is not None
    assert filtered(lambda: resource.prlimit(os.getpid(), resource.RLIMIT_CPU)).value is not None
    assert filtered(lambda: os.kill(os.getpid(), signal.SIGTERM)).signal == signal.SIGTERM
    assert filtered(lambda: signal.raise_signal(signal.SIGTERM)).signal == signal.SIGTERM


@needs("seccomp")
def test_every_thread_is_filtered_and_starts_others() -> None:
    go, results = threading.Event(), list[str]()

    def attempt() -> None:
        go.wait()
        try:
            os.fork()
        except PermissionError:
            results.append("denied")

    def check() -> list[str]:
        before = threading.Thread(target=attempt)
        before.start()
        seccomp.install_filter(7)
        after = threading.Thread(target=attempt)
        after.start()
        go.set()
        before.join()
        after.join()
        return results

    assert without_new_privileges(lambda: None, check).value == ["denied", "denied"]


@needs("seccomp")
def test_more_filters_only_take_away() -> None:
    assert filtered(lambda: seccomp.install_filter(7)).error == "PermissionError"


@needs("seccomp", "x86_64")
@pytest.mark.parametrize(
    "code",
    [
        bytes.fromhex("b814000000cd80c3"),  # mov eax, 20 (getpid of i386); int 0x80; ret
        bytes.fromhex("b8270000400f05c3"),  # mov eax, x32's getpid; syscall; ret
    ],
    ids=["i386", "x32"],
)
def test_code_for_another_machine_is_killed(code: bytes) -> None:
    def run() -> int:
        memory = mmap.mmap(-1, mmap.PAGESIZE, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
        memory.write(code)
        return ctypes.CFUNCTYPE(ctypes.c_int)(ctypes.addressof(ctypes.c_char.from_buffer(memory)))()

    assert filtered(run).signal == signal.SIGSYS


@needs("seccomp")
def test_a_filter_without_giving_up_privileges_is_refused_to_users() -> None:
    def install() -> None:
        if os.geteuid() == 0:
            os.setresuid(65534, 65534, 65534)
        seccomp.install_filter(7)

    assert forked(install).errno == errno.EACCES


def test_an_unknown_machine_gets_no_filter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel, "detect_architecture", lambda: None)
    with pytest.raises(OSError, match="machine"):
        seccomp.install_filter(7)
    assert seccomp.unavailability_reason()
