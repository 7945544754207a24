"""Public reports of replies that were misread: what the product takes from each."""

from pathlib import Path

import pytest

from grs_agents.agents.reply import extract_python_program, read_json_rows
from grs_agents.agents.types import SegmentReply
from tests.cases.public_cases import copy_case

PROGRAM = "import numpy as np\nfrom grs_agents.sim import Task\n\n\nclass Wanted(Task):\n    pass\n"


def read(name: str, folder: Path) -> str:
    """The reply of a case, with the line ends that it has."""
    return (copy_case(name, folder) / "reply.txt").read_bytes().decode()


@pytest.mark.parametrize("name", ["reply_crlf", "reply_jsonl_tag", "reply_think_draft_json", "reply_think_unopened"])
def test_the_objects_of_a_reply(name: str, tmp_path: Path) -> None:
    [row] = read_json_rows(read(name, tmp_path), SegmentReply)
    reply = row.parsed
    assert reply is not None
    assert (reply.id, reply.is_object, reply.description, reply.open_top) == (1, True, "A box.", False)


@pytest.mark.parametrize("name", ["reply_example_after_program", "reply_python3_tag"])
def test_the_program_of_a_reply(name: str, tmp_path: Path) -> None:
    assert extract_python_program(read(name, tmp_path)) == PROGRAM
