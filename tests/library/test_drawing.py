"""Views for people: OpenGL and the z-buffer show the same."""

import numpy as np
import pytest

from grs_agents.errors import ConfigError
from grs_agents.library import Library
from grs_agents.library import drawing as room
from grs_agents.library.drawing import PLAIN, drawn
from grs_agents.library.views import asset_views, ring_directions
from tests.needs import needs

NAMES = ("HOPE/Milk.urdf", "bowl/bowl.urdf", "block/red_block.urdf")


@needs("egl")
def test_both_renderers_show_the_same() -> None:
    library, directions = Library(), ring_directions(3)
    found = drawn(library, NAMES, directions, size=96, renderer="gl")
    assert found.renderer in ("EGL", "OSMesa", "OpenGL")
    for name, views in zip(NAMES, found.views, strict=True):
        assert isinstance(views, tuple)
        for one, other in zip(views, asset_views(library, name, directions, size=96), strict=True):
            solid, plain = one.rgba[:, :, 3] > 127, other.rgba[:, :, 3] > 127
            assert (solid & plain).sum() > 0.97 * (solid | plain).sum()
            both = solid & plain
            assert np.median(np.abs(one.depth - other.depth)[both]) < 1e-3
            apart = np.abs(one.rgba[both][:, :3].astype(float) - other.rgba[both][:, :3])
            assert np.median(apart) < 12 and apart.mean() < 20
            assert (one.direction, one.distance, one.focal) == (other.direction, other.distance, other.focal)


def test_without_opengl_the_z_buffer_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "_backends", lambda: (("none", "None"),))
    found = drawn(Library(), NAMES[:1], ring_directions(1), size=32)
    assert found.renderer == PLAIN and isinstance(found.views[0], tuple)
    with pytest.raises(ConfigError, match="--renderer plain"):
        drawn(Library(), NAMES[:1], ring_directions(1), size=32, renderer="gl")
