"""Shapes as rerun geometry."""

import pytest
import rerun as rr

from grs_agents.library.library import Library
from grs_agents.library.shapes import Shape
from grs_agents.views.rerun.rollout_view import TEXTURE_EDGE, shape_to_rerun


@pytest.mark.parametrize(
    ("shape", "archetype"),
    [
        (Shape(kind="box", size=(0.1, 0.2, 0.3)), rr.Boxes3D),
        (Shape(kind="sphere", size=(0.1,)), rr.Ellipsoids3D),
        (Shape(kind="cylinder", size=(0.1, 0.3)), rr.Cylinders3D),
    ],
)
def test_primitives(shape: Shape, archetype: type, library: Library) -> None:
    assert isinstance(shape_to_rerun(shape, library, None), archetype)


def test_every_asset_can_be_drawn_with_its_texture_or_a_colour(library: Library) -> None:
    textured = 0
    for asset in library.assets():
        for shape in library.load_object_model(asset.name).visuals:
            drawn = shape_to_rerun(shape, library, None)
            painted = shape_to_rerun(shape, library, (1.0, 0.0, 0.0, 1.0))
            if isinstance(drawn, rr.Mesh3D) and isinstance(painted, rr.Mesh3D):
                assert drawn.vertex_positions is not None
                assert len(drawn.vertex_positions) > 3
                assert painted.albedo_texture_buffer is None
                if drawn.albedo_texture_buffer is not None:
                    textured += 1
                    assert len(drawn.albedo_texture_buffer.as_arrow_array()[0]) <= 3 * TEXTURE_EDGE**2
    assert textured > 10
