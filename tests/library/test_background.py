"""The background of a run as an asset: read back as it was written, and offered to nobody."""

from pathlib import Path

import numpy as np
import pytest

from grs_agents.base.errors import InputError
from grs_agents.library.background_asset import BACKGROUND, write_background_asset
from grs_agents.library.library import Library

WALL = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [1.0, -1.0, 1.0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
SOLID = np.array([[[1.0, -1.0, 0.0], [1.02, 1.0, 1.0]]])


def test_it_is_read_back_and_offered_to_nobody(tmp_path: Path) -> None:
    name = write_background_asset(tmp_path, WALL, FACES, SOLID, (0.5, 0.25, 0.75))
    library = Library(tmp_path)
    model = library.load_object_model(name)
    assert name == BACKGROUND and name in library and library.assets() == ()
    assert np.array(model.bounds) == pytest.approx(SOLID[0])
    assert [shape.kind for shape in (*model.visuals, *model.colliders)] == ["mesh", "box"]
    assert model.visuals[0].color == pytest.approx((0.5, 0.25, 0.75, 1.0))


@pytest.mark.parametrize("boxes", [SOLID[:0], np.repeat(SOLID, 501, axis=0)])
def test_too_little_and_too_much_is_refused(tmp_path: Path, boxes: np.ndarray) -> None:
    with pytest.raises(InputError, match="boxes"):
        write_background_asset(tmp_path, WALL, FACES, boxes, (0.5, 0.5, 0.5))
