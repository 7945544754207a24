"""Models as other people's programs write them: what is usual is read, what is lost of a look is noted."""

import multiprocessing
import random
import resource
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.importing.archives import open_import_source
from grs_agents.library.importing.asset_discovery import find_item_files, find_source_items, slugify_name
from grs_agents.library.importing.mesh_reader import read_mesh
from grs_agents.library.importing.model_descriptions import read_urdf_or_mjcf
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.texture_atlas import merge_mesh_parts
from grs_agents.library.importing.types import ImportOptions, RefusedError, SourceItem, SourceModel
from grs_agents.library.mesh_files import mesh_volume
from tests.library.importing import models

GREEN = (20, 160, 60)
GREY = [180, 180, 180]


def read_item(folder: Path, item: SourceItem) -> SourceModel:
    """One item of a folder."""
    source, options = SourceFolder(folder, 10_000_000), ImportOptions()
    if item.kind in ("urdf", "mjcf"):
        return read_urdf_or_mjcf(source, item, options)
    return read_mesh(source, item.file, options.limits, item.texture)


def read(folder: Path, file: str | None = None) -> SourceModel:
    """The only item of a folder, or that of a file."""
    items = find_source_items(SourceFolder(folder, 10_000_000))
    (item,) = (item for item in items if file in (None, item.file))
    return read_item(folder, item)


def shown_color(model: SourceModel) -> list[int]:
    """The mean colour of the surface, as it is shown."""
    solid = merge_mesh_parts(model.parts, 64)
    middle = solid.uvs.mean(axis=1)
    height, width = solid.image.shape[:2]
    rows, columns = (1 - middle[:, 1]) * (height - 1), middle[:, 0] * (width - 1)
    texels = solid.image[rows.round().astype(int), columns.round().astype(int)]
    return texels.mean(axis=0).round().astype(int).tolist()


def extents(model: SourceModel) -> list[float]:
    """Extents of all that is seen, in the file's unit."""
    points = np.concatenate([part.vertices[np.unique(part.faces)] for part in model.parts])
    return np.ptp(points, axis=0).round(5).tolist()


@pytest.mark.parametrize(
    ("words", "file"),
    [
        ("map_Kd front label.png", "front label.png"),
        ("map_Kd textures\\label.png", "textures/label.png"),
        ("map_Kd  .\\textures\\front  label.png", "textures/front  label.png"),
        ("map_Kd -s 1 1 1 -o 0 0 0 -clamp on -blendu off front label.png", "front label.png"),
        ("map_Kd -bm 0.5 -mm 0 1 -o 0.0 label 2.png", "label 2.png"),
        ("\tmap_Kd\tlabel.png", "Label.PNG"),
        ("map_Kd LABEL.png", "textures/../label.PNG"),
        ("map_Kd C:\\Users\\me\\work\\textures\\label.png", "textures/label.png"),
        ("map_Kd /home/me/work/label.png", "label.png"),
        ("map_Kd ../away/label.png", "label.png"),
        ("map_kd label%20one.png", "label one.png"),
        ('map_Kd "label.png"', "label.png"),
        ("map_Ka label.png", "label.png"),
    ],
)
def test_the_picture_that_an_mtl_means_is_shown(tmp_path: Path, words: str, file: str) -> None:
    (tmp_path / "textures").mkdir()
    models.picture(tmp_path / file, GREEN, GREEN)
    models.textured_box(tmp_path, "box", (0.05, 0.06, 0.07))
    (tmp_path / "box.mtl").write_text(f"newmtl paint\r\nKd 0 0 0\r\n{words}\r\n")
    model = read(tmp_path)
    assert shown_color(model) == list(GREEN)
    assert not model.notes


@pytest.mark.parametrize(
    ("mtl", "color", "note"),
    [
        (None, GREY, "box.mtl"),
        ("newmtl paint\nKd 1 0 0\nmap_Kd nowhere.png\n", [255, 0, 0], "does not exist"),
        ("newmtl paint\nmap_Kd ../../../etc/passwd\n", GREY, "leaves the source"),
        ("newmtl paint\nmap_Kd /etc/hostname\n", GREY, "no relative path"),
        ("newmtl paint\nmap_Kd box.obj\n", GREY, "no picture"),
        ("newmtl paint\nmap_Kd bomb.png\n", GREY, "400000000 pixels"),
        ("newmtl other\nKd 1 0 0\n", GREY, "describes the material 'paint'"),
        ("newmtl paint\nKd 0.2 0.4 0.6\nd 0.3\n", [51, 102, 153], "30% opaque"),
        ("newmtl paint\nKd nonsense\n", GREY, ""),
    ],
)
def test_a_fault_of_the_look_costs_the_look(tmp_path: Path, mtl: str | None, color: list[int], note: str) -> None:
    models.textured_box(tmp_path, "box", (0.05, 0.06, 0.07))
    (tmp_path / "box.mtl").unlink()
    if mtl is not None:
        (tmp_path / "box.mtl").write_text(mtl)
        if "bomb" in mtl:
            models.Image.new("L", (20_000, 20_000)).save(tmp_path / "bomb.png")
    model = read(tmp_path)
    assert shown_color(model) == color
    assert extents(model) == [0.05, 0.06, 0.07]
    assert note in " ".join(model.notes) and bool(note) == bool(model.notes)


def test_several_material_files_and_materials_and_an_unnamed_file_are_read(tmp_path: Path) -> None:
    rows = models.TETRAHEDRON.replace("f 1 3 2", "usemtl a b\nf 1 3 2").replace("f 2 3 4", "usemtl c\nf 2 3 4")
    (tmp_path / "one.obj").write_text(f"mtllib first.mtl\nmtllib second file.mtl\n{rows}")
    (tmp_path / "first.mtl").write_text("newmtl a b\nKd 1 0 0\n")
    (tmp_path / "second file.mtl").write_text("newmtl c\nKd 0 0 1\n")
    parts = read(tmp_path).parts
    assert sorted((part.colors[0].tolist(), len(part.faces)) for part in parts if part.colors is not None) == [
        ([0, 0, 255], 2),
        ([255, 0, 0], 2),
    ]
    (tmp_path / "one.obj").write_text(rows)
    (tmp_path / "one.mtl").write_text("newmtl a b\nKd 0 1 0\nnewmtl c\nKd 0 1 0\n")
    assert shown_color(read(tmp_path)) == [0, 255, 0]


def test_a_map_moves_and_scales_its_picture(tmp_path: Path) -> None:
    models.textured_box(tmp_path, "box", (0.05, 0.06, 0.07))
    models.picture(tmp_path / "t.png")
    (tmp_path / "box.mtl").write_text("newmtl paint\nmap_Kd -s 0.5 0.25 -o 0.1 0.5 t.png\n")
    (part,) = read(tmp_path).parts
    assert part.uvs is not None
    assert part.uvs.min(axis=(0, 1)) == pytest.approx((0.1, 0.5))
    assert part.uvs.max(axis=(0, 1)) == pytest.approx((0.6, 0.75))


def test_indices_from_the_end_count_from_where_they_stand(tmp_path: Path) -> None:
    box: Any = trimesh.creation.box((0.04, 0.05, 0.06))
    rows = [f"v {x} {y} {z}" for face in box.faces for x, y, z in box.vertices[face]]
    lines = [line for start in range(0, len(rows), 3) for line in (*rows[start : start + 3], "f -3 -2 -1")]
    (tmp_path / "box.obj").write_text("\n".join(lines))
    (part,) = read(tmp_path).parts
    assert mesh_volume(part.vertices, part.faces) == pytest.approx(0.04 * 0.05 * 0.06)


def test_colours_beside_the_vertices_of_an_obj_count(tmp_path: Path) -> None:
    text = models.TETRAHEDRON.replace("v 0 0 0\n", "v 0 0 0 1 0 0\n")
    for row in ("v .1 0 0", "v 0 .1 0", "v 0 0 .1"):
        text = text.replace(f"{row}\n", f"{row} 1.0 0 0\n")
    (tmp_path / "one.obj").write_text(text)
    assert shown_color(read(tmp_path)) == [255, 0, 0]


def write_stl(path: Path, header: bytes, attributes: list[int], tail: bytes = b"") -> None:
    """A binary STL box of 12 faces."""
    box: Any = trimesh.creation.box((30, 40, 50))
    data = bytearray(box.export(file_type="stl"))
    data[:80] = header.ljust(80, b" ")
    for number, attribute in enumerate(attributes):
        data[84 + 50 * number + 48 : 84 + 50 * number + 50] = struct.pack("<H", attribute)
    path.write_bytes(bytes(data) + tail)


@pytest.mark.parametrize(
    ("header", "attributes", "tail", "color"),
    [
        (b"solid made by a program", [0] * 12, b"", GREY),
        (b"solid made by a program", [0] * 12, b"\0\0\0", GREY),
        (b"made by another", [0x8000 | 31 << 10] * 12, b"", [255, 0, 0]),  # VisCAM: blue in the lowest bits
        (b"COLOR=\x0a\xc8\x1e\xff", [31] * 12, b"", [255, 0, 0]),  # Materialise: red in the lowest bits
        (b"COLOR=\x0a\xc8\x1e\xff", [0x8000] * 12, b"", [10, 200, 30]),
    ],
)
def test_binary_stl_is_told_by_its_bytes(
    tmp_path: Path, header: bytes, attributes: list[int], tail: bytes, color: list[int]
) -> None:
    write_stl(tmp_path / "box.stl", header, attributes, tail)
    model = read(tmp_path)
    assert extents(model) == [30, 40, 50]
    assert shown_color(model) == color


@pytest.mark.parametrize("change", [str, str.upper, lambda text: text.replace("\n", "\r\n")])
def test_all_solids_of_a_text_stl_are_read(tmp_path: Path, change: Any) -> None:
    box: Any = trimesh.creation.box((30, 40, 50))
    other: Any = trimesh.creation.box((30, 40, 50)).apply_translation((100, 0, 0))
    text = box.export(file_type="stl_ascii") + other.export(file_type="stl_ascii").replace("solid", "solid vertex one")
    (tmp_path / "two.stl").write_text(change(text), newline="")
    assert extents(read(tmp_path)) == [130, 40, 50]


@pytest.mark.parametrize(
    ("head", "color"),
    [
        ("OFF\n# made by hand\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n", GREY),
        ("OFF4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n", GREY),
        ("COFF\n4 4 0\n0 0 0 255 0 0 255\n1 0 0 255 0 0 255\n0 1 0 255 0 0 255\n0 0 1 255 0 0 255\n", [255, 0, 0]),
    ],
)
def test_off_is_read_with_its_colours(tmp_path: Path, head: str, color: list[int]) -> None:
    (tmp_path / "one.off").write_text(head + "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n")
    assert shown_color(read(tmp_path)) == color
    (tmp_path / "one.off").write_text(head + "".join(f"3 {face} 0 0 255\n" for face in ("0 2 1", "0 1 3", "1 2 3")))
    with pytest.raises(RefusedError, match=r"one\.off"):
        (tmp_path / "one.off").write_text(head + "3 0 2 9\n")
        read(tmp_path)


def test_3mf_is_read_as_its_build_has_it(tmp_path: Path) -> None:
    models.write_3mf(tmp_path / "print.3mf")
    model = read(tmp_path)
    assert model.unit == "m" and extents(model) == [0.14, 0.04, 0.04]
    colors = {tuple(rgb) for part in model.parts if part.colors is not None for rgb in part.colors.tolist()}
    assert colors == {tuple(GREY), (255, 0, 0), (0, 0, 255)}
    (textured,) = [part for part in model.parts if part.image is not None]
    assert textured.image is not None and textured.image[0, 0].tolist() == [10, 200, 10]


def test_a_3mf_that_unpacks_to_more_than_its_size_allows_is_refused(tmp_path: Path) -> None:
    models.zipped(tmp_path / "bomb.3mf", {})
    with models.zipfile.ZipFile(tmp_path / "bomb.3mf", "w", models.zipfile.ZIP_DEFLATED) as file:
        file.writestr("3D/3dmodel.model", bytes(60_000_000))
    source = SourceFolder(tmp_path, 100_000_000)
    with pytest.raises(RefusedError, match="unpacks to more"):
        read_mesh(source, "bomb.3mf", ImportOptions().limits)


BOX = '<geometry><box size=".1 .1 .1"/></geometry>'


def write_urdf(
    folder: Path, visual: str, collision: str = "", before: str = "", mass: str = '<mass value="0.2"/>'
) -> None:
    """A URDF of one link."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "thing.urdf").write_text(
        f'<?xml version="1.0"?><robot name="r">{before}<link name="l"><inertial>{mass}</inertial><visual>{visual}'
        f"</visual><collision>{collision or BOX}</collision></link></robot>"
    )


MESH = '<geometry><mesh filename="box.obj"/></geometry>'


@pytest.mark.parametrize(
    ("visual", "before", "color", "note"),
    [
        (f'{MESH}<material name="m"><texture filename="T.png"/></material>', "", list(GREEN), ""),
        (
            f'{MESH}<material name="m"/>',
            '<material name="m"><color rgba="1 1 1 1"/><texture filename="package://any/t.png"/></material>',
            list(GREEN),
            "",
        ),
        (f'{MESH}<material name="m"><color rgba="1 1 0 1"/></material>', "", [255, 255, 0], "box.mtl"),
        (f'{MESH}<material name="m"><color rgba="255 255 0"/></material>', "", [255, 255, 0], "box.mtl"),
        (f'{MESH}<material name="m"><color rgba="sunny"/></material>', "", GREY, "no colour"),
        (f'{MESH}<material name="m"><texture filename="gone.png"/></material>', "", GREY, "gone.png"),
        (
            '<geometry><box size=".1 .1 .1"/></geometry><material name="m"><texture filename="t.png"/></material>',
            "",
            list(GREEN),
            "mean colour",
        ),
        (
            '<geometry><mesh filename="box.stl"/></geometry><material name="m"><texture filename="t.png"/></material>',
            "",
            list(GREEN),
            "no texture coordinates",
        ),
        (
            '<geometry><mesh filename="D:\\work\\robot\\box.stl"/></geometry><xacro:note/>',
            '<!-- made by a macro --><gazebo:plugin x:name="y"/>',
            GREY,
            "",
        ),
        ('<geometry><capsule radius="0.02" length="0.06"/></geometry>', "", [178, 178, 178], ""),
    ],
)
def test_the_look_that_a_urdf_gives_is_shown(
    tmp_path: Path, visual: str, before: str, color: list[int], note: str
) -> None:
    write_urdf(tmp_path, visual, before=before)
    models.picture(tmp_path / "t.png", GREEN, GREEN)
    models.textured_box(tmp_path, "box", (0.1, 0.1, 0.1))
    (tmp_path / "box.mtl").unlink()
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "box.stl")
    model = read(tmp_path, "thing.urdf")
    assert np.abs(np.subtract(shown_color(model), color)).max() <= 1
    assert note in " ".join(model.notes)
    assert max(extents(model)) == pytest.approx(0.1)


def test_what_only_collides_needs_no_look(tmp_path: Path) -> None:
    models.textured_box(tmp_path, "hull", (0.1, 0.1, 0.1), "gone.png")
    write_urdf(tmp_path, '<geometry><box size=".1 .1 .1"/></geometry>', MESH.replace("box", "hull"))
    model = read(tmp_path)
    assert model.colliders is not None and len(model.colliders) == 1
    assert not model.notes


@pytest.mark.parametrize("scale", ["1 -1 1", "-0.5 1 2", "-1 -1 -1", "0.001"])
def test_a_mirrored_mesh_is_mirrored_with_its_outside_out(tmp_path: Path, scale: str) -> None:
    (tmp_path / "t.obj").write_text(models.TETRAHEDRON)
    factors = np.array([float(word) for word in scale.split()])
    mesh = f'<geometry><mesh filename="t.obj" scale="{scale}"/></geometry>'
    write_urdf(tmp_path, mesh, mesh)
    model = read(tmp_path)
    (part,) = model.parts
    corners = np.array([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)]) * factors
    assert np.sort(part.vertices, axis=0) == pytest.approx(np.sort(corners, axis=0))
    volume = 0.1**3 / 6 * abs(float(np.prod(factors * np.ones(3))))
    assert mesh_volume(part.vertices, part.faces) == pytest.approx(volume)


@pytest.mark.parametrize("mass", ["-1", "nan", "heavy", "1e9"])
def test_a_mass_that_cannot_be_is_estimated(tmp_path: Path, mass: str) -> None:
    write_urdf(tmp_path, '<geometry><box size=".1 .1 .1"/></geometry>', mass=f'<mass value="{mass}"/>')
    model = read(tmp_path)
    assert model.mass is None and mass in model.notes[0]


VERTICES, FACES = "0 0 0 .1 0 0 0 .2 0 0 0 .3 .05 .05 .05", "0 2 1 0 1 3 1 2 3 0 3 2"


def write_mjcf(folder: Path, assets: str, geoms: str, world: str = "") -> Path:
    """An MJCF of one body."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "thing.xml"
    path.write_text(f"<mujoco>{assets}<worldbody>{world}<body>{geoms}</body></worldbody></mujoco>")
    return path


@pytest.mark.parametrize("seed", range(4))
def test_a_mesh_of_mjcf_lies_where_mujoco_puts_it(tmp_path: Path, seed: int) -> None:
    """Reference pose, scale of a class (mirrored, too) and inline vertices, against MuJoCo's own compiler."""
    rng = np.random.default_rng(seed)
    scale, place = rng.choice([-1, 1], 3) * rng.uniform(0.5, 2, 3), rng.normal(size=3) * 0.1
    turn, geom_turn = rng.normal(size=4), rng.normal(size=4)
    words = {name: " ".join(map(str, values)) for name, values in (("s", scale), ("p", place), ("q", turn))}
    assets = (
        f'<default><mesh scale="{words["s"]}"/></default><asset><mesh name="m" vertex="{VERTICES}" face="{FACES}" '
        f'refpos="{words["p"]}" refquat="{words["q"]}"/></asset>'
    )
    geom = f'<geom type="mesh" mesh="m" pos="{words["p"]}" quat="{" ".join(map(str, geom_turn))}"/>'
    path = write_mjcf(tmp_path, assets, geom)
    (part,) = read(tmp_path).parts
    compiled: Any = mujoco.MjModel.from_xml_path(str(path))
    data: Any = mujoco.MjData(compiled)
    mujoco.mj_forward(compiled, data)
    truth = compiled.mesh_vert @ data.geom_xmat[0].reshape(3, 3).T + data.geom_xpos[0]
    mine = part.vertices[np.unique(part.faces)]
    assert np.linalg.norm(mine[:, None] - truth[None], axis=2).min(axis=1).max() < 1e-6
    assert mesh_volume(part.vertices, part.faces) > 0


def test_textures_classes_and_inline_coordinates_of_mjcf_count(tmp_path: Path) -> None:
    models.picture(tmp_path / "art" / "Label.PNG", GREEN, GREEN)
    assets = (
        '<compiler texturedir="art"/><default><default class="look"><geom type="mesh" material="paint" contype="0" '
        'conaffinity="0"/><material rgba="0 0 1 1"/></default></default><asset><texture name="t" type="2d" '
        'file="label.png"/><texture name="flat" builtin="flat" type="2d" rgb1="1 0 0" width="4" height="4"/>'
        '<material name="paint" class="look"><layer texture="t" role="rgb"/></material>'
        '<material name="red" texture="flat"/><material name="plain" class="look"/>'
        f'<mesh name="m" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1" face="{FACES}" texcoord="0 0 1 0 0 1 1 1"/></asset>'
    )
    touch = '<geom type="box" size=".05 .05 .05"/>'
    world = '<geom type="plane" size="1 1 1"/><light pos="0 0 3"/>'
    for look, color in (('class="look"', list(GREEN)), ('class="look" material="red"', [255, 0, 0])):
        write_mjcf(tmp_path, assets, f'<geom {look} mesh="m"/>{touch}', world)
        assert shown_color(read(tmp_path)) == color
    write_mjcf(tmp_path, assets, f'<geom class="look" material="plain" mesh="m"/>{touch}', world)
    assert shown_color(read(tmp_path)) == [0, 0, 255]
    write_mjcf(tmp_path, assets, f'<geom class="look" mesh="m"/><geom type="mesh" mesh="m"/>{touch}')
    assert read(tmp_path).mass is None  # a mesh that collides is weighed from its volume


@pytest.mark.parametrize(
    ("mesh", "geom", "words"),
    [
        ('builtin="sphere" params="2"', 'type="mesh" mesh="m"', "builtin"),
        (f'vertex="{VERTICES}"', 'type="box" mesh="m" fitscale="1.1"', "fits a box"),
        (f'vertex="{VERTICES}"', 'mesh="m"', "fits a sphere"),
        (f'vertex="{VERTICES}" face="0 1 9"', 'type="mesh" mesh="m"', "do not fit"),
        (f'vertex="{VERTICES}" scale="1 0 1"', 'type="mesh" mesh="m"', "flattens"),
        (f'vertex="{VERTICES}" refquat="0 0 0 0"', 'type="mesh" mesh="m"', "refquat"),
        (f'vertex="{VERTICES}"', 'type="mesh" mesh="other"', "not among the assets"),
    ],
)
def test_what_is_not_applied_of_mjcf_is_refused_by_name(tmp_path: Path, mesh: str, geom: str, words: str) -> None:
    write_mjcf(tmp_path, f'<asset><mesh name="m" {mesh}/></asset>', f"<geom {geom}/>")
    with pytest.raises(RefusedError, match=words):
        read(tmp_path)


def test_a_gazebo_model_is_read_in_its_newest_version(tmp_path: Path) -> None:
    home = tmp_path / "carton"
    models.write_sdf(home)
    models.write_sdf(home, "1.4").write_text("<sdf/>")
    (home / "model.config").write_text(
        '<?xml version="1.0"?><model><name>Картон milk</name><sdf version="1.4">model-1.4.sdf</sdf>'
        '<sdf version="1.6">model.sdf</sdf></model>'
    )
    (item,) = find_source_items(SourceFolder(tmp_path, 1_000_000))
    assert (item.name, item.title, item.file) == ("Karton_milk", "Картон milk", "carton/model.sdf")
    model = read_item(tmp_path, item)
    assert model.mass is not None and model.mass.value == pytest.approx(0.3)
    assert model.friction is not None and model.friction.value == pytest.approx(0.8)
    assert extents(model) == [0.06, 0.04, 0.12]  # the link is turned by 90 degrees, the ball stands out by 2 cm
    assert model.colliders is not None and len(model.colliders) == 1
    body, ball = model.parts
    assert body.image is not None and body.image[0, 0].tolist() == list(GREEN)
    assert ball.vertices.mean(axis=0) == pytest.approx((0.0, 0.01, 0.11), abs=1e-3)
    assert ball.colors is not None and ball.colors[0].tolist() == [217, 41, 41]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("</model>", "<include><uri>model://x</uri></include></model>", "include"),
        ("</model>", '<joint name="j" type="revolute"/></model>', "revolute"),
        ("</model>", "</model><model name='n'/>", "2 models"),
        ("<sphere><radius>0.01</radius></sphere>", "<plane><normal>0 0 1</normal></plane>", "<plane>"),
        ("0.01 0 0.06", "0.01 0 nan", "<pose>"),
        ("<pose>0.01", '<pose relative_to="lid">0.01', "'lid'"),
        ("body.obj</uri>", "body.obj</uri><submesh><name>x</name></submesh>", "submesh"),
        ("body.obj</uri>", "../../../../etc/passwd</uri>", "passwd"),
    ],
)
def test_what_is_not_read_of_sdf_is_refused_by_name(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = models.write_sdf(tmp_path / "carton")
    path.write_text(path.read_text().replace(old, new))
    (item,) = find_source_items(SourceFolder(tmp_path, 1_000_000))
    with pytest.raises(RefusedError, match=words):
        read_item(tmp_path, item)


@pytest.mark.parametrize(
    ("name", "slug"),
    [
        ("звезда", "zvezda"),
        ("りんご", "ringo"),
        ("马克杯", "u9a6c_u514b_u676f"),
        ("사과", "sagwa"),
        ("κύπελλο", "kypello"),
        ("Größe", "Grosse"),
        ("café blue", "cafe_blue"),
        ("Łódź", "Lodz"),
    ],
)
def test_names_in_other_scripts_can_be_told_apart(name: str, slug: str) -> None:
    assert slugify_name(name) == slug


@pytest.mark.parametrize("seed", range(3))
def test_broken_files_are_refused_and_nothing_else_happens(tmp_path: Path, seed: int) -> None:
    """Files with bytes changed, cut out and put in, 40 for each seed."""
    rng = random.Random(seed)
    words = (b"nan", b"1e309", b"-1", b"99999999999", b"\0", b'"', b"<", b"/", b"\n", b"f ", b"\xff", b"..", b"solid ")
    models.write_sdf(tmp_path / "sdf")
    models.write_3mf(tmp_path / "print.3mf")
    write_stl(tmp_path / "box.stl", b"COLOR=abcd", [31] * 12)
    write_urdf(tmp_path / "urdf", MESH)
    models.textured_box(tmp_path / "urdf", "box", (0.1, 0.1, 0.1))
    inline = f'<asset><mesh name="m" vertex="{VERTICES}" face="{FACES}" scale="1 -1 1" refpos="0 0 1"/></asset>'
    write_mjcf(tmp_path / "mjcf", inline, '<geom type="mesh" mesh="m"/>')
    (tmp_path / "one.off").write_text("OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n4 0 1 3 2\n")
    whole = {path: path.read_bytes() for path in sorted(tmp_path.rglob("*")) if path.is_file()}
    refused = 0
    for _ in range(40):
        path, data = rng.choice(list(whole.items()))
        changed = bytearray(data)
        for _ in range(rng.randint(1, 6)):
            at = rng.randrange(len(changed) + 1)
            changed[at : at + rng.choice((0, 0, 1, 20))] = rng.choice(words)
        path.write_bytes(bytes(changed))
        for item in find_source_items(SourceFolder(tmp_path, 10_000_000)):
            try:
                read_item(tmp_path, item)
            except RefusedError:
                refused += 1
        path.write_bytes(data)
    assert refused


BLANKS = " \t" * 100_000
HOSTILE: dict[str, dict[str, str]] = {
    "uri": {"model.sdf": f"<sdf><model><uri>{BLANKS}"},
    "version": {"model.config": f"<model><sdf>{BLANKS}"},
    "long version": {"model.config": f"<model><sdf version='{'9' * 5_000}'>model.sdf</sdf>"},
    "name": {"model.config": f"<model><name>{BLANKS}"},
    "long name": {"model.config": f"<model><sdf>{'x' * 5_000}.sdf</sdf></model>"},
    "file": {"box.urdf": f"<robot filename{BLANKS}"},
}


def find_items(folder: str) -> None:
    source = SourceFolder(Path(folder), 10_000_000)
    for item in find_source_items(source):
        find_item_files(source, item)


def refuse_urdf(folder: Path) -> None:
    with pytest.raises(RefusedError):
        read_item(folder, SourceItem(kind="urdf", name="box", file="box.urdf"))


def run_within(seconds: float, call: Callable[..., object], *args: object) -> None:
    """Run a call in a process that the kernel ends after so many seconds of processor time."""
    process = multiprocessing.get_context("fork").Process(target=_run_limited, args=(seconds, call, *args))
    process.start()
    process.join()
    assert process.exitcode == 0


def _run_limited(seconds: float, call: Callable[..., object], *args: object) -> None:
    used = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    most = int(used + seconds) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (most, most))
    call(*args)


@pytest.mark.parametrize("kind", HOSTILE)
def test_text_of_strangers_is_searched_once(tmp_path: Path, kind: str) -> None:
    for name, text in HOSTILE[kind].items():
        (tmp_path / name).write_text(text)
    run_within(5, find_items, str(tmp_path))


@pytest.mark.parametrize("text", ["<?xml ?" * 100_000, "<r " + "".join(f"<p{n}:a>" for n in range(100_000))])
def test_xml_of_strangers_is_mended_once(tmp_path: Path, text: str) -> None:
    (tmp_path / "box.urdf").write_text(text)
    run_within(5, refuse_urdf, tmp_path)


@pytest.mark.parametrize("deep", [0, 6])
def test_names_that_an_mtl_gives_without_end_cost_little(tmp_path: Path, deep: int) -> None:
    home = tmp_path.joinpath(*["d"] * deep)
    home.mkdir(parents=True, exist_ok=True)
    for number in range(500):
        (home / f"other{number}.txt").touch()
    (home / "a.obj").write_text("".join(f"mtllib /x/y/n{number}.mtl\n" for number in range(5_000)) + "mtllib a.mtl\n")
    lines = (f"newmtl m{number}\nmap_Kd /a/b/c/{number}.png\n" for number in range(30_000))
    (home / "a.mtl").write_text("".join(lines) + "map_Kd -s" + " 1" * 200_000 + "\nmap_Kd " + "a/" * 200_000)
    (home / "b.obj").write_text("v 0 0 0\nmtllib " + "x " * 500_000 + "\nmtllib a.mtl\n")
    run_within(8, find_items, str(tmp_path))


def test_an_archive_beside_assets_is_told_once(tmp_path: Path) -> None:
    models.textured_box(tmp_path / "source", "a", (0.05, 0.06, 0.07))
    for name in ("b.tar.gz", "c.gz", "d/e.tar.gz"):
        (tmp_path / "source" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "source" / name).write_bytes(b"")
    with open_import_source(str(tmp_path / "source"), ImportOptions()) as source:
        assert [name for name, _ in source.refused] == ["b.tar.gz"]
        assert [outcome.source for outcome in source.unread] == ["c.gz", "d/e.tar.gz"]
