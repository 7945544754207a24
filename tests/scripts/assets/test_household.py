"""Things that are not groceries."""

from scripts.assets.household import build_bowl, build_household, build_mug
from scripts.assets.templates import build_templates


def test_things_to_put_things_in_are_hollow() -> None:
    hollow = {one.asset.kind for one in build_household() if one.asset.hollow}
    assert hollow == {"open_box", "small_open_box", "bowl", "mug", "plate", "zone"}


def test_cubes_differ_in_colour_alone() -> None:
    cubes = [one.asset for one in build_household() if one.asset.category == "cube"]
    assert len({cube.color for cube in cubes}) == len(cubes) - 1, "the plain block is gray as the gray one is"
    assert {cube.size for cube in cubes} == {(0.04, 0.04, 0.04)}


def test_a_bowl_is_many_primitives_and_a_mug_has_a_handle() -> None:
    assert build_bowl().urdf.count("<collision>") > 30
    assert {name.rsplit("/")[-1] for name in build_mug().meshes} == {"mug.obj", "handle.obj"}


def test_templates_document_their_defaults() -> None:
    for one in build_templates():
        assert one.asset.template["DIM"] == one.asset.size
        assert len(one.asset.template["COLOR"]) == 4
        assert one.asset.fixture == one.asset.everyday
        assert "COLOR0" in one.urdf
