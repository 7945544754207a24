"""A user's own MJCF: read as MuJoCo reads it, refused where it moves or reaches out."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.base.errors import InputError
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.formats.mjcf import read_mjcf
from grs_agents.library.shapes import matrix_from_quaternion

CUBE = (
    "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 0 1\nv 1 0 1\nv 0 1 1\nv 1 1 1\n"
    "f 1 3 4\nf 1 4 2\nf 5 6 8\nf 5 8 7\nf 1 2 6\nf 1 6 5\nf 3 7 8\nf 3 8 4\nf 1 5 7\nf 1 7 3\nf 2 4 8\nf 2 8 6\n"
)


def mjcf(body: str, before: str = "", attributes: str = "") -> str:
    """A file of one body."""
    return f'<mujoco>{before}<worldbody><body name="thing" {attributes}>{body}</body></worldbody></mujoco>'


def written(folder: Path, text: str) -> Path:
    """The file of a text."""
    path = folder / "thing.xml"
    path.write_text(text)
    return path


def test_everything_a_file_says_of_its_object_is_read(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "cube.obj").write_text(CUBE)
    before = (
        '<compiler meshdir="meshes"/><default><geom friction="0.7 0.1 0.1"/><default class="look">'
        '<geom contype="0" conaffinity="0" mass="0"/></default></default>'
        '<asset><mesh name="cube" file="cube.obj" scale="0.1 0.1 0.1"/><material name="paint" rgba="1 0 0 1"/></asset>'
    )
    body = (
        '<freejoint/><geom class="look" type="mesh" mesh="cube" material="paint"/>'
        '<geom type="box" size="0.05 0.05 0.05" pos="0.05 0.05 0.05" mass="0.3"/>'
        '<body pos="0 0 0.2"><geom type="sphere" size="0.01" mass="0.1"/></body>'
    )
    model = read_mjcf(written(tmp_path, mjcf(body, before)), tmp_path)
    assert [(one.mesh, one.color) for one in model.visuals] == [("meshes/cube.obj", (1, 0, 0, 1))]
    assert [one.kind for one in model.colliders] == ["box", "sphere"]
    assert model.mass == pytest.approx(0.4)
    assert model.friction == pytest.approx(0.7)
    assert model.bounds[0] == pytest.approx((-0.01, -0.01, 0))
    assert model.bounds[1] == pytest.approx((0.1, 0.1, 0.21))


ROTATIONS = (
    'quat="0.6 0.2 -0.3 0.5"',
    'euler="30 -40 50"',
    'axisangle="1 2 3 200"',
    'zaxis="1 -2 0.5"',
    'zaxis="0 0 -1"',
)


@pytest.mark.parametrize("rotation", ROTATIONS)
@pytest.mark.parametrize(
    "compiler", ["", '<compiler eulerseq="ZYX"/>', '<compiler angle="radian" eulerseq="zYx"/>'], ids=str
)
def test_placements_are_those_of_mujoco(tmp_path: Path, rotation: str, compiler: str) -> None:
    body = f'<body pos="0.1 0 0.2" euler="5 6 7"><geom type="box" size="0.1 0.2 0.3" pos="1 2 3" {rotation}/></body>'
    text = mjcf(body, compiler, 'pos="3 2 1" euler="40 50 60"')
    shape = read_mjcf(written(tmp_path, text), tmp_path).colliders[0]
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    frame, origin = data.xmat[1].reshape(3, 3), data.xpos[1]
    assert frame.T @ (data.geom_xpos[0] - origin) == pytest.approx(np.array(shape.position), abs=1e-9)
    ours = matrix_from_quaternion(shape.quaternion)
    assert np.allclose(frame.T @ data.geom_xmat[0].reshape(3, 3), ours, atol=1e-9)
    assert model.geom_size[0] * 2 == pytest.approx(np.array(shape.size))


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.floats(-1, 1)] * 6).filter(lambda ends: math.dist(ends[:3], ends[3:]) > 0.01))
def test_a_stick_between_two_points_is_mujocos(
    tmp_path_factory: pytest.TempPathFactory, ends: tuple[float, ...]
) -> None:
    words = " ".join(f"{value:.9f}" for value in ends)
    text = mjcf(f'<geom type="cylinder" size="0.02" fromto="{words}"/>')
    shape = read_mjcf(written(tmp_path_factory.mktemp("stick"), text), tmp_path_factory.getbasetemp()).colliders[0]
    model = mujoco.MjModel.from_xml_string(text)
    assert model.geom_size[0][1] * 2 == pytest.approx(shape.size[1], abs=1e-9)
    along = np.subtract(ends[3:], ends[:3])
    assert matrix_from_quaternion(shape.quaternion)[:, 2] == pytest.approx(along / np.linalg.norm(along), abs=1e-6)
    assert shape.position == pytest.approx(np.add(ends[3:], ends[:3]) / 2, abs=1e-6)
    assert read_mass(text, tmp_path_factory) == pytest.approx(float(model.body_mass[1]), rel=1e-6)


def read_mass(text: str, folders: pytest.TempPathFactory) -> float:
    """The mass of a file's object."""
    folder = folders.mktemp("mass")
    return read_mjcf(written(folder, text), folder).mass


def test_a_capsule_is_a_cylinder_of_its_length(tmp_path: Path) -> None:
    model = read_mjcf(written(tmp_path, mjcf('<geom type="capsule" size="0.02 0.05"/>')), tmp_path)
    assert model.colliders[0].kind == "cylinder"
    assert model.size == pytest.approx((0.04, 0.04, 0.14))


GEOM = '<geom size="0.1"/>'


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("<robot/>", "<robot> is not MJCF"),
        ("<!DOCTYPE x><mujoco/>", "document types"),
        ("<mujoco>", "not XML"),
        (mjcf('<include file="/etc/passwd"/>'), "<include> is refused"),
        (mjcf(GEOM, '<extension><plugin plugin="x"/></extension>'), "<extension> is refused"),
        (mjcf(GEOM + '<joint name="lid"/>'), "joint 'lid' of body 'thing' is a hinge"),
        (mjcf(GEOM + '<joint name="drawer" type="slide"/>'), "joint 'drawer' of body 'thing' is a slide"),
        (mjcf(f'{GEOM}<body name="in"><freejoint/>{GEOM}</body>'), "body 'in' is free inside"),
        ("<mujoco><worldbody><body/><body/></worldbody></mujoco>", "2 bodies"),
        (f"<mujoco><worldbody><body/>{GEOM}</worldbody></mujoco>", "1 loose geoms"),
        (mjcf(""), "neither visual nor collision"),
        (mjcf('<geom name="ground" type="plane" size="1 1 1"/>'), "geom 'ground' is a plane"),
        (mjcf('<geom type="box" size="1 1"/>'), "give 3 numbers"),
        (mjcf('<geom size="-1"/>'), "not positive"),
        (mjcf('<geom size="1" pos="0 nan 0"/>'), "not finite"),
        (mjcf('<geom size="1" quat="0 0 0 0"/>'), "no direction"),
        (mjcf('<geom size="1" xyaxes="1 0 0 0 1 0"/>'), "xyaxes is not read"),
        (mjcf('<geom type="cylinder" size="1" fromto="0 0 0 0 0 0"/>'), "no length"),
        (mjcf('<geom size="1" mass="nan"/>'), "mass is 'nan'"),
        (mjcf('<geom type="mesh" mesh="m"/>'), "not among the assets"),
        (mjcf('<geom type="mesh" mesh="m"/>', '<asset><mesh name="m" file="../m.obj"/></asset>'), "leaves the library"),
        (
            mjcf('<geom type="mesh" mesh="m"/>', '<asset><mesh name="m" file="/m.obj"/></asset>'),
            "relative to the folder",
        ),
        (
            mjcf(
                '<geom type="mesh" mesh="m"/>', '<compiler meshdir=".."/><asset><mesh name="m" file="m.obj"/></asset>'
            ),
            "leaves the library",
        ),
        (mjcf('<geom type="mesh" mesh="c"/>', '<asset><mesh file="c.obj"/></asset>'), "has no mass"),
        (mjcf(GEOM, '<compiler coordinate="global"/>'), "global coordinates"),
        (mjcf(GEOM, '<compiler eulerseq="xxq"/>'), "eulerseq"),
        ("<a>" * 40 + "</a>" * 40, "nested deeper"),
    ],
)
def test_what_cannot_be_trusted_is_refused_by_name(tmp_path: Path, text: str, named: str) -> None:
    root = tmp_path / "library"
    root.mkdir()
    (tmp_path / "m.obj").write_text(CUBE)
    (root / "c.obj").write_text(CUBE)
    with pytest.raises(InputError, match=named) as refused:
        read_mjcf(written(root, text), root)
    assert "; " in str(refused.value), "names the remedy"
