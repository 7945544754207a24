"""Filling templates."""

import numpy as np
import pytest

from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.library.urdf_templates import Values, fill_template, known_placeholder_stems, resolve_template_values

LIBRARY = Library()
SIZE = (0.06, 0.06, 0.1)
SPELLINGS = (
    {"DIM": SIZE},
    {"DIM": np.array(SIZE, dtype=np.float32)},
    {"HALF": (0.03, 0.03, 0.05)},
    {"DIM": SIZE, "HALF": np.array(SIZE) / 2},
    {"DIMX": 0.06, "DIMY": (0.06,), "DIMZ": np.float64(0.1)},
    {"DIMR": 0.03, "DIMH": 0.1},
    {"DIMR": (0.03,), "DIMH": (0.1,)},
    {"SCALE": SIZE},
    {"DIM": SIZE, "SCALE": (9, 9, 9), "DIMR": 9},
)


def understood(name: str) -> frozenset[str]:
    return known_placeholder_stems(LIBRARY.asset(name).template)


def assumed(name: str, replace: Values) -> dict[str, tuple[float | str, ...]]:
    return resolve_template_values(replace, LIBRARY.asset(name).template)[1]


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


@pytest.mark.parametrize("replace", SPELLINGS, ids="+".join)
@pytest.mark.parametrize("name", ["cylinder/cylinder", "box/box", "container/container", "block/block"])
def test_every_spelling_of_a_size_is_understood(name: str, replace: dict[str, tuple[float, ...]]) -> None:
    template = f"{name}-template.urdf"
    assert LIBRARY.load_filled_template(template, replace).size == pytest.approx(SIZE)
    assert set(assumed(template, replace)) == {"COLOR"}
    assert set(replace) <= understood(template)


@pytest.mark.parametrize("replace", [{"DIM": 0.05}, {"HALF": (0.025,)}, {"SCALE": (0.05,) * 3}, {"DIMR": 0.025}])
@pytest.mark.parametrize("name", ["ball/ball-template.urdf", "sphere/sphere-template.urdf"])
def test_a_ball_is_as_wide_as_its_first_dimension(name: str, replace: dict[str, float]) -> None:
    assert LIBRARY.load_filled_template(name, replace).size == pytest.approx((0.05,) * 3)


@pytest.mark.parametrize("color", ["red", ("red",), (0.85, 0.16, 0.16), (0.85, 0.16, 0.16, 1.0)])
def test_a_colour_has_numbers_or_a_name(color: str) -> None:
    model = LIBRARY.load_filled_template("box/box-template.urdf", {"DIM": (0.1, 0.1, 0.1), "COLOR": color})
    assert model.visuals[0].color == (0.85, 0.16, 0.16, 1)
    assert assumed("box/box-template.urdf", {"DIM": (0.1, 0.1, 0.1), "COLOR": color}) == {}


def test_a_corner_is_told_its_strokes_or_the_box_it_marks() -> None:
    x, y = 0.12, 0.08
    strokes = {"DIMX": (x / 2 - 0.0225, x / 2 + 0.0025), "DIMY": (y / 2 + 0.0025, y / 2 - 0.0225)}
    told, meant = (
        LIBRARY.load_filled_template("corner/corner-template.urdf", one) for one in (strokes, {"DIM": (x, y, 0)})
    )
    for one, other in zip(told.visuals, meant.visuals, strict=True):
        assert one.position == pytest.approx(other.position)
    assert told.bounds[1][:2] == pytest.approx((x / 2 + 0.005, y / 2 + 0.005))


def test_marks_have_a_height_of_their_own() -> None:
    for name in ("zone/zone-template.urdf", "line/line-template.urdf", "square/square-template.urdf"):
        model = LIBRARY.load_filled_template(name, {"DIM": (0.12, 0.12, 0), "HALF": (0.06, 0.06, 0)})
        assert model.colliders == ()
        assert 0 < model.size[2] < 0.003
    assert LIBRARY.load_filled_template("zone/zone-template.urdf", {"DIM": (0.12, 0.1, 0)}).size[:2] == pytest.approx(
        (0.12, 0.1)
    )
    square = LIBRARY.load_filled_template("square/square-template.urdf", {"DIM": (0.2,), "HALF": (0.095,)})
    assert square.size[:2] == pytest.approx((0.2, 0.2))
    values, _ = resolve_template_values(
        {"DIM": (0.2,), "HALF": (0.095,)}, LIBRARY.template_defaults("square/square-template.urdf")
    )
    assert LIBRARY.load_filled_template("square/square-template.urdf", values) == square, (
        "what is resolved may be filled in again"
    )


def test_what_is_left_out_or_unknown_can_be_told() -> None:
    name = "kitting/object-template.urdf"
    assert assumed(name, {"FNAME": ("01.obj",)}) == {
        "SCALE": (0.003, 0.003, 0.001),
        "COLOR": LIBRARY.template_defaults(name)["COLOR"],
    }
    assert understood(name) == {"FNAME", "SCALE", "COLOR"}
    assert assumed("box/box-template.urdf", {"DIM": (0.1,), "LENGTH": 3, "COLOR": "red"}) == {"DIM": (0.05, 0.05)}


def test_a_placeholder_may_stand_without_its_number() -> None:
    text = "DIMX DIMX1 DIMR FNAME -HALF COLOR2 ODIM0 DIMENSION"
    replace = {"DIMX": (1, 2), "DIMR": 3, "FNAME": "a/b.obj", "HALF": 0.5, "COLOR": "white"}
    assert fill_template(text, replace) == "1 2 3 b.obj -0.5 0.95 ODIM0 DIMENSION"
