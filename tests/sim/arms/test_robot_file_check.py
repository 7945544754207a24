"""Elements that a robot's MJCF file may hold, and those that are refused."""

from pathlib import Path

import pytest

from grs_agents.base.errors import InputError
from grs_agents.sim.arms.registry import get_arm
from tests.gantry import GANTRY
from tests.sim.arms.test_arm_files import MESH


def write(folder: Path, old: str = "<worldbody>", new: str = "<worldbody>") -> Path:
    """The gantry with a change; a mesh and a file to include lie beside it."""
    (folder / "assets" / "more").mkdir(parents=True)
    (folder / "assets" / "more" / "part.obj").write_text(MESH)
    (folder / "more.xml").write_text("<mujocoinclude><option timestep='0.002'/></mujocoinclude>")
    (folder / "arm.xml").write_text(GANTRY.replace(old, new))
    return folder / "arm.xml"


@pytest.mark.parametrize(
    "change",
    [
        "<include file='more.xml'/><worldbody>",
        "<compiler meshdir='assets'/><asset><mesh name='m' file='more/part.obj'/></asset><worldbody>",
        "<compiler meshdir='assets/more'/><asset><mesh name='m' file='../more/part.obj'/></asset><worldbody>",
        "<option integrator='implicitfast'/><size memory='10M'/><worldbody>",
        "<asset><texture type='skybox' builtin='gradient' width='512' height='3072'/></asset><worldbody>",
        "<custom><numeric name='n' data='1 2 3'/></custom><worldbody><frame pos='0 0 1'><site name='s'/></frame>",
        "<worldbody><camera name='c' pos='0 0 1' resolution='640 480'/><light pos='0 0 3'/>",
    ],
)
def test_what_usual_files_hold_is_let_be(tmp_path: Path, change: str) -> None:
    assert get_arm(str(write(tmp_path, new=change))).dof == 4


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<worldbody>", "<worldbody><composite type='cable' count='1000 1 1'/>", "<composite> is refused"),
        ("<worldbody>", "<worldbody><flexcomp type='grid' count='100 100 100' name='f'/>", "<flexcomp> is refused"),
        ("<worldbody>", "<asset><model name='m' file='arm.xml'/></asset><worldbody>", "<model> is refused"),
        ("<worldbody>", "<asset><hfield name='h' nrow='90000' ncol='90000'/></asset><worldbody>", "hfield"),
        ("<worldbody>", "<compiler><lengthrange inttotal='1e9' mode='all'/></compiler><worldbody>", "lengthrange"),
        ("<worldbody>", "<custom><numeric name='n' size='1000000000'/></custom><worldbody>", "size of <numeric>"),
        ("<worldbody>", "<sensor><user name='u' dim='1000000000'/></sensor><worldbody>", "dim of <user>"),
        ("<worldbody>", "<size nuserdata='1000000000'/><worldbody>", "nuserdata of <size>"),
        ("<worldbody>", "<worldbody><camera name='c' resolution='100000 100000'/>", "resolution of <camera>"),
        ("<worldbody>", "<asset><mesh name='m' file='link.obj'/></asset><worldbody>", "outside the robot's own folder"),
        ("<worldbody>", "<include file='link.xml'/><worldbody>", "outside the robot's own folder"),
        ("<worldbody>", "<include file='bad.xml'/><worldbody>", "<replicate> is refused"),
        ("<worldbody>", "<asset><mesh name='m' file='a\\..\\b.obj'/></asset><worldbody>", "outside the robot's own"),
        ("<mujoco>", "<!DOCTYPE m [<!ENTITY a 'b'>]><mujoco>", "document types"),
        ("<worldbody>", "<worldbody>" + "<body>" * 100 + "</body>" * 100, "nested deeper than 64"),
        ("<worldbody>", "<worldbody>" + "<geom size='.01'/>" * 2_100, "more than 2000 elements <geom>"),
    ],
)
def test_what_multiplies_itself_or_lies_elsewhere_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    (tmp_path / "m.obj").write_text(MESH)
    (tmp_path / "more.xml").write_text("<mujocoinclude/>")
    own = tmp_path / "own"
    file = write(own, old, new)
    (own / "link.obj").symlink_to(tmp_path / "m.obj")
    (own / "link.xml").symlink_to(tmp_path / "more.xml")
    (own / "bad.xml").write_text("<mujocoinclude><worldbody><replicate count='9'/></worldbody></mujocoinclude>")
    with pytest.raises(InputError, match=r"^robot .*arm\.xml: ") as refused:
        get_arm(str(file))
    assert words in refused.value.message


def test_a_large_picture_of_a_robot_is_not_decoded(tmp_path: Path) -> None:
    from tests.bombs import png

    file = write(tmp_path, new="<asset><texture name='t' type='2d' file='a.png'/></asset><worldbody>")
    png(tmp_path / "a.png", 60_000, 60_000, rows=2)
    with pytest.raises(InputError, match="60000x60000"):
        get_arm(str(file))


@pytest.mark.parametrize(
    "textures",
    [
        "".join(f"<texture name='t{n}' type='2d' builtin='flat' width='8000' height='8000'/>" for n in range(3)),
        "<texture name='t' type='cube' builtin='flat' width='4000' height='4000'/>",
        "<texture name='a' type='2d' file='a.png'/><texture name='b' type='2d' file='a.png'/>",
        "<texture name='a' type='2d' file='a.png'/><texture name='t' builtin='flat' width='2000' height='2000'/>",
    ],
    ids=["many", "cube", "one file twice", "made and read"],
)
def test_pixels_of_a_robot_count_together(tmp_path: Path, textures: str) -> None:
    from tests.bombs import png

    file = write(tmp_path, new=f"<asset>{textures}</asset><worldbody>")
    png(tmp_path / "a.png", 7_000, 7_000, rows=2)
    with pytest.raises(InputError, match="more than 67108864 px in all"):
        get_arm(str(file))
