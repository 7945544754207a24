"""A glTF 2.0 or GLB file: its checked JSON, its buffers, and the numbers and pictures in them.
Every offset and count is checked against the file before anything is read."""

import binascii
import importlib
import os
import re
import struct
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeVar
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.alias_generators import to_camel

from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.types import Floats, ImportLimits, Ints, RefusedError

Index = Annotated[int, Field(ge=0, le=2**40)]
_Rgb = tuple[float, float, float]
_Factor = Annotated[tuple[float, ...], Field(min_length=3, max_length=4)]
_Bytes = npt.NDArray[np.uint8]
_T = TypeVar("_T")


class _Node(BaseModel):
    """An object of the JSON: names in camelCase, unknown names ignored, as glTF demands."""

    model_config = ConfigDict(alias_generator=to_camel, extra="ignore", allow_inf_nan=False, frozen=True)


class TextureTransform(_Node):
    """KHR_texture_transform."""

    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)
    tex_coord: Index | None = None


class _TextureInfoExtensions(_Node):
    transform: TextureTransform | None = Field(default=None, alias="KHR_texture_transform")


class TextureInfo(_Node):
    """A texture and the set of coordinates that it lies at."""

    index: Index
    tex_coord: Index = 0
    extensions: _TextureInfoExtensions = _TextureInfoExtensions()


class _Pbr(_Node):
    base_color_factor: _Factor = (1.0, 1.0, 1.0, 1.0)
    base_color_texture: TextureInfo | None = None


class _SpecularGlossiness(_Node):
    diffuse_factor: _Factor = (1.0, 1.0, 1.0, 1.0)
    diffuse_texture: TextureInfo | None = None


class _MaterialExtensions(_Node):
    specular_glossiness: _SpecularGlossiness | None = Field(default=None, alias="KHR_materials_pbrSpecularGlossiness")


class Material(_Node):
    """The properties of a material that its base colour depends on."""

    pbr_metallic_roughness: _Pbr = _Pbr()
    emissive_factor: _Rgb = (0.0, 0.0, 0.0)
    emissive_texture: TextureInfo | None = None
    alpha_mode: str = "OPAQUE"
    alpha_cutoff: float = 0.5
    extensions: _MaterialExtensions = _MaterialExtensions()


class _Sampler(_Node):
    wrap_s: int = 10497
    wrap_t: int = 10497


class _ImageSource(_Node):
    source: Index | None = None


class _TextureExtensions(_Node):
    webp: _ImageSource = Field(default=_ImageSource(), alias="EXT_texture_webp")
    avif: _ImageSource = Field(default=_ImageSource(), alias="EXT_texture_avif")
    dds: _ImageSource = Field(default=_ImageSource(), alias="MSFT_texture_dds")
    basisu: _ImageSource = Field(default=_ImageSource(), alias="KHR_texture_basisu")


class Texture(_Node):
    """A picture and how it continues beyond its edges."""

    source: Index | None = None
    sampler: Index | None = None
    extensions: _TextureExtensions = _TextureExtensions()

    def image(self) -> int | None:
        """The number of its picture, preferably in a format of glTF itself."""
        extensions = self.extensions
        choices = (self, extensions.webp, extensions.avif, extensions.dds, extensions.basisu)
        return next((choice.source for choice in choices if choice.source is not None), None)


class _Image(_Node):
    uri: str | None = None
    buffer_view: Index | None = None


class _Draco(_Node):
    buffer_view: Index
    attributes: dict[str, Index]


class _PrimitiveExtensions(_Node):
    draco: _Draco | None = Field(default=None, alias="KHR_draco_mesh_compression")


class Primitive(_Node):
    """Triangles, lines or points of a single material."""

    attributes: dict[str, Index]
    indices: Index | None = None
    material: Index | None = None
    mode: Annotated[int, Field(ge=0, le=6)] = 4
    targets: list[dict[str, Index]] = []
    extensions: _PrimitiveExtensions = _PrimitiveExtensions()


class _Mesh(_Node):
    primitives: list[Primitive]
    weights: list[float] = []


class _Instancing(_Node):
    attributes: dict[str, Index]


class _Visibility(_Node):
    visible: bool = True


class _NodeExtensions(_Node):
    instancing: _Instancing | None = Field(default=None, alias="EXT_mesh_gpu_instancing")
    visibility: _Visibility = Field(default=_Visibility(), alias="KHR_node_visibility")


class SceneNode(_Node):
    """A node of the scene."""

    children: list[Index] = []
    mesh: Index | None = None
    skin: Index | None = None
    weights: list[float] | None = None
    matrix: Annotated[list[float], Field(min_length=16, max_length=16)] | None = None
    translation: _Rgb = (0.0, 0.0, 0.0)
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    scale: _Rgb = (1.0, 1.0, 1.0)
    extensions: _NodeExtensions = _NodeExtensions()


class _Skin(_Node):
    joints: list[Index]
    inverse_bind_matrices: Index | None = None


class _Scene(_Node):
    nodes: list[Index] = []


class _SparseIndices(_Node):
    buffer_view: Index
    byte_offset: Index = 0
    component_type: Literal[5121, 5123, 5125]


class _SparseValues(_Node):
    buffer_view: Index
    byte_offset: Index = 0


class _Sparse(_Node):
    count: Index
    indices: _SparseIndices
    values: _SparseValues


class Accessor(_Node):
    """Numbers in a buffer."""

    buffer_view: Index | None = None
    byte_offset: Index = 0
    component_type: Literal[5120, 5121, 5122, 5123, 5125, 5126]
    normalized: bool = False
    count: Index
    type: Literal["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"]
    sparse: _Sparse | None = None


class _Meshopt(_Node):
    fallback: bool = False


class _MeshoptExtensions(_Node):
    ext: _Meshopt | None = Field(default=None, alias="EXT_meshopt_compression")
    khr: _Meshopt | None = Field(default=None, alias="KHR_meshopt_compression")

    def name(self) -> str:
        """The extension that compresses it; empty if uncompressed."""
        return "EXT_meshopt_compression" if self.ext else "KHR_meshopt_compression" if self.khr else ""


class _BufferView(_Node):
    buffer: Index
    byte_offset: Index = 0
    byte_length: Index
    byte_stride: Annotated[int, Field(ge=1, le=4096)] | None = None
    extensions: _MeshoptExtensions = _MeshoptExtensions()


class _Buffer(_Node):
    uri: str | None = None
    byte_length: Index
    extensions: _MeshoptExtensions = _MeshoptExtensions()


class _Version(_Node):
    version: str
    min_version: str = ""


class Gltf(_Node):
    """The properties of a glTF 2.0 file that an object's shape and base colour depend on."""

    asset: _Version
    extensions_used: list[str] = []
    extensions_required: list[str] = []
    scene: Index | None = None
    scenes: list[_Scene] = []
    nodes: list[SceneNode] = []
    meshes: list[_Mesh] = []
    skins: list[_Skin] = []
    materials: list[Material] = []
    textures: list[Texture] = []
    samplers: list[_Sampler] = []
    images: list[_Image] = []
    accessors: list[Accessor] = []
    buffer_views: list[_BufferView] = []
    buffers: list[_Buffer] = []


_APPLIED: Final = """
    EXT_mesh_gpu_instancing EXT_meshopt_compression EXT_texture_avif EXT_texture_webp KHR_draco_mesh_compression
    KHR_materials_pbrSpecularGlossiness KHR_materials_unlit KHR_mesh_quantization KHR_meshopt_compression
    KHR_node_visibility KHR_texture_basisu KHR_texture_transform MSFT_texture_dds
"""
"""Extensions that are applied, or refused with a remedy of their own if the file needs them."""
_WITHOUT_EFFECT: Final = """
    ADOBE_materials_clearcoat_specular ADOBE_materials_thin_transparency AGI_articulations AGI_stk_metadata
    CESIUM_RTC CESIUM_primitive_outline EXT_instance_features EXT_lights_ies EXT_lights_image_based
    EXT_mesh_features EXT_mesh_manifold EXT_structural_metadata FB_geometry_metadata FB_ngon_encoding
    GODOT_single_root KHR_animation_pointer KHR_audio_emitter KHR_interactivity KHR_lights_punctual
    KHR_materials_anisotropy KHR_materials_clearcoat KHR_materials_diffuse_transmission KHR_materials_dispersion
    KHR_materials_emissive_strength KHR_materials_ior KHR_materials_iridescence KHR_materials_sheen
    KHR_materials_specular KHR_materials_transmission KHR_materials_variants KHR_materials_volume
    KHR_node_hoverability KHR_node_selectability KHR_physics_rigid_bodies KHR_xmp KHR_xmp_json_ld
    MOZ_hubs_components MSFT_lod MSFT_packing_normalRoughnessMetallic MSFT_packing_occlusionRoughnessMetallic
    OMI_collider OMI_physics_body OMI_physics_shape VRM VRMC_materials_mtoon VRMC_node_constraint VRMC_springBone
    VRMC_vrm
"""
"""Extensions that change neither the shape nor the base colour: lights, gloss, metadata, physics, further variants."""
_KNOWN: Final = frozenset((_APPLIED + _WITHOUT_EFFECT).split())

_COMPONENTS: Final[dict[int, str]] = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_CHUNKS: Final = (0x4E4F534A, 0x004E4942)
"""Types of the JSON and BIN chunks of a GLB file."""
_STRUCTURE: Final = 500_000
"""Most commas and opening brackets of the JSON: each may cost a kilobyte of memory when it is parsed."""
_URI: Final = re.compile(rb'"uri"\s*:\s*"((?!data:)[^"\\\x00-\x1f]{1,500})"')
_FIRST_VERSION: Final = re.compile(rb'"version"\s*:\s*"?1(?:\.[0-9])?"?\s*[,}]')
_READS: Final = 48
"""Rows of accessors that may be read for each face of the limit: three corners, each with up to 16 attributes."""
_UNPACK: Final = "convert it, for example with: gltfpack -i IN.glb -o OUT.glb"


class GltfDocument:
    """A glTF or GLB file of a source; its references stay in the folder and within the limits.

    Raises:
        RefusedError: the file is broken, cut off, of another version, or needs an extension that is not applied.
    """

    def __init__(self, folder: SourceFolder, name: str, limits: ImportLimits) -> None:
        self.name, self.limits = name, limits
        self.notes: list[str] = []
        self._folder, self._reads = folder, _READS * limits.faces
        self._room = limits.bytes  # for buffers and pictures beside the file
        self._buffers: dict[int, _Bytes] = {}
        text, self._chunk = self._split_chunks(folder.resolve_file(name).read_bytes())
        structure = sum(text.count(letter) for letter in (b",", b"[", b"{"))
        if structure > _STRUCTURE:
            raise self.refuse(f"its JSON has {structure} values, {_STRUCTURE} are the most", "simplify it")
        try:
            self.gltf = Gltf.model_validate_json(text.rstrip(b"\0 \r\n\t"))
        except ValidationError as error:
            if _FIRST_VERSION.search(text):  # 1.0 has objects in place of the lists of 2.0
                raise self._version_error("1.0") from error
            first = error.errors(include_url=False, include_context=False, include_input=False)[0]
            place = ".".join(str(step) for step in first["loc"])
            raise self.refuse(f"{place[:200]}: {first['msg']}" if place else f"{first['msg']}") from error
        needed = self.gltf.asset.min_version or self.gltf.asset.version
        if not (needed == "2.0" or (needed.startswith("2.") and not self.gltf.asset.min_version)):
            raise self._version_error(needed[:20])
        unknown = [name for name in dict.fromkeys(self.gltf.extensions_required) if name not in _KNOWN]
        if unknown:
            names = ", ".join(name[:60] for name in unknown[:5])
            raise self.refuse(f"it requires the extension {names}, which is not read", "export it without that")
        optional = [name for name in dict.fromkeys(self.gltf.extensions_used) if name not in _KNOWN]
        if optional:
            names = ", ".join("".join(filter(str.isprintable, name[:60])) for name in optional[:5])
            self.notes.append(f"its optional extension {names} is not applied")

    def refuse(self, message: str, remedy: str = "export it again") -> RefusedError:
        """The error that names the file; unprintable letters of foreign names are replaced."""
        text = "".join(letter if letter.isprintable() else "?" for letter in message[:400])
        return RefusedError(f"{self.name}: {text}", remedy)

    def find(self, items: list[_T], index: int, kind: str) -> _T:
        """The item with this number of a list of the file."""
        if index >= len(items):
            raise self.refuse(f"it names {kind} {index} of {len(items)}")
        return items[index]

    def read_rows(self, index: int, rows: Ints | None = None, *, width: int, normalized: bool = False) -> Floats:
        """Rows of an accessor as floats, all of them by default.

        Args:
            index: number of the accessor.
            rows: (R,) numbers of the wanted rows, each below its count.
            width: required numbers a row.
            normalized: take integers for shares of their largest value even if the accessor does not say so.
        """
        accessor = self.accessor(index)
        if _WIDTHS[accessor.type] < width:
            raise self.refuse(f"accessor {index} has the type {accessor.type}, {width} numbers a row are needed")
        values = self._gather(accessor, index, rows)[:, :width]
        return scale_integers(values, accessor.normalized or normalized)

    def read_indices(self, index: int) -> Ints:
        """(N,) the numbers of an accessor of indices."""
        accessor = self.accessor(index)
        if accessor.type != "SCALAR" or accessor.component_type not in (5121, 5123, 5125):
            raise self.refuse(f"accessor {index} holds no indices")
        return self._gather(accessor, index, None)[:, 0].astype(np.int64)

    def accessor(self, index: int) -> Accessor:
        """An accessor by its number."""
        return self.find(self.gltf.accessors, index, "accessor")

    def decode_draco(self, draco: _Draco) -> tuple[Ints, dict[str, npt.NDArray[Any]]]:
        """Faces (F, 3) and the attributes, a row for each vertex, of a compressed primitive."""
        try:
            package: Any = importlib.import_module("DracoPy")
        except ImportError as error:
            message = "its meshes are compressed by KHR_draco_mesh_compression, which needs the package DracoPy"
            remedy = 'run: pip install "grs-agents[assets]", or export it without compression'
            raise self.refuse(message, remedy) from error
        try:
            mesh: Any = package.decode(self.read_view(draco.buffer_view).tobytes())
            faces = np.asarray(mesh.faces, np.int64).reshape(-1, 3)
            arrays = {entry["unique_id"]: np.asarray(entry["data"]) for entry in mesh.attributes}
        except (ValueError, TypeError, AttributeError, LookupError, RuntimeError, package.FileTypeException) as error:
            reason = str(error)[:120] or type(error).__name__
            raise self.refuse(f"data of KHR_draco_mesh_compression cannot be decoded: {reason}") from error
        if missing := [name for name, number in draco.attributes.items() if number not in arrays]:
            raise self.refuse(f"data of KHR_draco_mesh_compression lack {missing[0]}")
        attributes = {name: arrays[number] for name, number in draco.attributes.items()}
        attributes = {name: data.reshape(len(data), -1) for name, data in attributes.items()}
        self._count_reads(3 * len(faces) + sum(map(len, attributes.values())))
        return faces, attributes

    def has_plain_data(self, index: int) -> bool:
        """True if an accessor can be read without decompression by Draco."""
        accessor = self.accessor(index)
        return accessor.buffer_view is not None or accessor.sparse is not None

    def read_picture(self, index: int) -> bytes | None:
        """The encoded bytes of a picture; None, with a note, if its file does not exist."""
        image = self.find(self.gltf.images, index, "image")
        if image.buffer_view is not None:
            return self.read_view(image.buffer_view).tobytes()
        if image.uri is None:
            raise self.refuse(f"image {index} has neither a uri nor a bufferView")
        if not image.uri.startswith("data:") and self._is_missing(image.uri):
            self.notes.append(f"the picture {image.uri[:120]!r} does not exist: its material's colour alone is shown")
            return None
        return self._read_uri(image.uri)

    def read_view(self, index: int) -> _Bytes:
        """The bytes of a buffer view."""
        view = self.find(self.gltf.buffer_views, index, "bufferView")
        buffer = self.find(self.gltf.buffers, view.buffer, "buffer")
        is_chunk = buffer.uri is None and view.buffer == 0 and self._chunk is not None
        if compression := view.extensions.name():
            # A fallback buffer only reserves room for data that are still compressed.
            is_fallback = any(mark and mark.fallback for mark in (buffer.extensions.ext, buffer.extensions.khr))
            if buffer.uri is None and (is_fallback or not is_chunk):
                raise self.refuse(f"its meshes are compressed by {compression}, which is not read", _UNPACK)
        if view.buffer not in self._buffers:
            if buffer.uri is not None:
                whole = np.frombuffer(self._read_uri(buffer.uri), np.uint8)
            elif self._chunk is not None and is_chunk:
                whole = self._chunk
            else:
                raise self.refuse(f"buffer {view.buffer} has neither a uri nor a binary chunk")
            if len(whole) < buffer.byte_length:
                lack = f"has {len(whole)} of {buffer.byte_length} bytes"
                raise self.refuse(f"buffer {view.buffer} {lack}: it is cut off")
            self._buffers[view.buffer] = whole[: buffer.byte_length]
        data = self._buffers[view.buffer]
        end = view.byte_offset + view.byte_length
        if end > len(data):
            raise self.refuse(f"bufferView {index} ends at byte {end} of buffer {view.buffer}, which has {len(data)}")
        return data[view.byte_offset : end]

    def _gather(self, accessor: Accessor, index: int, rows: Ints | None) -> npt.NDArray[Any]:
        """(R, width) rows of an accessor as its file stores them, sparse rows applied."""
        dtype, width = np.dtype(_COMPONENTS[accessor.component_type]), _WIDTHS[accessor.type]
        label = f"accessor {index}"
        if rows is None:
            self._count_reads(accessor.count)
            rows = np.arange(accessor.count)
        else:
            self._count_reads(len(rows))
        if len(rows) and int(rows.max()) >= accessor.count:
            raise self.refuse(f"a face names vertex {rows.max()} of {accessor.count}")
        if accessor.buffer_view is None:
            values = np.zeros((len(rows), width), dtype)
        else:
            view, stride = accessor.buffer_view, self.find(self.gltf.buffer_views, accessor.buffer_view, "bufferView")
            place = (view, accessor.byte_offset, stride.byte_stride or width * dtype.itemsize)
            values = self._table(label, place, accessor.count, width, dtype)[rows]
        sparse = accessor.sparse
        if sparse is None or not sparse.count:
            return values
        self._count_reads(2 * sparse.count)
        kind = np.dtype(_COMPONENTS[sparse.indices.component_type])
        place = (sparse.indices.buffer_view, sparse.indices.byte_offset, kind.itemsize)
        where = self._table(f"sparse indices of {label}", place, sparse.count, 1, kind)[:, 0].astype(np.int64)
        place = (sparse.values.buffer_view, sparse.values.byte_offset, width * dtype.itemsize)
        replacing = self._table(f"sparse values of {label}", place, sparse.count, width, dtype)
        if int(where.max()) >= accessor.count:
            raise self.refuse(f"sparse indices of {label} name row {where.max()} of {accessor.count}")
        order = np.argsort(where, kind="stable")
        nearest = order[np.minimum(np.searchsorted(where[order], rows), len(order) - 1)]
        return np.where((where[nearest] == rows)[:, None], replacing[nearest], values)

    def _table(
        self, label: str, place: tuple[int, int, int], count: int, width: int, dtype: np.dtype[Any]
    ) -> npt.NDArray[Any]:
        """(count, width) numbers at a place (buffer view, byte offset, byte stride), not copied."""
        view, offset, stride = place
        data = self.read_view(view)
        end = offset + stride * (count - 1) + width * dtype.itemsize
        if count and end > len(data):
            raise self.refuse(f"{label} ends at byte {end} of bufferView {view}, which has {len(data)}")
        return np.ndarray((count, width), dtype, data, offset if count else 0, (stride, dtype.itemsize))

    def _count_reads(self, rows: int) -> None:
        self._reads -= rows
        if self._reads < 0:
            most = _READS * self.limits.faces
            raise self.refuse(f"its meshes read more than {most} rows of its accessors", "simplify it")

    def _read_uri(self, uri: str) -> bytes:
        """The bytes of a ``data:`` URI or of a file in the folder."""
        if uri.startswith("data:"):
            header, _, text = uri.partition(",")
            try:
                return binascii.a2b_base64(unquote(text)) if header.endswith(";base64") else unquote_to_bytes(text)
            except (binascii.Error, ValueError) as error:
                raise self.refuse(f"a data: URI is broken: {error}") from error
        path = _resolve_uri(self._folder, self.name, uri)
        self._room -= path.stat().st_size
        if self._room < 0:
            raise self.refuse(f"the files that it names have more than {self.limits.bytes} bytes", "simplify it")
        return path.read_bytes()

    def _is_missing(self, uri: str) -> bool:
        """True if the folder has no file at the path of a URI."""
        root, home = str(self._folder.root), str((self._folder.root / self.name).parent)
        paths = [os.path.normpath(f"{home}/{name}") for name in (uri, unquote(uri))]
        try:
            return all(path.startswith(f"{root}/") and not Path(path).exists() for path in paths)
        except OSError:  # a part of the name is too long for the file system
            return False

    def _split_chunks(self, data: bytes) -> tuple[bytes, _Bytes | None]:
        """The JSON and, of a GLB file, the binary chunk."""
        if data[:4] != b"glTF":
            return data.removeprefix(b"\xef\xbb\xbf"), None
        version = struct.unpack_from("<I", data, 4)[0] if len(data) >= 20 else 0
        if version == 1:
            raise self._version_error("1.0")
        if version != 2:
            raise self.refuse(f"it is a GLB file of {len(data)} bytes and version {version}, 2 is read")
        chunks: dict[int, _Bytes] = {}
        start, whole = 12, np.frombuffer(data, np.uint8)
        while start + 8 <= len(data):
            length, kind = struct.unpack_from("<II", data, start)
            start += 8
            if start + length > len(data):
                raise self.refuse(f"a chunk of {length} bytes has {len(data) - start}: the file is cut off")
            chunks.setdefault(kind, whole[start : start + length])
            start += length
        if _CHUNKS[0] not in chunks:
            raise self.refuse("it has no chunk of JSON")
        return chunks[_CHUNKS[0]].tobytes(), chunks.get(_CHUNKS[1])

    def _version_error(self, version: str) -> RefusedError:
        return self.refuse(f"it is of glTF {version}, 2.0 is read", "convert it, for example with gltf-pipeline")


_MOST_FILES: Final = 1_000
"""Files beside a glTF file that are looked for; each look-up asks the file system."""


def find_gltf_files(folder: SourceFolder, name: str) -> list[str]:
    """The existing buffers and pictures beside a glTF file, relative to the folder."""
    files: list[str] = []
    for uri in islice(dict.fromkeys(_URI.findall(folder.resolve_file(name).read_bytes())), _MOST_FILES):
        try:
            files.append(folder.relative_file_name(_resolve_uri(folder, name, uri.decode("utf-8", "replace"))))
        except RefusedError:
            continue  # reading reports it
    return files


def _resolve_uri(folder: SourceFolder, name: str, uri: str) -> Path:
    """The file in the folder that a URI in the file ``name`` says: by its name as it is, else percent-decoded."""
    errors: list[RefusedError] = []
    for spelled in dict.fromkeys((uri, unquote(uri))):
        try:
            return folder.resolve_file(spelled, name)
        except RefusedError as error:
            errors.append(error)
        except OSError as error:  # a part of the name is too long for the file system
            message = f"{name} names {spelled[:120]!r}: {error.strerror}"
            errors.append(RefusedError(message, "name files relative to the file"))
    raise errors[-1]


def scale_integers(values: npt.NDArray[Any], normalized: bool) -> Floats:
    """Numbers of a file as floats; normalized integers as shares of their largest value, -1..1 or 0..1."""
    floats = values.astype(np.float64)
    if not normalized or not np.issubdtype(values.dtype, np.integer):
        return floats
    return np.maximum(floats / np.iinfo(values.dtype).max, -1.0)
