"""Captures and models that are no scenes: kind by suffix, with the conversion to a scene."""

from pathlib import Path

from grs_agents.base.errors import InputError

_FRAME = "write one frame of it into a folder: rgb.png, depth.png aligned with it, camera.json"
_EXPORT = "export it as .glb and import that as an asset with grs assets import; a scene is a photo with depth"
_ASSET = "import it as an asset with grs assets import; a scene is a photo with depth"
_DEVELOP = "develop it as .png or .jpg"
_UNPACK = "unpack it and name the folder"
_ARRAYS = "write one frame of it as .npz with the arrays rgb, depth and K"
KINDS: dict[str, tuple[str, str]] = {
    ".svo": ("a ZED recording", _FRAME),
    ".svo2": ("a ZED recording", _FRAME),
    ".oni": ("an OpenNI recording", _FRAME),
    ".sens": ("a ScanNet recording", _FRAME),
    ".klg": ("a Kintinuous log", _FRAME),
    ".mkv": ("a video or an Azure Kinect recording", _FRAME),
    **dict.fromkeys((".mp4", ".mov", ".avi", ".webm", ".m4v"), ("a video", _FRAME)),
    **dict.fromkeys((".usdz", ".usd", ".usda", ".usdc"), ("a USD model or room scan without a photo", _EXPORT)),
    **dict.fromkeys((".fbx", ".step", ".stp", ".blend", ".reality"), ("a 3D model", _EXPORT)),
    **dict.fromkeys((".glb", ".gltf", ".obj", ".stl", ".dae", ".3mf", ".urdf"), ("a 3D model", _ASSET)),
    **dict.fromkeys((".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf"), ("a raw photo of a camera", _DEVELOP)),
    **dict.fromkeys((".zip", ".tar", ".gz", ".tgz", ".7z"), ("an archive", _UNPACK)),
    **dict.fromkeys((".h5", ".hdf5", ".mat", ".pkl"), ("a file of arrays", _ARRAYS)),
}
"""By suffix, the name of the kind and the remedy."""


def make_unread_format_error(file: Path) -> InputError | None:
    """Refusal of a file of a known kind that is no scene; ``None`` for other suffixes."""
    if (kind := KINDS.get(file.suffix.lower())) is None:
        return None
    return InputError(f"{file} is {kind[0]}, which is not read as a scene", kind[1])
