"""Instructions of its own, which no library sees; each is tried on this machine's own process alone."""

import ctypes
import mmap
from collections.abc import Callable

from tests.sandbox.attacks.kit import REFUSED, World, gets, numbered

KILLED = ("crashed by SIGSYS", "crashed by SIGSEGV")
X32 = 0x40000000


def run(code: bytes) -> int:
    """What a function of these instructions returns."""
    page = mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
    page.write(code)
    address = ctypes.addressof(ctypes.c_char.from_buffer(page))
    function: Callable[[], int] = ctypes.CFUNCTYPE(ctypes.c_long)(address)
    return function()


def number(value: int) -> bytes:
    """``mov eax, value``."""
    return b"\xb8" + value.to_bytes(4, "little")


OLD_CALLS = {"getpid": 20, "time": 13, "umask": 60, "socketcall": 102, "ipc": 117, "getppid": 64}


@gets(*KILLED, cases=OLD_CALLS, machine="x86_64")
def call_of_32_bits(world: World, call: int) -> int:
    """``int 0x80``: the same kernel by other numbers, which a filter for 64 bits takes for other calls."""
    return run(b"\x53\x31\xdb\x31\xc9\x31\xd2" + number(call) + b"\xcd\x80\x5b\xc3")


@gets(*KILLED, machine="x86_64")
def code_of_32_bits(world: World) -> int:
    """A far jump into the segment of 32-bit programs, and ``int 0x80`` there."""
    page = mmap.mmap(
        -1, 4096, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | 0x40, mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC
    )
    address = ctypes.addressof(ctypes.c_char.from_buffer(page))
    page[128:] = (number(20) + b"\xcd\x80\xeb\xfe").ljust(4096 - 128, b"\x90")
    page[:15] = b"\x6a\x23" + b"\x68" + (address + 128).to_bytes(4, "little") + b"\x48\xcb".ljust(8, b"\x90")
    function: Callable[[], int] = ctypes.CFUNCTYPE(ctypes.c_long)(address)
    return function()


@gets(*REFUSED, cases={"getpid": 39, "fork": 57, "socket": 41, "ptrace": 521, "execve": 520}, machine="x86_64")
def call_of_x32(world: World, call: int) -> int:
    return numbered(X32 | call, 0, 0, 0)


@gets(*REFUSED, machine="x86_64")
def own_instruction(world: World) -> int:
    """``fork`` by an instruction on a page of its own."""
    return _named(
        run(b"\x48" + b"\xc7\xc0" + (57).to_bytes(4, "little") + b"\x0f\x05\x85\xc0\x75\x09" + EXIT + b"\xc3")
    )


EXIT = b"\x31\xff" + number(60) + b"\x0f\x05"


def _named(result: int) -> int:
    if result < 0:
        raise OSError(-result, "refused")
    return result


@gets("crashed by SIGILL", machine="x86_64")
def undefined_instruction(world: World) -> int:
    return run(b"\x0f\x0b")


@gets("nothing", machine="x86_64")
def speculation(world: World) -> None:
    """Reading the clock of the processor is no escape, and does not end the worker."""
    run(b"\x0f\x31\xc3")
