"""Templates at the runtime's door: what is filled in cannot reach beyond the library, nor blow up."""

import json
from pathlib import Path

import pytest
from pydantic import ValidationError

from grs_agents.base.errors import GrsError
from grs_agents.library.library import Library
from grs_agents.sim import Environment, InstanceObject, Task

KIT = "kitting/object-template.urdf"
BOX = "box/box-template.urdf"
SPOT = ((0.5, 0.0, 0.05), (0.0, 0.0, 0.0, 1.0))
PLAIN = "<link name='a'><collision><geometry><box size='DIM0 DIM1 DIM2'/></geometry></collision>{}</link>"
BOMB = (
    "<!DOCTYPE r [<!ENTITY a 'aaaaaaaaaa'>"
    + "".join(f"<!ENTITY {one} '{f'&{other};' * 10}'>" for one, other in zip("bcdefghi", "abcdefgh", strict=True))
    + "]>"
)


def overlay(folder: Path, text: str) -> Library:
    """A library with one template of a stranger's."""
    entry = {
        "name": "own/own-template.urdf",
        "kind": "x",
        "category": "box",
        "size": [0.1, 0.1, 0.1],
        "mass": 0.1,
        "friction": 0.5,
        "color": "red",
        "description": "x",
        "template": {"DIM": [0.1, 0.1, 0.1]},
    }
    (folder / "own").mkdir()
    (folder / "own" / "own-template.urdf").write_text(text)
    (folder / "manifest.json").write_text(json.dumps({"assets": [entry]}))
    (folder.parent / "outside.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n")
    return Library().copy_with_overlay_root(folder)


WORDS = {
    "another folder's file": "../../../etc/passwd",
    "an absolute path": "/etc/passwd",
    "markup": 'x.obj"/><include file="x"/><mesh filename="y.obj',
    "an entity": "&a;",
    "an address": "file:///etc/passwd",
    "nothing": "",
    "a folder": "..",
    "zero byte": "x\0.obj",
}


@pytest.mark.parametrize("name", WORDS)
def test_a_word_names_a_file_beside_the_template_or_is_refused(name: str) -> None:
    env = Environment()
    with pytest.raises(GrsError, match=r"FNAME|library file|cannot read mesh|passwd"):
        env.add_object(Task().fill_template(KIT, {"FNAME": (WORDS[name],), "SCALE": (0.1, 0.1, 0.1)}), SPOT)


@pytest.mark.parametrize("value", ["&a;", '0.1"/><include/>', "nan", "inf", float("nan"), 1e300, None, b"x", {}, [[1]]])
@pytest.mark.parametrize("stem", ["DIM", "COLOR"])
def test_a_number_is_a_finite_number_or_refused(stem: str, value: object) -> None:
    with pytest.raises(GrsError) as caught:
        Environment().add_object(Task().fill_template(BOX, {stem: (value, 0.1, 0.1)}), SPOT)
    assert "template value" in str(caught.value)


HOSTILE = {
    "entity bomb": (f"{BOMB}<robot name='x'>{PLAIN.format('&i;')}</robot>", "document types and entities"),
    "entity of a file": (
        f"<!DOCTYPE r [<!ENTITY x SYSTEM 'file:///etc/passwd'>]><robot name='x'>{PLAIN.format('&x;')}</robot>",
        "document types and entities",
    ),
    "include": (f"<robot name='x'><include file='/etc/passwd'/>{PLAIN.format('')}</robot>", "include"),
    "xinclude": (
        "<robot name='x' xmlns:xi='http://www.w3.org/2001/XInclude'><xi:include href='/etc/passwd' parse='text'/>"
        f"{PLAIN.format('')}</robot>",
        "include",
    ),
    "mesh outside": (
        "<robot name='x'><link name='a'><collision><geometry><mesh filename='../../outside.obj' scale='DIM0 1 1'/>"
        "</geometry></collision></link></robot>",
        "leaves the library",
    ),
    "nested": ("<robot name='x'>" + "<link>" * 100 + "</link>" * 100 + "</robot>", "nested deeper"),
    "long": (f"<robot name='x'>{PLAIN.format('')}<!-- {'DIM0 ' * 300_000} --></robot>", "more than"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_template_is_refused_by_name(name: str, tmp_path: Path) -> None:
    text, told = HOSTILE[name]
    folder = tmp_path / "library"
    folder.mkdir()
    env = Environment(library=overlay(folder, text))
    with pytest.raises(GrsError, match=told):
        env.insert_object(InstanceObject(id=1, asset="own/own-template.urdf", fill={"DIM": (0.1, 0.1, 0.1)}, pose=SPOT))


def test_a_harmless_one_is_filled(tmp_path: Path) -> None:
    folder = tmp_path / "library"
    folder.mkdir()
    env = Environment(library=overlay(folder, f"<robot name='x'>{PLAIN.format('')}</robot>"))
    item = InstanceObject(id=1, asset="own/own-template.urdf", fill={"DIM": (0.1, 0.2, 0.1)}, pose=SPOT)
    assert env.get_object_size(env.insert_object(item)) == pytest.approx((0.1, 0.2, 0.1))


@pytest.mark.parametrize("asset", ["../secret.urdf", "/etc/passwd", "own/../../x.urdf", "x.urdf\0", "http://x/y.urdf"])
def test_an_instance_names_assets_of_the_library_alone(asset: str) -> None:
    env = Environment()
    with pytest.raises(GrsError, match="unknown asset"):
        env.insert_object(InstanceObject(id=1, asset=asset, pose=SPOT))


@pytest.mark.parametrize("fill", [{"DIM": (float("nan"),)}, {"DIM": (3.0,)}, {"DIM": ("x",)}, {"x" * 21: (1.0,)}])
def test_an_instances_filling_is_in_range(fill: dict[str, tuple[float | str, ...]]) -> None:
    with pytest.raises(ValidationError):
        InstanceObject(id=1, asset=BOX, fill=fill, pose=SPOT)
