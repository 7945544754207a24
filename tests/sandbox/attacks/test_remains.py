"""Nothing of one call is there in the next, whatever it did and however it ended."""

import inspect
from types import ModuleType

import pytest

from tests.sandbox.attacks import messages, pollution
from tests.sandbox.attacks.conftest import Door
from tests.sandbox.attacks.world import Canaries

ENDINGS = ("value = {'got': 1}", "os._exit(0)", "os.kill(os.getpid(), 9)", "1 / 0")


def functions(module: ModuleType) -> list[str]:
    """The public functions of a module that it does not import."""
    here = [
        name
        for name, thing in vars(module).items()
        if inspect.isfunction(thing) and thing.__module__ == module.__name__
    ]
    return [name for name in here if not name.startswith("_") and name != "every_descriptor"]


@pytest.mark.parametrize("name", functions(pollution))
def test_the_next_call_is_clean(name: str, door: Door, watched: Canaries) -> None:
    source = inspect.getsource(pollution)
    look = f"{source}\nvalue = {{'got': {name}(False)}}"
    before = door.execute(look)
    assert before.outcome == "ok", before.error
    polluting = door.execute(f"{source}\n{name}(True)\n{ENDINGS[len(name) % len(ENDINGS)]}")
    assert polluting.outcome in ("ok", "crashed", "error"), polluting
    after = door.execute(look)
    assert (after.outcome, after.value, after.output) == ("ok", before.value, before.output), after.error


@pytest.mark.parametrize("name", functions(messages))
def test_a_message_to_the_next_call_does_not_arrive(name: str, door: Door, watched: Canaries) -> None:
    source, token = inspect.getsource(messages), watched.token
    arguments = f"{token!r}, {watched.world['key']}"
    look = f"{source}\nvalue = {{'got': {name}(False, {arguments})}}"
    before = door.execute(look)
    assert before.outcome == "ok", before.error
    door.execute(f"{source}\n{name}(True, {arguments})\nvalue = {{}}")
    after = door.execute(look)
    assert (after.outcome, after.value) == ("ok", before.value), after.error


def test_descriptors_are_the_same_in_every_call(door: Door) -> None:
    look = (
        "import os\nfound = []\nfor n in range(256):\n"
        "    try: found.append([n, os.fstat(n).st_mode])\n    except OSError: pass\nvalue = {'got': found}"
    )
    calls = [door.execute(look) for _ in range(3)]
    assert calls[0].value == calls[1].value == calls[2].value


def test_a_folder_that_cannot_be_entered_costs_nobody_else_anything(door: Door, watched: Canaries) -> None:
    door.execute("import os\nos.makedirs('a/b')\nopen('a/b/c', 'w')\nfor name in ('a/b', 'a', '.'): os.chmod(name, 0)")
    result = door.execute("import os; open('file', 'w').write('x'); value = {'got': sorted(os.listdir('.'))}")
    assert result.value == {"got": ["file"]}


def test_space_is_given_back(door: Door, watched: Canaries) -> None:
    """Five calls that each fill a good part of what one may have, then leave it."""
    fill = "for n in range(20): open(f'file{n}', 'wb').write(bytes(1 << 20))\nvalue = {'got': 'written'}"
    calls = [door.execute(fill) for _ in range(5)]
    assert [call.value for call in calls] == [{"got": "written"}] * 5, calls[-1].error


def test_folders_nested_by_the_thousand_end_the_call_and_are_gone_in_the_next(door: Door, watched: Canaries) -> None:
    nested = door.execute("import os\nfor _ in range(12_000): os.mkdir('d'); os.chdir('d')\nvalue = {'got': 1}")
    assert nested.outcome == "scratch_limit"
    assert "each entry counts 64 KiB" in nested.error
    after = door.execute("import os; value = {'got': os.listdir('.')}")
    assert (after.outcome, after.value, after.retried) == ("ok", {"got": []}, False)
