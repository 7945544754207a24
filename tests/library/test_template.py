"""Filling templates."""

import pytest

from grs_agents.errors import InputError
from grs_agents.library import fill_template


def test_values_replace_placeholders_by_position() -> None:
    text = fill_template(
        "DIM0 DIM1 DIM2 HALF0 COLOR0 COLOR3", {"DIM": (1, 2, 3), "HALF": (9,), "COLOR": (0.5, 0, 0, 1)}
    )
    assert text == "1 2 3 9 0.5 1"


def test_half_and_inset_follow_from_dim() -> None:
    assert fill_template("HALF1 INSET0", {"DIM": (0.2, 0.3, 0.1)}) == "0.15 0.0975"


def test_defaults_fill_what_is_left_out() -> None:
    text = fill_template("DIM0 COLOR0 COLOR3", {"COLOR": (1, 0, 0)}, {"DIM": (0.4, 1, 1), "COLOR": (0, 0, 0, 0.5)})
    assert text == "0.4 1 0.5"


def test_a_placeholder_without_a_value_is_named() -> None:
    with pytest.raises(InputError, match="DIM2"):
        fill_template("DIM0 DIM1 DIM2", {"DIM": (1, 2)})


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "<!ENTITY", None])
def test_only_finite_numbers_fill_a_template(value: float) -> None:
    with pytest.raises(InputError, match="DIM0"):
        fill_template("DIM0", {"DIM": (value,)})
