"""Command-line options of the synthesised scenes."""

import argparse

from evals.synthesis.scene import Recipe, recipes
from grs_agents.runs.experiments import positive_int


def add_recipe_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the synthesised scenes to a parser."""
    parser.add_argument(
        "--synthesised", type=natural, default=None, metavar="N", help="scenes to make: 10 without --scenes"
    )
    parser.add_argument(
        "--objects", type=positive_int, default=15, help="things in a made scene, up to four of random shape"
    )
    parser.add_argument(
        "--absent", type=natural, default=0, metavar="N", help="of them products that the library does not hold: 0"
    )
    parser.add_argument("--arm", action="store_true", help="the robot is in the made pictures, at joints that are told")
    parser.add_argument("--bin", action="store_true", help="the walls of a bin are around the things in made scenes")
    parser.add_argument("--size", type=size, default=(640, 480), metavar="WxH", help="of the made pictures: 640x480")
    parser.add_argument("--seed", type=natural, default=0, help="of the made scenes")


def recipes_from_options(options: argparse.Namespace) -> tuple[Recipe, ...]:
    """The recipes of a parsed command line."""
    count = options.synthesised if options.synthesised is not None else 0 if options.scenes else 10
    width, height = options.size
    like = Recipe(
        objects=options.objects,
        absent=options.absent,
        arm=options.arm,
        walls=options.bin,
        width=width,
        height=height,
    )
    return recipes(count, options.seed, like)


def size(text: str) -> tuple[int, int]:
    """``640x480`` as width and height, for ``argparse``."""
    width, height = (positive_int(part) for part in text.split("x"))
    return width, height


def natural(text: str) -> int:
    """A whole number from 0, for ``argparse``."""
    number = int(text)
    if number < 0:
        raise argparse.ArgumentTypeError(f"{number} is less than 0")
    return number
