"""What an engine does with ``docker run`` and ``docker kill``, done by bubblewrap: an unknown option is an error.

As with Docker, a container outlives its client, the environment holds what the image sets, and a container that ended
is removed. Limits on processes and memory are read and not kept.
"""

import argparse
import csv
import os
import signal
import subprocess
import sys
from pathlib import Path

CONTAINERS = Path(__file__).parent / "containers"
IMAGES = ("debian:stable-slim",)


def main() -> int:
    """The exit status of the client."""
    verb, *arguments = sys.argv[1:]
    if verb == "kill":
        os.killpg(int((CONTAINERS / arguments[0]).read_text()), signal.SIGKILL)
        return 0
    assert verb == "run", verb
    parser = argparse.ArgumentParser(allow_abbrev=False)
    for flag in ("--rm", "--read-only"):
        parser.add_argument(flag, action="store_true", required=True)
    for name in ("name", "network", "ipc", "hostname", "workdir", "cap-drop", "security-opt", "user", "entrypoint"):
        parser.add_argument(f"--{name}", required=True)
    for name in ("pull", "memory", "memory-swap", "pids-limit"):
        parser.add_argument(f"--{name}", required=True)
    for name in ("env", "mount", "tmpfs"):
        parser.add_argument(f"--{name}", action="append", default=[])
    parser.add_argument("image")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    return run(parser.parse_args(arguments))


def run(asked: argparse.Namespace) -> int:
    """Start the container and wait for its end."""
    if asked.image not in IMAGES:
        print(f"docker: Error response from daemon: No such image: {asked.image}", file=sys.stderr)
        print("\nRun 'docker run --help' for more information", file=sys.stderr)
        return 125
    assert (asked.network, asked.ipc, asked.cap_drop, asked.entrypoint) == ("none", "none", "ALL", "")
    assert (asked.pull, asked.security_opt) == ("never", "no-new-privileges")
    assert int(asked.pids_limit) > 0 and int(asked.memory.removesuffix("m")) > 0 and asked.memory == asked.memory_swap
    CONTAINERS.mkdir(exist_ok=True)
    process = subprocess.Popen([*confinement(asked), *asked.command], start_new_session=True)
    record = CONTAINERS / asked.name
    record.write_text(str(process.pid))
    status = process.wait()
    record.unlink()
    return status


def confinement(asked: argparse.Namespace) -> list[str]:
    """The command line of bubblewrap."""
    user, group = asked.user.split(":")
    command = ["bwrap", "--unshare-all", "--unshare-user", "--uid", user, "--gid", group, "--cap-drop", "ALL"]
    command += ["--hostname", asked.hostname, "--clearenv"]
    for variable in ("PATH=/usr/bin", f"HOSTNAME={asked.hostname}", "HOME=/", *asked.env):
        command += ["--setenv", *variable.split("=", 1)]
    for row in csv.reader(asked.mount):
        assert row[0] == "type=bind" and row[3] == "readonly", row
        command += ["--ro-bind", row[1].removeprefix("source="), row[2].removeprefix("target=")]
    command += ["--proc", "/proc", "--dev", "/dev"]
    for entry in asked.tmpfs:
        folder, _, text = entry.partition(":")
        options = dict(option.partition("=")[::2] for option in text.split(","))
        assert (options["uid"], options["gid"]) == (user, group)
        command += ["--perms", options["mode"], "--size", options["size"], "--tmpfs", folder]
    return [*command, "--remount-ro", "/", "--chdir", asked.workdir]


if __name__ == "__main__":
    sys.exit(main())
