"""Constants of the detection of a bin's walls."""

from dataclasses import dataclass


@dataclass(frozen=True)
class BinWalls:
    """Distinction of a bin's walls from objects; lengths in m."""

    raised: float = 0.02  # least height of walls; lower is the floor
    highest: float = 0.3  # largest height of a wall to reach over
    blurred: int = 8  # pixels around the robot that it blurs,
    edge: int = 2  # for some sensors only this many
    cell: float = 0.005  # of the table seen from above
    fewest: int = 100  # raised cells of a bin
    turn: float = 2.0  # degrees between the yaws tried first
    apart_yaws: int = 4  # least distance of likely yaws, in these steps
    hypotheses: int = 3  # yaws that are tried
    rounds: int = 2  # of aligning the axes with the walls
    line: float = 0.01  # step across and along lines; a line is two steps wide
    outside: float = 0.1  # largest share of the raised cells beyond a wall
    strip: float = 0.025  # on either side of a line, in which its wall is searched
    thick: float = 0.03  # largest visible thickness of walls
    level: float = 0.015  # largest height difference of rims; blur raises less
    short: float = 0.08  # least visible length of a rim
    apart: float = 0.015  # m along the ray: nearer to the expected rim is the rim, farther is seen past it
    seen: float = 0.75  # least visible share of the unoccluded part of a rim
    few: int = 4  # cm of a rim: as little is seen or missing by chance
    rims: int = 2  # that are seen, long enough together,
    sides: int = 3  # or visible sides of walls
    stray: float = 0.02  # largest share of the cells below the rims beyond a wall with a hidden rim
    columns: int = 2  # cm: a shorter line is no wall
    face: int = 3  # square centimetres: least visible side of such a wall
    slides: tuple[float, ...] = (
        0.0,
        -0.0025,
        0.0025,
        -0.005,
        0.005,
        -0.0075,
        0.0075,
    )  # corrections of a rim's position
    gap: float = 0.03  # at a corner that may be blurred away
    free: float = 0.04  # length seen past beyond the gap at the end of a wall
    open: float = 1.0  # continuation of a wall without visible end
    long: float = 0.5  # least total visible length of the rims, or of the sides
    things: int = 2  # objects in a bin at least: a box with fewer is an object with its content
    thing: int = 4  # square centimetres: least size of an object
    margin: float = 0.01  # around walls, of their pixels
    beside: int = 20  # pixels around the robot in which a sensor mixes its depth with that of walls
    blur: float = 0.035  # margin of mixed points beside the walls, along the ray,
    mixed: float = 0.05  # and over them
    lowest: float = 0.004  # lower is the floor
    deviations: float = 1.5  # or lower than this many standard deviations of the table's points


CONFIG = BinWalls()
