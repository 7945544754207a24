"""The kitting shapes as programs ask for them."""

import numpy as np
import pytest

from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import read_vertices
from scripts.assets.kitting import convex_outline_pieces
from scripts.assets.outlines import outlines

LIBRARY = Library()
TOUCHING, SEEN = "kitting/object-template.urdf", "kitting/object-template-nocollision.urdf"


@pytest.mark.parametrize("number", range(20))
def test_a_shape_touches_as_its_pieces_and_looks_like_its_whole(number: int) -> None:
    shape = outlines()[number]
    file = f"some/folder/kitting/{number:02d}.obj"
    model = LIBRARY.load_filled_template(
        TOUCHING, {"FNAME": (file,), "SCALE": [0.003, 0.003, 0.001], "COLOR": (0.2, 0.3, 0.4)}
    )
    extents = np.ptp(shape.corners, axis=0) * 0.003
    assert model.size == pytest.approx((*extents, 0.02), abs=1e-6)
    assert model.bounds[0][2] == 0
    assert [visual.mesh for visual in model.visuals] == [f"kitting/{number:02d}.obj"]
    assert model.visuals[0].color == (0.2, 0.3, 0.4, 1.0)
    assert len(model.colliders) == len(convex_outline_pieces(shape))
    reach = [read_vertices(LIBRARY.mesh_or_texture_path(part.mesh or "")) for part in model.colliders]
    assert np.allclose(np.ptp(np.vstack(reach)[:, :2], axis=0) * 0.003, extents, atol=1e-6)


def test_the_mark_of_a_hole_is_flat_and_only_seen() -> None:
    model = LIBRARY.load_filled_template(SEEN, {"FNAME": "07.obj", "SCALE": (0.003, 0.003, 0.0001), "COLOR": "red"})
    assert model.colliders == ()
    assert model.size[2] == pytest.approx(0.002)
    assert LIBRARY.load_filled_template(TOUCHING, {"SCALE": (0.003, 0.003, 0.0001)}).size[2] == pytest.approx(0.002)


@pytest.mark.parametrize("name", ["../../../etc/passwd", "<x>.obj", "", "..", 'a".obj'])
def test_a_file_that_is_none_of_ours_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=r"FNAME|does not exist"):
        LIBRARY.load_filled_template(TOUCHING, {"FNAME": (name,)})


def test_a_colour_that_has_no_name_is_refused() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown color 'rde'; did you mean red\? use one of: red"):
        LIBRARY.load_filled_template(TOUCHING, {"COLOR": "rde"})
