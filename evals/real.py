"""Run a folder of real scenes to a verdict each, and count what was seen, kept and moved."""

from collections.abc import Sequence
from pathlib import Path

from grs_agents.errors import InputError
from grs_agents.runs import Job, make_experiment_parser, run_experiment, settings_as_arguments


def main(arguments: Sequence[str]) -> int:
    """Run every scene folder of a folder.

    Returns:
        0 if every scene came to a verdict, 1 if not.

    Raises:
        InputError: the folder holds no scene.
    """
    parser = make_experiment_parser("real", __doc__)
    parser.add_argument("folder", type=Path, help="a folder of scene folders")
    options = parser.parse_args(arguments)
    scenes = sorted(file.parent for file in options.folder.glob("*/camera.json"))
    if not scenes:
        raise InputError(
            f"{options.folder} holds no scene", "name a folder of folders with rgb.png, depth.png, camera.json"
        )
    settings = settings_as_arguments(options)
    return run_experiment([Job(scene.name, scene, options.out / scene.name, settings) for scene in scenes], options)
