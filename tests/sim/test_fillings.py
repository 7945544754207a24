import numpy as np
import pytest

from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.sim.world import templates

BOX = "box/box-template.urdf"


def test_a_filling_that_is_asked_for_again_is_the_same_and_so_are_the_doubts() -> None:
    library = Library()
    first, again = (
        templates.fill_and_describe_template(library, BOX, {"DIM": (0.1, 0.1, 0.05), "ODD": 1}) for _ in range(2)
    )
    assert first == again
    assert any("ODD" in doubt for doubt in first[1])


def test_fillings_that_differ_by_a_hair_are_two_however_they_are_given() -> None:
    library, size = Library(), np.array([0.1, 0.1, 0.05])
    names = [templates.fill_and_describe_template(library, BOX, {"DIM": size + hair})[0] for hair in (0.0, 1e-12)]
    names += [
        templates.fill_and_describe_template(library, BOX, {"DIM": tuple((size + hair).tolist())})[0]
        for hair in (0.0, 1e-12)
    ]
    assert names[:2] == names[2:]
    assert len(set(names)) == 2


def test_a_faulty_filling_is_refused_every_time() -> None:
    library = Library()
    for _ in range(2):
        with pytest.raises(InputError):
            templates.fill_and_describe_template(library, BOX, {"DIM": (float("nan"), 0.1, 0.1)})


@pytest.mark.parametrize("name", ["box/box-template.urdf", "/tmp/x/box/box-template.urdf", "x\\box\\box-template.urdf"])
def test_folders_in_front_of_a_name_do_not_matter(name: str) -> None:
    assert templates.resolve_asset_name(name, Library()) == BOX
