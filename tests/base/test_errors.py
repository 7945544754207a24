"""Errors are one line that names the value, the bound and the remedy."""

import pickle

from hypothesis import given
from hypothesis import strategies as st

from grs_agents.base.errors import ConfigError, GrsError, InputError, UnknownNameError


def test_message_and_remedy_make_one_line() -> None:
    error = GrsError("depth.png is\n 3 x 4", "give\tone of 480 x 640")
    assert str(error) == "depth.png is 3 x 4; give one of 480 x 640"
    assert (error.message, error.remedy) == ("depth.png is 3 x 4", "give one of 480 x 640")


def test_without_a_remedy_the_message_stands_alone() -> None:
    assert str(GrsError("the disk is full")) == "the disk is full"


def test_exit_status_tells_whose_fault_it_is() -> None:
    assert GrsError("").exit_status == 3
    assert [kind.exit_status for kind in (InputError, ConfigError, UnknownNameError)] == [2, 2, 2]


def test_an_unknown_name_lists_the_nearest_first() -> None:
    error = UnknownNameError("tool", "segment_rgb", ["rollout", "segment_rgbd", "instantiate"])
    assert (
        str(error)
        == "unknown tool 'segment_rgb'; did you mean segment_rgbd? use one of: segment_rgbd, instantiate, rollout"
    )
    assert error.valid == ("instantiate", "rollout", "segment_rgbd")


def test_an_unknown_name_among_none_says_so() -> None:
    assert "(none)" in str(UnknownNameError("eval", "table", []))


@given(st.text(), st.lists(st.text(alphabet="abcd_0"), max_size=100))
def test_a_long_list_of_names_is_cut_and_counted(name: str, valid: list[str]) -> None:
    error = UnknownNameError("asset", name, valid)
    many = len(set(valid)) > 20
    assert error.remedy.endswith(f" and {len(set(valid)) - 5} more") is many
    assert "\n" not in str(error)


def test_errors_pass_between_processes_as_they_are() -> None:
    error = UnknownNameError("robot", "ur5", ["ur5e", "panda"])
    copied = pickle.loads(pickle.dumps(error))
    assert (type(copied), str(copied), vars(copied)) == (UnknownNameError, str(error), vars(error))
