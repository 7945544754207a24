"""Small real models, written by trimesh, and broken ones, written by hand."""

import io
import json
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from tests.library.importing.gltf_files import GltfFile

RED, BLUE = (220, 30, 30), (30, 60, 200)


def picture(path: Path, top: tuple[int, int, int] = RED, bottom: tuple[int, int, int] = BLUE) -> Path:
    """A PNG whose upper half has one colour and whose lower half another."""
    pixels = np.zeros((32, 32, 3), np.uint8)
    pixels[:16], pixels[16:] = top, bottom
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path)
    return path


def textured_box(folder: Path, name: str, size: tuple[float, float, float], texture: str = "texture_map.png") -> Path:
    """An OBJ box with an MTL and a texture: the picture's upper half is on the upper half of the sides."""
    x, y, z = (extent / 2 for extent in size)
    ring = [(x, -y), (x, y), (-x, y), (-x, -y)]
    lines = [f"mtllib {name}.mtl", "usemtl paint"]
    lines += [f"v {a} {b} {c}" for c in (-z, z) for a, b in ring]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
    for one in range(4):
        other = (one + 1) % 4
        a, b, c, d = one + 1, other + 1, other + 5, one + 5
        lines += [f"f {a}/1 {b}/2 {c}/3", f"f {a}/1 {c}/3 {d}/4"]
    lines += ["f 1/1 4/1 3/1", "f 1/1 3/1 2/1", "f 5/4 6/4 7/4", "f 5/4 7/4 8/4"]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.obj"
    path.write_text("\n".join([*lines, ""]))
    (folder / f"{name}.mtl").write_text(f"newmtl paint\nmap_Kd {texture}\n")
    return path


def bowl(scale: float = 1.0) -> Any:
    """A closed bowl, 16 cm wide, 6 cm high, 8 mm thick."""
    outer = np.array([(0.0, -0.03), (0.05, -0.03), (0.08, 0.03), (0.072, 0.03), (0.046, -0.022), (0.0, -0.022)])
    return trimesh.creation.revolve(outer * scale, sections=24)


def write_many(folder: Path) -> None:
    """A folder with an OBJ, a GLB, an STL in millimetres, a PLY, and a URDF and an MJCF with meshes of their own."""
    textured_box(folder / "carton", "carton", (0.07, 0.07, 0.19))
    picture(folder / "carton" / "texture_map.png")
    box = trimesh.creation.box((0.06, 0.16, 0.10))
    box.visual = TextureVisuals(material=PBRMaterial(baseColorFactor=[20, 160, 60, 255]))
    trimesh.Scene(box).export(folder / "crate.glb")
    trimesh.creation.cylinder(33, 80).export(folder / "tin.stl")
    bowl().export(folder / "bowl.ply")
    write_urdf(folder / "robot" / "block.urdf")
    write_mjcf(folder / "scenes" / "can.xml")


def write_urdf(path: Path, mesh: str = "package://things/meshes/block.stl") -> Path:
    """A URDF whose only link has an STL mesh, a mass of 0.4 kg and a friction of 0.9."""
    (path.parent / "meshes").mkdir(parents=True, exist_ok=True)
    trimesh.creation.box((0.08, 0.05, 0.04)).export(path.parent / "meshes" / "block.stl")
    shape = f'<origin xyz="0 0 0.02"/><geometry><mesh filename="{mesh}"/></geometry>'
    path.write_text(
        '<robot name="block"><link name="block"><contact><lateral_friction value="0.9"/></contact>'
        '<inertial><mass value="0.4"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
        f'<visual>{shape}<material name="m"><color rgba="0.9 0.8 0.1 1"/></material></visual>'
        f"<collision>{shape}</collision></link></robot>"
    )
    return path


def write_mjcf(path: Path, file: str = "can.obj", texture: str = "label.png") -> Path:
    """An MJCF of one body: a textured mesh to look at and a cylinder to touch."""
    path.parent.mkdir(parents=True, exist_ok=True)
    textured_box(path.parent / "parts", "can", (6.6, 6.6, 8.4), "label.png")
    picture(path.parent / "parts" / "label.png", (20, 130, 60), (240, 220, 60))
    path.write_text(
        '<mujoco><compiler meshdir="parts" texturedir="parts"/><asset>'
        f'<texture name="t" type="2d" file="{texture}"/><material name="m" texture="t"/>'
        f'<mesh name="can" file="{file}" scale="0.01 0.01 0.01"/></asset>'
        '<worldbody><body><geom type="mesh" mesh="can" material="m" contype="0" conaffinity="0"/>'
        '<geom type="cylinder" size="0.033 0.042" density="800" friction="0.7 0 0"/></body></worldbody></mujoco>'
    )
    return path


def write_dae(path: Path, size: tuple[float, float, float], meter: str, up: str) -> Path:
    """A red COLLADA box in the file's unit, with the file's axis up."""
    box: Any = trimesh.creation.box(size)
    numbers = " ".join(f"{value:.6g}" for value in box.vertices.ravel())
    faces = " ".join(str(index) for index in box.faces.ravel())
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f'<asset><unit name="its" meter="{meter}"/><up_axis>{up}</up_axis></asset>'
        '<library_effects><effect id="e"><profile_COMMON><technique sid="c"><lambert><diffuse>'
        "<color>0.85 0.1 0.1 1</color></diffuse></lambert></technique></profile_COMMON></effect></library_effects>"
        '<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>'
        f'<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="24">{numbers}'
        '</float_array><technique_common><accessor source="#a" count="8" stride="3"><param name="X" type="float"/>'
        '<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>'
        '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices><triangles count="12" material="s">'
        f'<input semantic="VERTEX" source="#v" offset="0"/><p>{faces}</p></triangles></mesh></geometry>'
        '</library_geometries><library_visual_scenes><visual_scene id="w"><node id="n"><instance_geometry url="#g">'
        '<bind_material><technique_common><instance_material symbol="s" target="#m"/></technique_common>'
        "</bind_material></instance_geometry></node></visual_scene></library_visual_scenes>"
        '<scene><instance_visual_scene url="#w"/></scene></COLLADA>'
    )
    return path


def write_ycb(root: Path) -> Path:
    """A YCB-style folder with one object and a point cloud that is not read."""
    home = root / "006_mustard_bottle"
    textured_box(home / "google_16k", "textured", (0.058, 0.096, 0.19))
    picture(home / "google_16k" / "texture_map.png", (230, 190, 20), (230, 190, 20))
    (home / "clouds").mkdir()
    (home / "clouds" / "merged_cloud.ply").write_bytes(b"ply\n")
    return root


def write_gso(root: Path) -> Path:
    """A folder as Google Scanned Objects has them: the picture is not beside the mesh that names it."""
    home = root / "Red_Block_Toy"
    textured_box(home / "meshes", "model", (0.05, 0.05, 0.05), "texture.png")
    (home / "meshes" / "model.mtl").write_text("newmtl paint\nmap_Kd texture.png\n")
    picture(home / "materials" / "textures" / "texture.png", RED, RED)
    return root


def write_hope(root: Path) -> Path:
    """Two kinds as the HOPE packages have them, in centimetres with y up or z up, and a recoloured copy."""
    home = root / "stable_hope_objects"
    textured_box(home / "milk", "textured", (7.2, 19.0, 7.3))
    textured_box(home / "bbq_sauce", "bbq_sauce", (6.5, 4.3, 14.8))
    textured_box(home / "red_milk", "textured", (7.2, 19.0, 7.3))
    write_msh(home / "cookies" / "visual" / "cookies_vis.msh", (12.3, 16.7, 4.0))
    for kind in ("milk", "bbq_sauce", "red_milk", "cookies"):
        picture(home / kind / "texture_map.png")
    return root


def write_msh(path: Path, size: tuple[float, float, float]) -> None:
    """A box in MuJoCo's binary format."""
    box: Any = trimesh.creation.box(size)
    vertices, faces = np.asarray(box.vertices, "<f4"), np.asarray(box.faces, "<i4")
    uvs = np.zeros((len(vertices), 2), "<f4")
    path.parent.mkdir(parents=True, exist_ok=True)
    counts = struct.pack("<4i", len(vertices), 0, len(vertices), len(faces))
    path.write_bytes(counts + vertices.tobytes() + uvs.tobytes() + faces.tobytes())


def write_malformed(folder: Path) -> dict[str, str]:
    """Files that must be refused; what the reason of each must tell."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "nan.obj").write_text("v 0 0 0\nv 1 nan 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\nf 2 3 4\nf 1 2 4\n")
    (folder / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n")
    (folder / "flat.obj").write_text("v 0 0 0\nv .1 0 0\nv 0 .1 0\nv .1 .1 0\nf 1 2 3\nf 2 4 3\n")
    (folder / "wild.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    (folder / "noise.glb").write_bytes(b"glTF" + bytes(range(200)))
    (folder / "empty.glb").touch()
    (folder / "static.stl").write_bytes(b"solid nothing")
    header = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nelement face 10000000\nend_header\n"
    (folder / "huge.ply").write_bytes(header)
    with (folder / "vast.stl").open("wb") as file:
        file.write(bytes(80) + struct.pack("<I", 10_000_000))
        file.truncate(84 + 50 * 10_000_000)
    write_urdf(folder / "sly_urdf" / "sly.urdf", "../../../../etc/passwd")
    write_mjcf(folder / "sly_mjcf" / "sly.xml", "../../../../../etc/passwd")
    entity = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    (folder / "entities.urdf").write_text(f'{entity}<robot name="&b;"><link name="x"/></robot>')
    (folder / "entities.dae").write_text(f"{entity}<COLLADA>&b;</COLLADA>")
    sly = GltfFile()
    sly.write(folder / "sly_buffer.gltf", "data")
    sly.json["buffers"][0]["uri"] = "../../../../etc/passwd"
    (folder / "sly_buffer.gltf").write_text(json.dumps(sly.json))
    return {
        "nan.obj": "not finite",
        "points.obj": "face",
        "flat.obj": "one plane",
        "empty.glb": "empty.glb is empty",
        "huge.ply": "10000000 faces",
        **dict.fromkeys(("wild.obj", "noise.glb", "static.stl", "vast.stl"), ""),
        **dict.fromkeys(("entities.urdf", "entities.dae"), "entities"),
        **dict.fromkeys(("sly_buffer.gltf",), "leaves the source"),
        **dict.fromkeys(("sly_urdf/sly.urdf", "sly_mjcf/sly.xml"), "leaves the source"),
    }


TETRAHEDRON = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def write_3mf(path: Path) -> Path:
    """A 3MF file as slicers write them: an object of two colours, placed twice by components, one of them from another
    file, a face with a picture, and a support that is no part of it."""
    buffer = io.BytesIO()
    Image.new("RGB", (4, 4), (10, 200, 10)).save(buffer, "PNG")
    core, material, production = (
        f'xmlns{prefix}="http://schemas.microsoft.com/3dmanufacturing/{name}"'
        for prefix, name in (("", "core/2015/02"), (":m", "material/2015/02"), (":p", "production/2015/06"))
    )
    corners = ((0, 0, 0), (40, 0, 0), (0, 40, 0), (0, 0, 40))
    points = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in corners)
    looks = ("", ' pid="1" p1="1"', ' pid="8" p1="0" p2="1" p3="2"', "")
    faces = ("021", "013", "123", "032")
    triangles = [f'<triangle v1="{a}" v2="{b}" v3="{c}"{look}/>' for (a, b, c), look in zip(faces, looks, strict=True)]
    mesh = f"<mesh><vertices>{points}</vertices><triangles>{''.join(triangles)}</triangles></mesh>"
    main = (
        f'<model unit="millimeter" {core} {material} {production}><resources><basematerials id="1">'
        '<base name="r" displaycolor="#FF0000FF"/><base name="b" displaycolor="#0000FF"/></basematerials>'
        '<m:texture2d id="7" path="/3D/t.png" contenttype="image/png"/><m:texture2dgroup id="8" texid="7">'
        '<m:tex2coord u="0" v="0"/><m:tex2coord u="1" v="0"/><m:tex2coord u="0" v="1"/></m:texture2dgroup>'
        f'<object id="2" pid="1" pindex="0">{mesh}</object><object id="9" type="support">{mesh}</object>'
        '<object id="3"><components><component objectid="2" transform="1 0 0 0 1 0 0 0 1 100 0 0"/>'
        '<component objectid="5" p:path="/3D/other.model"/></components></object></resources>'
        '<build><item objectid="3"/><item objectid="9"/></build></model>'
    )
    other = f'<model {core}><resources><object id="5">{mesh}</object></resources><build/></model>'
    kind = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
    relations = f'<Relationships><Relationship Target="/3D/main.model" Id="a" Type="{kind}"/></Relationships>'
    texts = {"_rels/.rels": relations, "3D/main.model": main, "3D/other.model": other}
    return zipped(path, {name: text.encode() for name, text in texts.items()} | {"3D/t.png": buffer.getvalue()})


def write_sdf(folder: Path, version: str = "1.6") -> Path:
    """A model as Gazebo has them: a textured mesh by its ``model://`` name, a red ball above it, a box that touches."""
    textured_box(folder / "meshes", "body", (0.04, 0.06, 0.10), "gone.png")
    picture(folder / "materials" / "textures" / "Body.PNG", (20, 160, 60), (20, 160, 60))
    path = folder / ("model.sdf" if version == "1.6" else f"model-{version}.sdf")
    path.write_text(
        f'<?xml version="1.0"?><sdf version="{version}"><model name="m"><pose>5 5 5 0 0 0</pose><link name="l">'
        '<pose degrees="true">0 0 0.05 0 0 90</pose><inertial><mass>0.3</mass></inertial><visual name="v"><geometry>'
        f"<mesh><uri>model://{folder.name}/meshes/body.obj</uri></mesh></geometry><material><pbr><metal><albedo_map>"
        'materials\\textures\\body.png</albedo_map></metal></pbr></material></visual><visual name="b"><pose>0.01 0 0.06'
        " 0 0 0</pose><geometry><sphere><radius>0.01</radius></sphere></geometry><material><script><name>Gazebo/Red"
        '</name></script></material></visual><collision name="c"><geometry><box><size>0.04 0.06 0.1</size></box>'
        "</geometry><surface><friction><ode><mu>0.8</mu></ode></friction></surface></collision></link></model></sdf>"
    )
    return path


def zip_bomb(path: Path, megabytes: int = 120) -> Path:
    """A zip file of one mesh that unpacks to ``megabytes``, 1000 times its size."""
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as zipped,
        zipped.open("big.obj", "w", force_zip64=True) as file,
    ):
        for _ in range(megabytes):
            file.write(bytes(1_000_000))
    return path


def zipped(path: Path, files: dict[str, bytes]) -> Path:
    """A zip file."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    path.write_bytes(buffer.getvalue())
    return path
