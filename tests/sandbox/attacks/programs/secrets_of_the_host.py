"""Reading what is not meant for the program: keys, other people's files, the memory of other processes."""

import contextlib
import ctypes
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from grs_agents.base.mujoco_import import mujoco
from tests.sandbox.attacks.kit import HIDDEN, UNKNOWN, World, call, check, gets, libc, succeeded

AT_FDCWD = -100


def read(path: str) -> dict[str, Callable[[], Any]]:
    """Every way to read a file."""

    def linked(link: Callable[[], Any], name: str) -> str:
        link()
        return Path(name).read_text()

    return {
        "open": lambda: Path(path).read_text(),
        "by the parent's root": lambda: Path(f"/proc/{os.getppid()}/root{path}").read_text(),
        "by the first process's root": lambda: Path(f"/proc/1/root{path}").read_text(),
        "by its own root": lambda: Path(f"/proc/self/root{path}").read_text(),
        "by symbolic link": lambda: linked(lambda: Path("soft").symlink_to(path), "soft"),
        "by hard link": lambda: linked(lambda: os.link(path, "hard"), "hard"),
        "by taking it": lambda: linked(lambda: Path(path).replace("taken"), "taken"),
        "by dots": lambda: Path(f"{'../' * 40}{path[1:]}").read_text(),
        "by its number": lambda: Path(f"/proc/self/fd/{os.open(path, os.O_PATH)}").read_text(),
        "openat2": lambda: os.read(
            call("openat2", AT_FDCWD, os.fsencode(path), (ctypes.c_uint64 * 3)(0, 0, 0), 24), 99
        ).decode(),
        "by C": lambda: libc.fopen(os.fsencode(path), b"r") or Path(path, "no file").stat(),
        "its attributes": lambda: os.listxattr(path) and path,
        "by its loader": lambda: _loaded(path),
    }


def _loaded(path: str) -> None:
    """The loader complains of what it read, or that it could not read."""
    try:
        ctypes.CDLL(path)
    except OSError as error:
        if "ELF" not in str(error) and "short" not in str(error):
            raise


@gets("nothing", cases={name: name for name in read("/")})
def files(world: World, name: str) -> list[str] | None:
    """Keys in the home folder, an ``.env`` in the working folder and beside the package, earlier runs."""
    return succeeded({path: read(path)[name] for path in world["files"]})


_SYSTEM = """
/etc/shadow /etc/gshadow /etc/sudoers /root/.bash_history /root/.ssh/id_rsa /proc/kcore
/etc/ssh/ssh_host_ed25519_key /proc/kallsyms /dev/mem /dev/vda /dev/sda /dev/kmsg /var/run/docker.sock
/proc/1/environ /proc/1/mem /proc/keys /sys/kernel/debug /boot /proc/sched_debug /proc/timer_list
/proc/vmallocinfo /proc/slabinfo /proc/kpagecount
"""
SYSTEM = _SYSTEM.split()


def first_byte(path: str) -> bytes:
    """Enough to show that one may read it; nothing of it is kept."""
    return os.read(os.open(path, os.O_RDONLY | os.O_NONBLOCK), 1)


@gets("nothing")
def files_of_the_system(world: World) -> list[str] | None:
    return succeeded({path: lambda path=path: first_byte(path) for path in SYSTEM})


@gets("nothing")
def files_of_the_repository(world: World) -> list[str] | None:
    """Whatever lies beside the package may hold keys: its history, the environment, the tests' configuration."""
    names = (".git/config", ".git/HEAD", ".env", "pyproject.toml", "Makefile", "tests/conftest.py", "README.md")
    return succeeded({name: Path(world["repository"], name).read_bytes for name in names})


@gets("nothing")
def names_of_files(world: World) -> list[str] | None:
    folders = (world["home"], world["work"], world["folder"], world["repository"], "/root", "/home", "/tmp", "/var/log")
    return succeeded({folder: lambda folder=folder: list(Path(folder).iterdir()) for folder in folders})


@gets("nothing")
def environment_of_others(world: World) -> list[str] | None:
    pids = {"parent": os.getppid(), "host": world["host"], "victim": world["victim"], "first": 1}
    return succeeded({name: lambda pid=pid: first_byte(f"/proc/{pid}/environ") for name, pid in pids.items()})


@gets("nothing")
def environment(world: World) -> list[str] | None:
    """Of this process: what Python shows, what C shows, what it was started with."""
    values = [*os.environ.values()]
    with contextlib.suppress(OSError):
        values.append(Path("/proc/self/environ").read_text())
    pointer = ctypes.POINTER(ctypes.c_char_p).in_dll(libc, "environ")
    for index in range(1000):
        value = pointer[index]
        if not value:
            break
        values.append(value.decode("utf-8", "replace"))
    return [value for value in values if "secret-" in value] or None


@gets("nothing")
def processes(world: World) -> list[str] | None:
    """Command lines of others carry paths and keys."""
    found = []
    for pid in (world["host"], world["victim"]):
        with contextlib.suppress(OSError):
            found.append(Path(f"/proc/{pid}/cmdline").read_text())
    with contextlib.suppress(OSError):
        found += [
            path.name for path in Path("/proc").iterdir() if path.name in (str(world["host"]), str(world["victim"]))
        ]
    return found or None


@gets("nothing", cases={name: name for name in ("mem", "maps", "auxv", "stack", "syscall", "wchan", "pagemap", "io")})
def memory_of_others(world: World, name: str) -> list[str] | None:
    pids = {"parent": os.getppid(), "host": world["host"], "victim": world["victim"], "first": 1}

    def look(pid: int) -> None:
        file = os.open(f"/proc/{pid}/{name}", os.O_RDONLY)
        if not os.pread(file, 64, world["secret_address"] if name == "mem" and pid == world["host"] else 0):
            raise OSError("empty")

    if name == "mem":  # opening is enough, what lies at address 0 is not readable anyway
        return succeeded({who: lambda pid=pid: os.open(f"/proc/{pid}/mem", os.O_RDWR) for who, pid in pids.items()})
    return succeeded({who: lambda pid=pid: look(pid) for who, pid in pids.items()})


class _Vector(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


@gets(*UNKNOWN, cases={"host": "host", "victim": "victim"})
def memory_by_system_call(world: World, who: str) -> str:
    buffer = ctypes.create_string_buffer(128)
    here = _Vector(ctypes.addressof(buffer), 128)
    there = _Vector(world["secret_address"] if who == "host" else id(world), 128)
    call("process_vm_readv", world[who], ctypes.byref(here), 1, ctypes.byref(there), 1, 0)
    return buffer.raw.decode("latin-1")


@gets(*UNKNOWN)
def memory_of_the_zygote(world: World) -> str:
    """It was forked from it, so that every address is known."""
    buffer = ctypes.create_string_buffer(64)
    here, there = _Vector(ctypes.addressof(buffer), 64), _Vector(id(os), 64)
    call("process_vm_readv", os.getppid(), ctypes.byref(here), 1, ctypes.byref(there), 1, 0)
    return buffer.raw.hex()


@gets("nothing")
def descriptors_of_others(world: World) -> list[str] | None:
    attempts: dict[str, Callable[[], Any]] = {}
    for name, pid in {"host": world["host"], "parent": os.getppid(), "victim": world["victim"]}.items():
        attempts[f"{name} list"] = lambda pid=pid: list(Path(f"/proc/{pid}/fd").iterdir())
        attempts[f"{name} open"] = lambda pid=pid: os.open(f"/proc/{pid}/fd/0", os.O_RDONLY | os.O_NONBLOCK)
        attempts[f"{name} working folder"] = lambda pid=pid: list(Path(f"/proc/{pid}/cwd/").iterdir())
    return succeeded(attempts)


@gets("nothing")
def its_own_descriptors(world: World) -> list[str] | None:
    """Nothing that was inherited can be read: not the request of another call, not a file of the host."""
    found = []
    for descriptor in range(256):
        with contextlib.suppress(OSError):
            os.set_blocking(descriptor, False)
            if data := os.read(descriptor, 64):
                found.append(f"{descriptor}: {data!r}")
    return found or None


@gets("ValueError")
def model_by_mujoco(world: World) -> str:
    """The engine's own parser follows file names out of any library."""
    text = f'<mujoco><include file="{world["model"]}"/></mujoco>'
    return mujoco.MjModel.from_xml_string(text).names.decode()


@gets("ValueError")
def mesh_by_mujoco(world: World) -> int:
    asset = f'<asset><mesh name="m" file="{world["mesh"]}"/></asset>'
    body = '<worldbody><geom type="mesh" mesh="m"/></worldbody>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{asset}{body}</mujoco>").nmeshvert


@gets("nothing", promised_by="bubblewrap")
def facts_about_files(world: World) -> list[str] | None:
    """Whether a file is there, and how large."""
    return succeeded({path: Path(path).stat for path in world["files"]})


@gets(*HIDDEN)
def kernel_messages(world: World) -> int:
    buffer = ctypes.create_string_buffer(4096)
    return check(libc.klogctl(3, buffer, 4096))
