"""A user's own files, found by their names."""

from pathlib import Path

import pytest

from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.library.library import Library

BOX = '<geometry><box size="0.1 0.2 0.3"/></geometry>'
URDF = (
    '<robot name="shelf"><link name="a"><inertial><mass value="0.2"/></inertial>'
    f'<visual>{BOX}<material name="m"><color rgba="0.9 0.1 0.1 1"/></material></visual>'
    f'<collision>{BOX}</collision></link><link name="b"><inertial><mass value="0.3"/></inertial>'
    f"<collision>{BOX}</collision></link>"
    '<joint name="glue" type="fixed"><parent link="a"/><child link="b"/>'
    '<origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/></joint></robot>'
)
MJCF = '<mujoco><worldbody><body><freejoint/><geom type="box" size="0.01 0.02 0.03"/></body></worldbody></mujoco>'


@pytest.fixture
def library(tmp_path: Path) -> Library:
    """The shipped library under a user's folder without a manifest."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "shelf.urdf").write_text(URDF)
    (tmp_path / "mine" / "brick.xml").write_text(MJCF)
    (tmp_path / "broken.urdf").write_text("<robot")
    return Library().copy_with_overlay_root(tmp_path)


def test_links_that_are_glued_are_one_object(library: Library) -> None:
    asset, model = library.asset("mine/shelf.urdf"), library.load_object_model("mine/shelf.urdf")
    assert (asset.category, asset.kind, asset.color) == ("object", "shelf", "red")
    assert asset.size == pytest.approx((1.15, 0.2, 0.3))
    assert model.size == pytest.approx(asset.size)
    assert model.mass == pytest.approx(0.5)
    assert model.colliders[1].position == pytest.approx((1, 0, 0))


def test_mjcf_is_found_like_urdf(library: Library) -> None:
    assert library.asset("mine/brick.xml").size == pytest.approx((0.02, 0.04, 0.06))
    assert library.load_object_model("mine/brick.xml").mass == pytest.approx(1000 * 0.02 * 0.04 * 0.06)
    assert library.asset_path("mine/brick.xml").is_file()


def test_own_files_are_known_by_name_and_never_offered(library: Library) -> None:
    assert {"mine/shelf.urdf", "mine/brick.xml", "broken.urdf"} <= set(library.asset_names())
    assert "mine/brick.xml" in library
    assert "mine/brick.xml" not in {asset.name for asset in library.assets()}
    with pytest.raises(UnknownNameError, match=r"use one of: mine/shelf\.urdf"):
        library.load_object_model("mine/shelv.urdf")


def test_a_faulty_file_harms_only_who_names_it(library: Library) -> None:
    assert library.load_object_model("block/block.urdf").size == pytest.approx((0.04, 0.04, 0.04))
    with pytest.raises(InputError, match="not XML"):
        library.load_object_model("broken.urdf")


@pytest.mark.parametrize(
    "name", ["../secret.urdf", "mine/../../secret.urdf", "/etc/x.urdf", "mine/shelf.urdf\0", "", "mine"]
)
def test_names_stay_inside_the_folder(library: Library, tmp_path: Path, name: str) -> None:
    (tmp_path.parent / "secret.urdf").write_text(URDF)
    assert name not in library
    with pytest.raises(UnknownNameError):
        library.load_object_model(name)


def test_a_link_out_of_the_folder_is_not_followed(library: Library, tmp_path: Path) -> None:
    outside = tmp_path.parent / "outside.urdf"
    outside.write_text(URDF)
    (tmp_path / "link.urdf").symlink_to(outside)
    assert "link.urdf" not in library
    assert "link.urdf" not in library.asset_names()


LINKS = '<link name="a"/><link name="b"><collision><geometry><sphere radius="1"/></geometry></collision></link>'


@pytest.mark.parametrize(
    ("joint", "named"),
    [
        (
            '<joint name="hinge" type="revolute"><parent link="a"/><child link="b"/></joint>',
            "joint 'hinge' is revolute",
        ),
        ('<joint name="j" type="fixed"><parent link="b"/><child link="b"/></joint>', "hangs on 'b'"),
        ('<joint name="j" type="fixed"><parent link="x"/><child link="b"/></joint>', "hangs on 'x'"),
        ('<joint name="j" type="fixed"><child link="b"/></joint>', "hangs on ''"),
        ("", "2 links and 0 fixed joints"),
    ],
)
def test_joints_that_do_not_make_one_object_are_refused(tmp_path: Path, joint: str, named: str) -> None:
    (tmp_path / "arm.urdf").write_text(f'<robot name="r">{LINKS}{joint}</robot>')
    with pytest.raises(InputError, match=named):
        Library(tmp_path).load_object_model("arm.urdf")
