"""Primitive proxies."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.base import Vec3
from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.perception.proxies.proxy import primitive_proxy, write_proxy
from grs_agents.perception.types import Solid

EXTENTS = st.tuples(*[st.floats(0.005, 1.0)] * 3)
COLORS = st.tuples(*[st.floats(0, 1)] * 3)


@settings(max_examples=50, deadline=None)
@given(st.sampled_from(["box", "cylinder"]), EXTENTS, COLORS)
def test_a_proxy_has_the_measured_size(
    tmp_path_factory: pytest.TempPathFactory, shape: Solid, size: Vec3, color: Vec3
) -> None:
    root = tmp_path_factory.mktemp("proxies")
    asset = write_proxy(root, "thing", primitive_proxy(shape, size, color), "a thing")
    model = Library(root).load_object_model("proxy/thing.urdf")
    assert model.size == pytest.approx(asset.size, abs=1e-4)
    assert asset.size[2] == pytest.approx(size[2], abs=1e-4)
    assert 0.02 <= asset.mass <= 2.0
    assert (model.mass, model.friction) == pytest.approx((asset.mass, asset.friction))
    if shape == "box":
        assert asset.size == pytest.approx(size, abs=1e-4)
    else:
        assert asset.size[0] == asset.size[1]


def test_proxies_gather_in_one_manifest(tmp_path: Path) -> None:
    for slug in ("one", "two", "one"):
        write_proxy(tmp_path, slug, primitive_proxy("box", (0.1, 0.1, 0.1), (0.5, 0.5, 0.5)), "a thing")
    assert Library(tmp_path).asset_names() == ["proxy/one.urdf", "proxy/two.urdf"]


@pytest.mark.parametrize(
    ("slug", "size", "color", "named"),
    [
        ("../up", (0.1, 0.1, 0.1), (0, 0, 0), "'../up'"),
        ("", (0.1, 0.1, 0.1), (0, 0, 0), "proxy name"),
        ("a", (0.1, 0.1, 0.0), (0, 0, 0), "size"),
        ("a", (0.1, 0.1, float("nan")), (0, 0, 0), "size"),
        ("a", (0.1, 9.0, 0.1), (0, 0, 0), "size"),
        ("a", (0.1, 0.1, 0.1), (0, 0, 2), "colour"),
    ],
)
def test_what_makes_no_proxy_is_named(tmp_path: Path, slug: str, size: Vec3, color: Vec3, named: str) -> None:
    with pytest.raises(InputError, match=named):
        write_proxy(tmp_path, slug, primitive_proxy("box", size, color), "a thing")
    assert not list(tmp_path.iterdir())
