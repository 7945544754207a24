"""System calls that a process may make, enforced by the kernel's seccomp filter.

An allow-list of the calls of CPython, numpy and MuJoCo with software rendering. Known dangerous calls fail with EPERM,
so that Python raises ``PermissionError``; all others fail with ENOSYS, as on an older kernel. Calls made for another
machine (32-bit, x32) kill the process. The kernel works out ahead of time which calls pass whatever their arguments,
and does not run the filter for these.

The filter is classic BPF, written as a tree of decisions: it reads a 32-bit word of ``struct seccomp_data`` at a time,
compares it, and ends in an action. Every branch ends in its own action, so no jump needs a label.
"""

import ctypes
import errno
import os
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache, reduce

from grs_agents.sandbox.isolation import kernel
from grs_agents.sandbox.isolation.kernel import NUMBERS

_LOAD, _GO, _RETURN = 0x20, 0x05, 0x06
_EQUAL, _AT_LEAST, _ANY_BIT = 0x15, 0x35, 0x45
_INSTRUCTION, _OPERAND = struct.Struct("=HBBI"), 4
_FARTHEST = 255
"""Longest jump of a comparison: its offsets are bytes."""

NUMBER, ARCHITECTURE = 0, 4
"""Offsets of the call number and the architecture in ``struct seccomp_data``."""


@dataclass(frozen=True)
class FilterAction:
    """Leaf of the tree: the action for the call."""

    action: int


@dataclass(frozen=True)
class Load:
    """Read the word at a byte offset, then go on."""

    offset: int
    then: "Node"


@dataclass(frozen=True)
class Branch:
    """Compare the last word read, and take a branch."""

    comparison: int
    value: int
    then: "Node"
    otherwise: "Node"


Node = FilterAction | Load | Branch
Instruction = tuple[int, int, int, int]
"""Operation, jump if true, jump if false, operand."""


def load_argument_low_half(index: int, then: Node) -> Load:
    """Read the lower half of an argument (little endian); complete for arguments that the kernel takes as ``int``."""
    return Load(16 + 8 * index, then)


def load_argument_high_half(index: int, then: Node) -> Load:
    """Read the upper half of an argument."""
    return Load(20 + 8 * index, then)


def branch_if_equal(value: int, then: Node, otherwise: Node) -> Branch:
    """Branch on equality with ``value``."""
    return Branch(_EQUAL, value, then, otherwise)


def branch_if_at_least(value: int, then: Node, otherwise: Node) -> Branch:
    """Branch on the unsigned word being ``value`` or more."""
    return Branch(_AT_LEAST, value, then, otherwise)


def branch_if_any_bit(mask: int, then: Node, otherwise: Node) -> Branch:
    """Branch on any bit of ``mask`` being set."""
    return Branch(_ANY_BIT, mask, then, otherwise)


def branch_if_one_of(values: Iterable[int], then: Node, otherwise: Node) -> Node:
    """Branch on membership in ``values``."""
    return reduce(lambda rest, value: branch_if_equal(value, then, rest), sorted(values, reverse=True), otherwise)


def branch_by_range(starts: Sequence[tuple[int, Node]]) -> Node:
    """Find the last start, in rising order, that the word reaches, by halving: 200 starts cost 8 comparisons."""
    if len(starts) == 1:
        return starts[0][1]
    middle = len(starts) // 2
    return branch_if_at_least(starts[middle][0], branch_by_range(starts[middle:]), branch_by_range(starts[:middle]))


def assemble_instructions(node: Node) -> list[Instruction]:
    """Lay the tree out as instructions."""
    if isinstance(node, FilterAction):
        return [(_RETURN, 0, 0, node.action)]
    if isinstance(node, Load):
        return [(_LOAD, 0, 0, node.offset), *assemble_instructions(node.then)]
    then, otherwise = assemble_instructions(node.then), assemble_instructions(node.otherwise)
    if len(then) <= _FARTHEST:
        return [(node.comparison, 0, len(then), node.value), *then, *otherwise]
    return [(node.comparison, 1, 0, node.value), (_GO, 0, 0, len(then)), *then, *otherwise]


def encode_instructions(program: Iterable[Instruction]) -> bytes:
    """The program as the kernel reads it: an array of ``struct sock_filter``."""
    return b"".join(_INSTRUCTION.pack(*instruction) for instruction in program)


def find_operand_offsets(program: Iterable[Instruction], operand: int) -> tuple[int, ...]:
    """Byte offsets of ``operand`` in the encoded program, for replacing it there (``struct``'s ``=I``)."""
    numbers = (number for number, instruction in enumerate(program) if instruction[-1] == operand)
    return tuple(number * _INSTRUCTION.size + _OPERAND for number in numbers)


ALLOW = FilterAction(0x7FFF_0000)
DENY = FilterAction(0x0005_0000 | errno.EPERM)
UNKNOWN = FilterAction(0x0005_0000 | errno.ENOSYS)
KILL = FilterAction(0x8000_0000)

_ARCHITECTURES = {"x86_64": 0xC000_003E, "aarch64": 0xC000_00B7}
_X32 = 0x4000_0000
"""Numbers from here on belong to x32, which shares its architecture with x86-64."""

ALLOWED = """
read write readv writev pread64 pwrite64 preadv pwritev preadv2 pwritev2 sendfile copy_file_range
open openat creat close close_range lseek dup dup2 dup3 pipe pipe2 flock fsync fdatasync fadvise64 readahead
stat fstat lstat newfstatat statx statfs fstatfs access faccessat faccessat2 readlink readlinkat
getdents getdents64 getcwd chdir fchdir umask ftruncate truncate
mkdir mkdirat rmdir unlink unlinkat rename renameat renameat2 link linkat symlink symlinkat
poll ppoll select pselect6 epoll_create epoll_create1 epoll_ctl epoll_wait epoll_pwait epoll_pwait2
eventfd eventfd2
brk mmap munmap mprotect mremap madvise msync membarrier
futex set_robust_list set_tid_address rseq arch_prctl exit exit_group restart_syscall
rt_sigaction rt_sigprocmask rt_sigreturn rt_sigpending rt_sigsuspend rt_sigtimedwait sigaltstack pause
alarm getitimer setitimer nanosleep clock_nanosleep clock_gettime clock_getres gettimeofday time times
getpid gettid getppid getpgrp getpgid getsid getuid geteuid getgid getegid getresuid getresgid getgroups capget
getpriority getrlimit getrusage sysinfo uname getcpu getrandom wait4 waitid
sched_yield sched_getaffinity sched_getparam sched_getscheduler sched_getattr sched_rr_get_interval
sched_get_priority_max sched_get_priority_min
landlock_create_ruleset landlock_add_rule landlock_restrict_self
"""

DENIED = """
fork vfork execve execveat unshare setns setsid setpgid ptrace process_vm_readv process_vm_writev process_madvise
process_mrelease kcmp pidfd_open pidfd_getfd pidfd_send_signal
socket socketpair connect bind listen accept accept4 shutdown getsockname getpeername setsockopt getsockopt
sendto recvfrom sendmsg recvmsg sendmmsg recvmmsg
memfd_create memfd_secret shmget shmat shmctl shmdt msgget msgsnd msgrcv msgctl semget semop semctl semtimedop
mq_open mq_unlink mq_timedsend mq_timedreceive mq_notify mq_getsetattr
io_setup io_submit io_uring_setup io_uring_enter io_uring_register
bpf perf_event_open userfaultfd seccomp personality modify_ldt iopl ioperm
mount umount2 pivot_root chroot open_tree open_tree_attr move_mount fsopen fsconfig fsmount fspick mount_setattr
add_key request_key keyctl init_module finit_module delete_module create_module kexec_load kexec_file_load reboot
swapon swapoff acct quotactl quotactl_fd syslog vhangup
settimeofday clock_settime clock_adjtime adjtimex sethostname setdomainname
mknod mknodat name_to_handle_at open_by_handle_at fanotify_init fanotify_mark
chmod fchmod fchmodat fchmodat2 chown fchown lchown fchownat utime utimes utimensat futimesat file_setattr
setxattr lsetxattr fsetxattr setxattrat getxattr lgetxattr fgetxattr getxattrat listxattr llistxattr flistxattr
listxattrat removexattr lremovexattr fremovexattr removexattrat
setuid setgid setreuid setregid setresuid setresgid setfsuid setfsgid setgroups capset
setrlimit setpriority sched_setaffinity sched_setparam sched_setscheduler sched_setattr ioprio_set
mlock mlock2 mlockall move_pages migrate_pages
"""

_CLONE_THREAD = 0x0001_0000
_NEW_NAMESPACES = 0x7E02_0000
_CONTROLS = {0x5401, 0x802C_542A, 0x540F, 0x5413, 0x541B, 0x5421, 0x5450, 0x5451}
"""Allowed requests of ioctl: TCGETS, TCGETS2, TIOCGPGRP, TIOCGWINSZ, FIONREAD, FIONBIO, FIONCLEX, FIOCLEX."""
_FILE_COMMANDS = {0, 1, 2, 3, 4, 5, 6, 7, 9, 11, 36, 37, 38, 1025, 1027, 1030, 1032, 1034}
"""Allowed commands of fcntl: duplicate, flags, locks, and reading owner, signal, lease, pipe size and seals."""
_SET_PIPE_SIZE, _PIPE_SIZE = 1031, 1 << 16
_PROPERTIES = {2, 3, 7, 15, 16, 21, 23, 25, 27, 30, 39, 42, 51, 52, 64, 0x4155_5856, 0x5356_4D41}
"""Allowed options of prctl: naming a thread or a mapping, and harmless reads."""
_TRUNCATE = 0x200
_NAMELESS = 0o20000000
"""``O_TMPFILE`` without the bit that it shares with ``O_DIRECTORY``."""
_ANY_PID = 0xFFFF_FFFF
"""Placeholder for the process's id until it is known; no process has it."""
_SET_FILTER, _GET_ACTION_AVAILABLE, _ALL_THREADS = 1, 2, 1


def unavailability_reason() -> str:
    """Reason why this kernel takes no filter; empty if it does."""
    kill = ctypes.c_uint32(KILL.action)
    try:
        kernel.make_system_call("seccomp", _GET_ACTION_AVAILABLE, 0, ctypes.addressof(kill))
    except OSError as error:
        return f"the kernel takes no filter which kills a process, it came with Linux 4.14: {error.strerror}"
    return ""


def install_filter(landlock_abi: int) -> None:
    """Filter the system calls of this process, all its threads included, irrevocably. Landlock below version 3 leaves
    truncation free, which is denied here then. ``OSError`` if the kernel took no filter, or the process may still gain
    privileges."""
    machine = kernel.detect_architecture()
    if machine is None:
        raise OSError(errno.ENOSYS, "the system calls of this machine are not known")
    program, places_of_pid = compile_filter(machine, landlock_abi)
    instructions = ctypes.create_string_buffer(program, len(program))
    for place in places_of_pid:
        struct.pack_into("=I", instructions, place, os.getpid())
    header = ctypes.create_string_buffer(struct.pack("HxxxxxxQ", len(program) // 8, ctypes.addressof(instructions)))
    if thread := kernel.make_system_call("seccomp", _SET_FILTER, _ALL_THREADS, ctypes.addressof(header)):
        raise OSError(errno.EBUSY, f"thread {thread} has a filter of its own")


@cache
def compile_filter(machine: kernel.Machine, landlock_abi: int) -> tuple[bytes, tuple[int, ...]]:
    """The filter, and the offsets of the process's id in it; call it before a fork, since it takes a millisecond."""
    program = assemble_instructions(build_policy_tree(machine, _ANY_PID, landlock_abi))
    return encode_instructions(program), find_operand_offsets(program, _ANY_PID)


def build_policy_tree(machine: kernel.Machine, pid: int, landlock_abi: int) -> Node:
    """The answer to every call that process ``pid`` could make, as a tree of decisions."""
    answers: dict[str, Node] = dict.fromkeys(ALLOWED.split(), ALLOW)
    answers |= dict.fromkeys(DENIED.split(), DENY)
    answers |= _build_argument_policies(pid, truncation=landlock_abi >= 3)
    numbered = {number: answers.get(name, UNKNOWN) for name, number in NUMBERS[machine].items()}
    starts: list[tuple[int, Node]] = []
    for number in range(max(numbered) + 2):
        answer = numbered.get(number, UNKNOWN)
        if not starts or starts[-1][1] != answer:
            starts.append((number, answer))
    by_number = Load(NUMBER, branch_by_range([*starts, (_X32, KILL)]))
    return Load(ARCHITECTURE, branch_if_equal(_ARCHITECTURES[machine], by_number, KILL))


def _build_argument_policies(pid: int, truncation: bool) -> dict[str, Node]:
    """The calls whose action depends on their arguments.
    The kernel takes these as ``int``, so that the lower half is all of them, but for pointers and a pipe's size.
    ``truncation``: Landlock guards truncation; else a file that is open for reading alone (access mode 0, or 3:
    neither) must not be truncated. Files without a name, which nothing outside can count, are denied."""
    flags: Node = ALLOW
    if not truncation:
        reading = branch_if_any_bit(_TRUNCATE, DENY, ALLOW)
        flags = branch_if_any_bit(1, branch_if_any_bit(2, reading, ALLOW), branch_if_any_bit(2, ALLOW, reading))
    flags = branch_if_any_bit(_NAMELESS, DENY, flags)
    oneself = load_argument_low_half(0, branch_if_equal(pid, ALLOW, DENY))
    null = load_argument_low_half(
        2, branch_if_equal(0, load_argument_high_half(2, branch_if_equal(0, ALLOW, DENY)), DENY)
    )
    own_or_caller = load_argument_low_half(0, branch_if_one_of((0, pid), null, DENY))
    thread = branch_if_any_bit(_CLONE_THREAD, branch_if_any_bit(_NEW_NAMESPACES, DENY, ALLOW), DENY)
    low_half = load_argument_low_half(2, branch_if_at_least(_PIPE_SIZE + 1, DENY, ALLOW))
    no_larger = load_argument_high_half(2, branch_if_equal(0, low_half, DENY))
    policies: dict[str, Node] = {
        "open": load_argument_low_half(1, flags),
        "openat": load_argument_low_half(2, flags),
        "clone": load_argument_low_half(0, thread),
        "clone3": UNKNOWN,  # its flags lie in memory, out of a filter's sight; the C library falls back to clone
        **dict.fromkeys(("kill", "tkill", "tgkill", "rt_sigqueueinfo", "rt_tgsigqueueinfo"), oneself),
        "prlimit64": own_or_caller,
        "fallocate": load_argument_low_half(
            1, branch_if_equal(0, ALLOW, DENY)
        ),  # its modes reserve space beyond the limit on file size
        "ioctl": load_argument_low_half(1, branch_if_one_of(_CONTROLS, ALLOW, DENY)),
        "fcntl": load_argument_low_half(
            1, branch_if_one_of(_FILE_COMMANDS, ALLOW, branch_if_equal(_SET_PIPE_SIZE, no_larger, DENY))
        ),
        "prctl": load_argument_low_half(0, branch_if_one_of(_PROPERTIES, ALLOW, DENY)),
    }
    return policies if truncation else {**policies, "truncate": DENY}
