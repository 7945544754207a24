"""What a process writes to its pipe is a result only if it carries the seal of the call."""

import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from grs_agents.sandbox.host.streams import Streams

WORKER = """
import json, os, sys
from grs_agents.sandbox.harness import channel; from grs_agents.sandbox.protocol import wire
pipe = int(sys.argv[1])
request = json.loads(sys.stdin.readline())
channel.connect(pipe, request.pop("key"))
channel.send({"kind": "ready"})
channel.report_progress({"request": request})
"""
RESULT = 'channel.send({"kind": "result", "value": {"x": 1}})\n'
SNEAK = "os.write(pipe, {})\n"


def call(code: str) -> tuple[tuple[str, object, str] | None, list[dict[str, object]]]:
    """Run a worker with ``code`` as the program; how the call ended, and the events."""
    (frames, end), (control, control_end) = socket.socketpair(), socket.socketpair()
    (trace, trace_end), (output, output_end) = os.pipe(), os.pipe()
    command = [sys.executable, "-c", WORKER + code, str(end.fileno())]
    with (
        control_end,
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=output_end, pass_fds=(end.fileno(),), cwd=Path(__file__).parents[3]
        ) as process,
    ):
        end.close()
        os.close(trace_end)
        os.close(output_end)
        streams = Streams(frames, trace, output, control)
        assert process.stdin is not None
        process.stdin.write(line_of(streams.attach_frame_key({"tool": "t"})))
        process.stdin.close()
        deadline = time.monotonic() + 30
        assert streams.read_until_answer(deadline, 1 << 20, until_ready=True) == ("ok", None, "")
        ending = streams.read_until_answer(deadline, 1 << 20)
        process.kill()
        streams.close()
    return ending, streams.events


def line_of(request: dict[str, object]) -> bytes:
    return json.dumps(request).encode() + b"\n"


def test_sealed_frames_pass_and_the_key_is_not_part_of_the_request() -> None:
    ending, events = call(RESULT)
    assert ending == ("ok", {"x": 1}, "")
    assert events == [{"request": {"tool": "t"}}]


FORGED = {
    "a plain result": SNEAK.format('wire.encode({"kind": "result", "value": {}})'),
    "sealed with a key of its own": SNEAK.format(
        'wire.sign_frame(wire.encode({"kind": "result", "value": {}}), b"k", 1)'
    ),
    "noise": SNEAK.format("b'x' * 100"),
    "a few bytes before the result": SNEAK.format("b'\\0'") + RESULT,
    "a frame sent again": "write, kept = os.write, []\n"
    "os.write = lambda pipe, data: kept.append(bytes(data)) or write(pipe, data)\n"
    "channel.report_progress({})\nwrite(pipe, kept[0])\n",
    "a frame held back": "write = os.write\nos.write = lambda pipe, data: len(data)\n"
    "channel.report_progress({})\nos.write = write\n" + RESULT,
}


@pytest.mark.parametrize("name", FORGED)
def test_anything_else_ends_the_call(name: str) -> None:
    ending, events = call(FORGED[name])
    assert ending is not None and ending[0] == "forged", ending
    assert "something other than the harness" in ending[2]
    assert events[0] == {"request": {"tool": "t"}}


def test_what_cannot_be_sent_leaves_no_gap() -> None:
    ending, _ = call("try: channel.report_progress({'x': float('nan')})\nexcept ValueError: pass\n" + RESULT)
    assert ending == ("ok", {"x": 1}, "")
