"""How the walls of a bin are told from things."""

from dataclasses import dataclass


@dataclass(frozen=True)
class BinWalls:
    """How the walls of a bin are told from things; lengths in m."""

    raised: float = 0.02  # walls are higher; lower is the floor
    highest: float = 0.3  # what is higher is no wall to reach over
    blurred: int = 8  # pixels around the robot are blurred by it,
    edge: int = 2  # by some sensors only so many
    cell: float = 0.005  # of the table seen from above
    fewest: int = 100  # cells: fewer are no walls
    turn: float = 2.0  # degrees: so far apart are the yaws that are tried first
    apart_yaws: int = 4  # of them: likely ones are at least so many apart
    hypotheses: int = 3  # yaws are tried
    rounds: int = 2  # of laying the axes along the walls
    line: float = 0.01  # cells are in a line within two of these; its length is counted by one
    outside: float = 0.1  # of what rises: less lies beyond a wall
    strip: float = 0.025  # on either side of a line its wall is looked for
    thick: float = 0.03  # walls are thinner, as they are seen
    level: float = 0.015  # rims differ less in height, and blur less far upward
    short: float = 0.08  # what is seen of a rim is longer
    apart: float = 0.015  # m along the ray: closer to where a rim should be is the rim, farther is seen past it
    seen: float = 0.75  # of what is not hidden of a rim: more is there
    few: int = 4  # cm of a rim: so little is seen or missing by chance
    rims: int = 2  # are seen, long enough together,
    sides: int = 3  # or the sides of so many walls are
    stray: float = 0.02  # of what rises below the rims: less lies beyond a wall whose rim is hidden
    columns: int = 2  # cm: a shorter line is no wall
    face: int = 3  # square centimetres of such a wall's side are seen
    slides: tuple[float, ...] = (0.0, -0.0025, 0.0025, -0.005, 0.005, -0.0075, 0.0075)  # so far a rim is off at most
    gap: float = 0.03  # corners may be blurred away
    free: float = 0.04  # what is seen past so far beyond the gap is where a wall ends
    open: float = 1.0  # a wall of which no end is seen may go on so far
    long: float = 0.5  # the rims seen, or the sides, are longer together
    things: int = 2  # a bin holds at least so many: a box with fewer is an object with its content
    thing: int = 4  # square centimetres: fewer are no thing
    margin: float = 0.01  # around walls: what is nearer is theirs
    beside: int = 20  # pixels: so near to the robot a sensor mixes its depth with that of walls
    blur: float = 0.035  # beside these, seen along the ray,
    mixed: float = 0.05  # and over them points are off by less
    lowest: float = 0.004  # what is lower is the floor
    deviations: float = 1.5  # and what is lower than so many standard deviations of the table's points


CONFIG = BinWalls()
