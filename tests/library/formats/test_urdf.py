"""The URDF reader trusts nothing."""

from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.base.errors import InputError
from grs_agents.library.formats.urdf import read_urdf

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 2\n"
BOX = '<geometry><box size="0.1 0.2 0.3"/></geometry>'


def robot(inside: str, before: str = "") -> str:
    """A URDF of one link."""
    return f'<robot name="r">{before}<link name="l">{inside}</link></robot>'


def collision(geometry: str, origin: str = "") -> str:
    """A URDF of one collision shape."""
    return robot(f"<collision>{origin}<geometry>{geometry}</geometry></collision>")


def test_everything_a_urdf_says_is_read(tmp_path: Path) -> None:
    (tmp_path / "things" / "meshes").mkdir(parents=True)
    (tmp_path / "things" / "meshes" / "m.obj").write_text(TETRAHEDRON)
    (tmp_path / "things" / "t.png").write_bytes(b"png")
    path = tmp_path / "things" / "thing.urdf"
    path.write_text(
        robot(
            '<contact><lateral_friction value="0.7"/></contact><inertial><mass value="0.25"/></inertial>'
            '<visual><geometry><mesh filename="meshes/m.obj" scale="2 1 1"/></geometry>'
            '<material name="paint"/></visual>'
            '<visual><geometry><sphere radius="0.1"/></geometry>'
            '<material name="own"><color rgba="1 0 0 0.5"/></material></visual>'
            f'<collision><origin xyz="0 0 1" rpy="0 0 0"/>{BOX}</collision>'
            '<collision><geometry><cylinder radius="0.1" length="0.4"/></geometry></collision>',
            '<material name="paint"><texture filename="t.png"/></material>',
        )
    )
    model = read_urdf(path, tmp_path)
    mesh, sphere = model.visuals
    assert (mesh.mesh, mesh.texture, mesh.size) == ("things/meshes/m.obj", "things/t.png", (2, 1, 1))
    assert (sphere.kind, sphere.color) == ("sphere", (1, 0, 0, 0.5))
    assert [shape.kind for shape in model.colliders] == ["box", "cylinder"]
    assert (model.mass, model.friction) == (0.25, 0.7)
    assert model.bounds[0] == pytest.approx((-0.1, -0.1, -0.2))
    assert model.bounds[1] == pytest.approx((0.1, 0.1, 1.15))
    assert model.size == pytest.approx((0.2, 0.2, 1.35))


def test_a_mesh_collides_as_the_convex_parts_beside_it(tmp_path: Path) -> None:
    for name in ("m.obj", "m.part0.obj", "m.part1.obj", "m.part3.obj"):  # numbers run without gaps
        (tmp_path / name).write_text(TETRAHEDRON)
    mesh = '<geometry><mesh filename="m.obj"/></geometry>'
    model = read_urdf(
        robot(f"<visual>{mesh}</visual><collision>{mesh}</collision><collision>{BOX}</collision>"), tmp_path
    )
    assert [shape.mesh for shape in model.colliders] == ["m.part0.obj", "m.part1.obj", None]
    assert [shape.mesh for shape in model.visuals] == ["m.obj"]


def test_text_finds_its_files_from_the_folder_it_names(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "m.obj").write_text(TETRAHEDRON)
    model = read_urdf(collision('<mesh filename="m.obj"/>'), tmp_path, "deep")
    assert model.colliders[0].mesh == "deep/m.obj"
    assert model.bounds == ((0, 0, 0), (1, 1, 2))


def test_bounds_are_those_of_the_visuals_where_nothing_collides(tmp_path: Path) -> None:
    model = read_urdf(robot(f"<visual>{BOX}</visual>"), tmp_path)
    assert (model.colliders, model.mass) == ((), 0)
    assert model.size == pytest.approx((0.1, 0.2, 0.3))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('<!DOCTYPE r [<!ENTITY a "b">]>' + robot(f"<visual>{BOX}</visual>"), "document types and entities"),
        ('<!DOCTYPE r SYSTEM "file:///etc/passwd">' + robot(f"<visual>{BOX}</visual>"), "document types"),
        ("<robot", "not XML"),
        ("", "not XML"),
        ("<sdf/>", "<sdf> with 0 links"),
        ('<robot name="r"><link name="a"/><link name="b"/></robot>', "2 links"),
        (robot(""), "neither visual nor collision"),
        (collision('<box size="0.1 DIM1 0.1"/>'), "placeholders"),
        (collision('<box size="0.1 nan 0.1"/>'), "not finite"),
        (collision('<box size="0.1 inf 0.1"/>'), "not finite"),
        (collision('<box size="0.1 1e9 0.1"/>'), "beyond 100"),
        (collision('<box size="0.1 -0.1 0.1"/>'), "not positive"),
        (collision('<box size="0.1 0.1"/>'), "2 numbers"),
        (collision("<box/>"), "0 numbers"),
        (collision('<cylinder radius="0" length="1"/>'), "not positive"),
        (collision('<box size="1 1 1"/>', '<origin xyz="0 0 nan"/>'), "not finite"),
        (collision('<capsule radius="1"/>'), "unknown shape <capsule>"),
        (collision('<box size="1 1 1"/><box size="1 1 1"/>'), "2 shapes"),
        (collision('<mesh filename="../outside.obj"/>'), "leaves the library"),
        (collision('<mesh filename="/etc/passwd"/>'), "relative to the folder"),
        (collision('<mesh filename="file:///etc/passwd"/>'), "relative to the folder"),
        (collision('<mesh filename="package://x/m.obj"/>'), "relative to the folder"),
        (collision('<mesh filename="missing.obj"/>'), "does not exist"),
        (robot(f"<visual>{BOX}</visual><inertial><mass value='-1'/></inertial>"), "negative"),
        (robot(f"<visual>{BOX}<material><color rgba='2 0 0 1'/></material></visual>"), "outside 0..1"),
        (robot(f"<visual>{BOX}</visual>" * 501), "501 <visual>"),
        ("<a>" * 40 + "</a>" * 40, "nested deeper"),
        (" " * 1_000_001, "longer than"),
    ],
)
def test_what_cannot_be_trusted_is_refused_by_name(tmp_path: Path, text: str, named: str) -> None:
    root = tmp_path / "library"
    root.mkdir()
    (tmp_path / "outside.obj").write_text(TETRAHEDRON)
    with pytest.raises(InputError, match=named):
        read_urdf(text, root)


def test_a_link_that_leaves_the_library_is_refused(tmp_path: Path) -> None:
    root = tmp_path / "library"
    root.mkdir()
    (tmp_path / "outside.obj").write_text(TETRAHEDRON)
    (root / "inside.obj").symlink_to(tmp_path / "outside.obj")
    with pytest.raises(InputError, match="leaves the library"):
        read_urdf(collision('<mesh filename="inside.obj"/>'), root)


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="gone"):
        read_urdf(tmp_path / "gone.urdf", tmp_path)
    (tmp_path / "binary.urdf").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="binary"):
        read_urdf(tmp_path / "binary.urdf", tmp_path)
    (tmp_path / "large.urdf").write_bytes(b" " * 1_000_001)
    with pytest.raises(InputError, match="more than 1000000"):
        read_urdf(tmp_path / "large.urdf", tmp_path)


WORDS = st.one_of(st.floats(allow_nan=True).map(str), st.text(max_size=6), st.sampled_from(["0.1", "DIM0", "1e400"]))
TAGS = st.sampled_from(["box", "cylinder", "sphere", "mesh", "plane"])
NAMES = st.sampled_from(["size", "radius", "length", "filename", "scale"])


@settings(max_examples=100, deadline=None)
@given(TAGS, st.dictionaries(NAMES, st.lists(WORDS, max_size=4).map(" ".join)))
def test_any_geometry_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, tag: str, given: dict[str, str]
) -> None:
    attributes = " ".join(f"{name}={quoteattr(value)}" for name, value in given.items())
    try:
        model = read_urdf(collision(f"<{tag} {attributes}/>"), tmp_path_factory.getbasetemp())
    except InputError:
        return
    assert all(0 < extent <= 200 for extent in model.size)


@settings(max_examples=100, deadline=None)
@given(st.one_of(st.text(), st.text().map(robot)))
def test_any_text_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    with pytest.raises(InputError):
        read_urdf(text, tmp_path_factory.getbasetemp())
