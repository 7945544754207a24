"""Every constant of the segmentation, by stage, with its unit and why it has this value. Lengths are metres, angles
radians, areas shares of the picture, unless a comment says otherwise."""

from dataclasses import dataclass, replace
from typing import Final, Self

from grs_agents.base.errors import UnknownNameError

RULES: Final = {
    "common_rim": "walls whose tops are level, and the inside seen over them, are one hollow object",
    "interior": "what lies within walls and below their rim is the inside of a hollow object",
    "cap": "what is small and on top of something larger is its cap",
    "tab": "what is thin and small and sticks out of something higher is its tab",
    "unsupported": "a narrow part in the air that nothing carries belongs to what it touches",
    "solid": "what is highest in its middle is an object of its own, neither a wall nor an inside",
    "occluded": "pieces of one height or colour that something nearer, or a gap in the depth, parts are one object",
    "plain_color": "pieces of one plain colour that touch without a depth jump are one object",
    "neck": "what is centred on shoulders that slope away is the neck or cap of what is below",
    "sensor_noise": "what is as flat as the sensor's noise is no object",
    "flying_pixels": "what is small and much deeper than it looks large is mixed of two surfaces, and no object",
    "entering": "what comes in from above, or from beyond the picture high over the table, is an arm, and no object",
    "hollow_floor": "what is low inside a hollow object is its floor, also where the robot or a shadow cuts its walls",
    "low_thing": "what lies free and is higher on average than the table around it is an object, as a pen is",
}
"""The rules by which segments are merged, dropped and filled, by name."""


@dataclass(frozen=True)
class Foreground:
    """What stands on the table."""

    lowest: float = 0.006  # what is lower is the noise of the table
    tallest: float = 0.6  # what rises higher is not an object on it
    most_seen_through: float = 0.1  # of what lies between two pieces of plane may show something lower: one table
    lower: float = 0.05  # what is so much lower than the table top is seen beside it, not on it
    beyond_table: float = 0.15  # from its visible part, objects stand on its near part that is out of the picture
    hidden_table: float = 0.04  # from it they hide table: so much is not seen beside a bin's near wall and the robot


@dataclass(frozen=True)
class PatchCutting:
    """Smooth patches of the foreground. Bends are sagitta over chord."""

    bend: float = 0.037  # patches are first cut here: a concave bend of about 8 degrees, often mere noise
    crease: float = 0.19  # the mean over a border above which two patches stay apart
    jump: float = 0.3  # what a depth jump counts in that mean, and the most that a bend counts
    reach: float = 0.010  # along the surface, over which a bend is measured
    shortest: int = 6  # pixels: shorter borders say nothing
    fold: float = 0.25  # a mean below this bounds no object that another encloses: it is a fold, a print or noise
    enclosed: float = 2.5  # sides of a square of a fragment's pixels: its border with what encloses it is longer
    fragment: float = 0.5  # of the pixels of what encloses it: a fragment has fewer


@dataclass(frozen=True)
class HollowShape:
    """When points are an object open at the top, and when the top of a solid one."""

    rim: float = 0.015  # how high and wide a rim is
    deep: float = 0.015  # the floor lies at least this far below the rim
    shallow: float = 0.35  # less than this share of the inside is as high as the rim
    surrounded: float = 0.6  # the rim encloses at least this share of the footprint
    cells: int = 8  # a side of a square as large as the footprint: it is looked at cell by cell
    filled: float = 0.75  # at least this share of a solid object's footprint is seen
    sag: float = 0.005  # its middle is no more than this below its border
    raised: float = 0.02  # its top lies at least this high above the table: it is no floor


@dataclass(frozen=True)
class RimVisibility:
    """When one part is the inside of a hollow object seen over the edge of another."""

    end: float = 0.2  # this share of an edge's columns is its end
    risen: float = 0.5  # at both ends the inside comes up to at least this share of the rim's height
    closed: float = 0.6  # and there the sides are nearer to each other than this share of the rim's width
    span: float = 0.5  # the edge spans at least this share of the narrower part's columns
    fewest: int = 8  # columns: an edge of fewer says nothing


@dataclass(frozen=True)
class PartMerging:
    """When two patches are parts of one object."""

    touching: float = 0.012  # parts nearer than this touch
    rim_level: float = 0.02  # rims within this height of each other are one rim
    beside: float = 0.02  # walls nearer than this are one beside the other
    rim_gap: float = 0.05  # ends of one rim are nearer than this
    overlap: float = 0.5  # of its points over the footprint of another: it lies in or on it, and is not its near wall
    interior_overlap: float = 0.7  # of its points over the walls' footprint: it is the inside of what they surround
    below_rim: float = 0.008  # the inside reaches no higher than this above the walls
    thickest_wall: float = 0.04  # what is thicker is no wall, however a bad sensor blurs it
    smaller: float = 0.4  # of the other's pixels: an attached part has fewer
    tiny: float = 0.2  # of the other's pixels: a tab has fewer
    tab: tuple[float, float] = (0.025, 0.065)  # what is thinner and shorter, and sticks out of something higher
    on_top: float = 0.03  # what begins no lower than this below the top of another may be its cap
    covered: float = 0.5  # of the points of a cap lie over what it is on
    cap: float = 0.045  # what is smaller across and lower, on top of something larger, is its cap
    unsupported: float = 0.02  # what hangs higher above the table wants a support
    carrier_distance: float = 0.025  # what carries a part ends within this of the part's underside
    carried: float = 0.25  # of the part's points lie over what carries it
    handle: tuple[float, float] = (0.044, 0.12)  # what is thinner and shorter may be a handle: other objects are wider
    shortest: int = 6  # pixels: parts with a shorter border do not go over into each other
    alike: float = 0.65  # Bhattacharyya coefficient of the colours of a tab or a handle and of the whole


@dataclass(frozen=True)
class OccludedPieces:
    """When two pieces are one object that others in front of it, or a gap in its depth, separate: flat ones of one
    height, and ones of the same colours that reach to each other. Of 25 pairs with a hidden gap and the same colours
    (synthesised and real scenes) none were two objects."""

    same_level: float = 0.005  # tops of two pieces are within this height: no sensor's noise moves them by more
    level: float = 0.01  # a flat piece is within this height of its top
    flat: float = 0.45  # for at least this share
    hue: float = 0.05  # distance of the shares of red, green and blue: colours of one object are this near
    brightness: float = 1.6  # the brighter piece is at most this many times as bright
    rectangle: float = 0.9  # where the footprint of both fills so much of its rectangle,
    printed: tuple[float, float] = (0.15, 2.5)  # colours may differ by this hue and brightness: by print or light
    between: float = 0.6  # at least this share of the shortest way between them lies on objects that hide them
    longest: float = 0.4  # a joined object is at most this long
    alike: float = 0.75  # Bhattacharyya coefficient of two histograms of colours that agree
    lines: int = 12  # shortest lines across a gap that are looked at; their medians count
    hidden: float = 0.7  # at least this share of a line has no depth, or shows something nearer
    nearer: float = 0.005  # m: what is nearer than a straight line by this is in front of the gap
    widest: float = 0.065  # m: a wider gap joins nothing
    steepest: float = 2.0  # m of depth for each metre of the gap: what is steeper is a jump to another object
    receding: float = 0.4  # slope: where both surfaces turn away more towards the gap, two round objects stand there
    inner: int = 8  # pixels of a piece beside the gap over which its slope is measured
    slit: float = 0.025  # m: a narrower gap without depth may be the sensor's shadow between two boxes
    foreign: float = 0.5  # at most this share of such a gap has a colour that neither end has
    off_color: float = 25.0  # CIE76 distance: what differs more is another colour


@dataclass(frozen=True)
class TouchingPieces:
    """When two pieces touch."""

    open: float = 0.4  # at least this share of their border has no depth jump
    shortest: int = 5  # and at least so many pixels of it


@dataclass(frozen=True)
class PlainColor:
    """When two touching pieces are of one plain colour. Chosen on synthesised scenes, of 1,019 pairs: 72 of one object
    are joined, and one of two."""

    hue: float = 2.0  # of CIE a* and b*, both seen as dark as the darker one: 1 is just seen, noise is as much again
    brightness: float = 2.0  # times the luminance: so much do two sides of one thing differ in the light of a room;
    chroma: float = 8.0  # of a* and b*: what is more colourful than grey may have any brightness,
    colored: float = 3.5  # and hues so far apart: of 1,014 pairs 12 more of one object are joined, and none of two
    spread: float = 20.0  # of a* and b*: what is printed spreads farther
    fewest: int = 20  # pixels within its border: a smaller piece has no sure colour


@dataclass(frozen=True)
class BottleNeck:
    """When a piece is the neck or cap of what is below. Chosen on synthesised scenes, where half or twice of a length
    changes little."""

    off: float = 0.005  # m: the middles of neck and body, left and right, differ by less
    apart: float = 0.012  # m of height between the neck's lower end and the body's upper one
    tallest: float = 2.0  # times as tall as what is seen of the body
    around: int = 5  # pixels of the working size from the border: there the body's surface must be lower:
    slope: tuple[float, float] = (0.004, 0.001)  # m: half of it, and four fifths of it
    fewest: int = 10  # points: fewer tell nothing


@dataclass(frozen=True)
class SegmentFilter:
    """Which segments are no objects, and what of the table belongs to a hollow one."""

    smallest: float = 0.0004  # of the picture: an object covers at least so much
    flattest: tuple[float, float] = (0.007, 0.012)  # what is lower, from a good sensor and from a bad one, is no object
    deviations: float = 5.0  # in between, so many standard deviations of the table's points
    flying: float = 2.0  # sides of a square of its pixels: flying pixels are deeper than so many
    border: int = 3  # pixels: what is within so many of the picture's border is cut by it
    fewest: int = 10  # pixels: fewer at the border say nothing
    clear: float = 0.05  # at the border an arm is higher than this above the table
    round: float = 0.02  # the heights of the flat top of an object that the border cuts differ by less than this
    top_beside_arm: int = 90  # percentile of the heights that is the top, where the known arm's depth may be mixed in
    long: float = 0.15  # an arm reaches in by more than this along the table
    floor: float = 0.015  # the floor of a hollow object lies within this height of the table
    floor_margin: float = 0.005  # and this far inside its footprint


@dataclass(frozen=True)
class RoundFootprint:
    """The unseen back of round objects: half ellipses fitted to slices of the side that is seen."""

    slices: int = 6  # an object's height is cut into so many
    fewest: int = 40  # points: a slice of fewer says nothing
    fewest_slices: int = 2  # so many must be half ellipses
    widest: float = 0.93  # of the widest: slices at least this wide say how deep the object is
    error: float = 0.06  # of the half width: an ellipse may be off its slice by this
    better: float = 0.5  # and by this share of what a rectangle is off
    round: float = 0.7  # depth over width above which an ellipse is a circle
    depths: tuple[float, float] = (0.4, 1.8)  # over the width: what is flatter is a face, what is deeper is no fit
    seen: float = 0.97  # of the width: the outermost points are mixed with what is behind them


@dataclass(frozen=True)
class RimFootprint:
    """The circle of a bowl's rim, whatever of its side is hidden."""

    flat: float = 0.6  # what is higher than this share of its width is a cup: its side and handle tell more
    high: float = 0.012  # points lower than this below the top are not of the rim
    fewest: int = 60  # points: fewer tell of no circle
    rounds: int = 2  # of fitting the circle to the points near it
    near: float = 0.004  # points nearer than this to the circle always count
    better: float = 0.8  # a round rim is off a circle by less than this share of what it is off a rectangle, on average
    sectors: int = 24  # the circle is cut into so many
    seen: float = 0.6  # in this share of them points must lie
    wide: float = 1.24  # radii: what reaches farther is a handle
    low: float = 0.5  # of the height: what reaches farther but is lower are stray points
    handle: float = 0.02  # what has a handle of more than this share of the points is not round


@dataclass(frozen=True)
class Measuring:
    """Boxes, shapes and crops of segments."""

    largest: float = 0.5  # a longer segment is not an object that the arm could move
    fewest: int = 30  # points: a segment of fewer is not measured
    most: int = 60_000  # points of a segment are looked at: in a photo of 640 x 480 hardly one has as many
    samples: int = 3000  # points: a footprint is measured from about so many
    overhang: float = 0.12  # of the diameter: points beyond a round footprint by more tell of more than that
    outliers: float = 0.4  # percent of the points at each end of each axis that are left out of a footprint
    gap: float = 0.05  # along the view: points farther from all others are another surface's
    few: float = 0.1  # of the points: if they are so few
    workspace_center: tuple[float, float] = (0.5, 0.0)  # where the objects' middle lies in a frame laid on the table
    round: RoundFootprint = RoundFootprint()
    rim: RimFootprint = RimFootprint()


@dataclass(frozen=True)
class MaskProposals:
    """Which masks of a model are used, and how they are joined."""

    alike: float = 0.7  # of masks whose intersection over union is larger only the one with the best score is kept
    standing: float = 0.5  # of a mask's measured pixels stand on the table: it is neither table nor background
    seen: float = 0.2  # and of all its pixels
    spill: int = 3  # pixels: masks may spill so far over the table around what stands on it
    blur: int = 8  # pixels: a mask's edge may be so far off the edge in the depth
    covered: float = 0.8  # of a part: a mask that holds at least this much covers it


@dataclass(frozen=True)
class EnclosedFloors:
    """Floors that are lower than the noise of a pixel."""

    wall: float = 0.02  # what is measured higher encloses them, however thin
    floor: float = 0.0028  # a piece that is higher on average is a floor: cardboard is thicker, and the table between
    # things of a heap seems up to 2.7 mm high
    cut: float = 0.1  # of its border: so much rises beside a floor where the robot or a shadow makes up the rest
    pixels: float = 0.0004  # of the picture: of less the average says nothing
    gap: int = 5  # pixels: so far from its walls a floor may begin, for they shadow it
    owned: float = 0.2  # of a floor's border: the segment that more of it is with owns it


@dataclass(frozen=True)
class LowThings:
    """Things that lie free on the table, lower than the bound for one pixel. Pixels are those of the working size."""

    highest: float = 0.02  # m: what is higher is found without
    apart: int = 3  # pixels: so close to what rises, or is not measured, the sensor mixes both
    gap: int = 7  # pixels: so wide is what is not measured for more than want of light
    fine: int = 5  # pixels: the window in which a thing's height is averaged,
    coarse: int = 61  # and the table's
    lowest: float = 0.0035  # m over the table around it,
    deviations: float = 5.0  # and over this many standard deviations of such averages
    smallest: float = 0.0002  # of the picture
    ring: int = 8  # pixels around a thing:
    free: float = 0.6  # more of them show the table; beside the robot less do


@dataclass(frozen=True)
class ColorBorders:
    """Pixels whose owner colour tells; lengths in pixels of the working size."""

    reach: int = 24  # beyond its convex outline, which what has depth may not fill: so far goes what has none
    border: int = 2  # a sensor mixes the depth of so many pixels at each side of an edge
    around: int = 6  # pixels around one on a border whose colours are compared with its own
    color_noise: float = 0.01  # standard deviation of a colour (0..1) within one surface
    stay: float = 0.3  # a pixel changes its owner where another is likelier by this share
    inner: float = 0.3  # share of an object's pixels that are not on its border: of one with fewer the border stays


@dataclass(frozen=True)
class Segmentation:
    """From the photo and its table to segments; ``rules`` are those of `RULES` that are on."""

    rules: frozenset[str] = frozenset(RULES)
    foreground: Foreground = Foreground()
    patches: PatchCutting = PatchCutting()
    hollow: HollowShape = HollowShape()
    rim: RimVisibility = RimVisibility()
    merging: PartMerging = PartMerging()
    occluded: OccludedPieces = OccludedPieces()
    touching: TouchingPieces = TouchingPieces()
    plain: PlainColor = PlainColor()
    neck: BottleNeck = BottleNeck()
    filter: SegmentFilter = SegmentFilter()
    floors: EnclosedFloors = EnclosedFloors()
    low: LowThings = LowThings()
    proposals: MaskProposals = MaskProposals()
    color_borders: ColorBorders = ColorBorders()

    def without_rules(self, *rules: str) -> Self:
        """The same with some rules off.
        Raises UnknownNameError: there is no such rule."""
        for rule in rules:
            if rule not in RULES:
                raise UnknownNameError("segmentation rule", rule, RULES)
        return replace(self, rules=self.rules - frozenset(rules))
