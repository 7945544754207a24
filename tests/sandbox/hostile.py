"""Programs that write what no harness would write, to everything that the host reads from a child.

Frames carry a valid seal, since a program can find the key of its call: it is what the host makes of them that counts.
"""

import random
import zlib
from dataclasses import dataclass

TESTS = """
import unittest
import task_code
class TestX(unittest.TestCase):
    def test_a(self):
        task_code.act()
        self.assertEqual(1, 1)
    def test_b(self):
        self.assertEqual(1, 1)
"""
_PROGRAM = """
import os, signal, zlib
from grs_agents.sandbox.harness import channel; from grs_agents.sandbox.protocol import wire
from grs_agents.sim import Task

def _send(descriptor, data):
    while data:
        data = data[os.write(descriptor, data):]

def _sealed(body):
    sender = channel._sender[0]
    cells = dict(zip(sender.__code__.co_freevars, (cell.cell_contents for cell in sender.__closure__)))
    _send(3, wire.sign_frame(bytes(4) + body, cells["secret"], next(cells["numbers"])))

def act():
    pass

class T(Task):
    pass

def _attack():
{attack}

{when}
"""
_NAMES = ("0", "1", "TestX.test_a", "TestX.test_b", "TestX.test_c", "", "../x", "\x1b[2J", "0" * 5000)
_FIELDS = (
    "outcome",
    "message",
    "traceback",
    "output",
    "raised_in",
    "assertions",
    "episode",
    "seconds",
    "line",
    "instance",
    "id",
    "item",
    "phase",
    "kind",
)
_ATOMS = (
    "null",
    "true",
    "-1",
    "0",
    "1e999",
    "1e308",
    "NaN",
    "-Infinity",
    "9" * 5000,
    "9" * 30,
    "-" + "9" * 19,
    '"\\ud800"',
    '"\\u0000\\u001b[2J"',
    '"passed"',
    '"error"',
    '"simulation"',
    '"tests"',
    "[]",
    "{}",
    "[" * 60 + "]" * 60,
    "[" * 300 + "]" * 300,
    "[" * 900 + "]" * 900,
    "[" * 100_000,
    '{"a":' * 300 + "1" + "}" * 300,
    "[" + "[]," * 100_000 + "[]]",
    "[" + "{}," * 1_000_000 + "{}]",
    '"' + "x" * 2_000_000 + '"',
    '"' + "\U0001f600" * 300_000 + '"',
    '{"a": 1, "a": 2}',
    '{"outcome": [], "reward": "\\u001b", "steps": {}}',
    '{"outcome": "' + "x" * 500_000 + '", "detail": [1, [2]], "objects": 3}',
    '"{\\"task\\": \\"T\\", \\"seed\\": 0, \\"objects\\": [], \\"goals\\": []}"',
)
_TRACES = (
    'File "task_code.py", line {} in reset',
    'File "test_task_code.py", line {} in test_a',
    "Fatal Python error: {}",
    'File "{}", line 1 in f',
    'File "task_code.py", line 1 in {}',
    "\n\n{}\n \n",
    "Thread 0x1 (most recent call first):",
)
_BLANKS = ("9" * 5000, "0", "-1", "9" * 12, "٣" * 400, "x" * 60_000, "\x00\x1b[2J", " \n" * 20_000, '"' * 900)
_SCRATCH = (
    "os.unlink('task_code.py')",
    "os.mkfifo('fifo')",
    "os.symlink('/dev/zero', 'zero')",
    "os.mkdir('task_code')",
    "open('\\udcff' * 60, 'w').close()",
    "os.truncate('task_code.py', 1 << 20)",
    "os.makedirs('/'.join('abcdefgh' * 8))",
    "os.chmod('.', 0)",
    "os.symlink('.', 'loop')",
)
_ENDINGS = (
    "pass",
    "pass",
    "pass",
    "os.abort()",
    "os._exit(0)",
    "os._exit(7)",
    "os.kill(os.getpid(), signal.SIGXCPU)",
    "raise ValueError('\\ud800' * 9)",
    "raise SystemExit",
    "raise MemoryError",
    "os.close(3)",
    "os.close(4)",
    "os.close(1)",
)


@dataclass(frozen=True)
class Hostile:
    """A program and how many hostile messages it writes."""

    source: str
    messages: int


def hostile(seed: int) -> Hostile:
    """The program of ``seed``: up to six messages, then an ending."""
    rng = random.Random(seed)
    messages = [rng.choice((_frame, _frame, _frame, _trace, _bytes, _print, _scratch))(rng) for _ in range(6)]
    attack = [f"    {line}" for line in (*messages, rng.choice(_ENDINGS))]
    when = rng.choice(("_attack()", "act = _attack", "T.reset = lambda self, env: _attack()"))
    return Hostile(_PROGRAM.format(attack="\n".join(attack), when=when), len(messages))


def _frame(rng: random.Random) -> str:
    """A sealed frame: an event, a result or an error with random fields, some of them mutated as bytes."""
    phase = rng.choice(('"start"', '"end"', *_ATOMS))
    fields = {"item": f'"{rng.choice(_NAMES)}"'.replace("\x1b", "\\u001b"), "phase": phase}
    for _ in range(rng.randrange(4)):
        fields[rng.choice(_FIELDS)] = rng.choice(_ATOMS)
    inner = "{" + ", ".join(f'"{name}": {value}' for name, value in fields.items()) + "}"
    kind = rng.choice(("event", "event", "event", "result", "error", "ready", "x"))
    body = f'{{"kind": "{kind}", "event": {inner}, "outcome": {rng.choice(_ATOMS)}}}'
    if kind == "result":
        loaded = f'{{"kind": {rng.choice(_ATOMS)}, "message": "", "traceback": "", "raised_in": {rng.choice(_ATOMS)}}}'
        body = f'{{"kind": "result", "value": {{"load_error": {loaded}, "found": {rng.choice(_ATOMS)}}}}}'
    if kind == "error":
        body = f'{{"kind": "error", "outcome": "error", "error": {rng.choice(_ATOMS)}}}'
    data = bytearray(body.encode())
    if rng.random() < 0.2:
        data[rng.randrange(len(data))] = rng.randrange(256)
    return f"_sealed({_literal(bytes(data))})"


def _trace(rng: random.Random) -> str:
    lines = [f"  {rng.choice(_TRACES).format(rng.choice(_BLANKS))}" for _ in range(rng.randrange(1, 6))]
    return f"_send(4, {_literal(chr(10).join([*lines, '']).encode())})"


def _bytes(rng: random.Random) -> str:
    """Bytes without a seal on the pipe of the frames."""
    return f"_send(3, {rng.randbytes(rng.choice((1, 4, 40, 4000)))!r})"


def _print(rng: random.Random) -> str:
    return f"_send(1, {rng.randbytes(rng.choice((1, 100, 100_000)))[:200]!r} * {rng.choice((1, 100, 9000))})"


def _scratch(rng: random.Random) -> str:
    return rng.choice(_SCRATCH)


def _literal(data: bytes) -> str:
    """An expression for ``data``, compressed: a program has at most a million characters."""
    return f"zlib.decompress({zlib.compress(data)!r})"
