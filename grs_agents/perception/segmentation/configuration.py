"""Constants of the segmentation, by stage, with unit and motivation. Lengths are metres, angles radians, areas shares
of the picture, unless a comment says otherwise."""

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
    "alike": "pieces of the same colours at a shallow crease are one object",
    "steep": "what is seen at a grazing angle is a side of what is nearer",
    "sensor_noise": "what is low or narrow and looks like the table around it is noise or mixed depth, and no object",
    "flying_pixels": "what is small, and narrow or much deeper than it looks large, is mixed depth and no object",
    "hollow_floor": "what is low inside a hollow object is its floor, also where the robot or a shadow cuts its walls",
}
"""The rules by which segments are merged, dropped and filled, by name."""


@dataclass(frozen=True)
class Foreground:
    """Foreground: surfaces that stand on the table."""

    lowest: float = 0.006  # below: noise of the table
    tallest: float = 0.6  # above: no object on the table
    most_seen_through: float = 0.1  # largest share of lower pixels between two pieces of the same table
    lower: float = 0.05  # depth below the table top of surfaces seen beside it
    beyond_table: float = 0.15  # reach of objects beyond the visible table, whose near part is out of the picture
    hidden_table: float = (
        0.04  # margin of the visible table for the table that they occlude: as much is unseen beside a
    )
    # bin's near wall and the robot


@dataclass(frozen=True)
class PatchCutting:
    """Smooth patches of the foreground. Bends are sagitta over chord."""

    bend: float = 0.037  # bend of the first cuts: a concavity of about 8 degrees, often mere noise
    crease: float = 0.19  # mean bend over a border that keeps two patches apart
    jump: float = 0.3  # value of a depth jump in that mean, and bound on a bend
    reach: float = 0.010  # chord half-length along the surface
    shortest: int = 6  # pixels: shorter borders are ignored
    fold: float = 0.25  # mean bend up to which an enclosed patch is a fold, a print or noise of its neighbour
    enclosed: float = 2.5  # border of an enclosed fragment, over the side of a square of its area
    fragment: float = 0.5  # largest fragment, as a share of the enclosing patch's pixels


@dataclass(frozen=True)
class HollowShape:
    """Objects open at the top, and tops of solid objects."""

    rim: float = 0.015  # height and width of a rim
    deep: float = 0.015  # least depth of the floor below the rim
    shallow: float = 0.35  # largest share of the inside at the height of the rim
    surrounded: float = 0.6  # least share of the footprint that the rim encloses
    cells: int = 8  # grid cells along a side of a square of the footprint's area
    filled: float = 0.75  # least visible share of a solid object's footprint
    sag: float = 0.005  # largest depth of its middle below its border
    raised: float = 0.02  # least height of its top above the table: lower is a floor


@dataclass(frozen=True)
class RimVisibility:
    """Insides of hollow objects seen over the edge of another part."""

    end: float = 0.2  # share of an edge's columns that is its end
    risen: float = 0.5  # height of the inside at both ends, as a share of the rim's height
    closed: float = 0.6  # largest distance of the sides there, as a share of the rim's width
    span: float = 0.5  # least share of the narrower part's columns along the edge
    fewest: int = 8  # columns: shorter edges are ignored


@dataclass(frozen=True)
class PartMerging:
    """Patches that are parts of the same object."""

    touching: float = 0.012  # distance of touching parts
    rim_level: float = 0.02  # height difference of parts of the same rim
    beside: float = 0.02  # distance of adjacent walls
    rim_gap: float = 0.05  # gap between the ends of a rim
    overlap: float = 0.5  # share of its points over another's footprint: a part in or on it, no near wall
    interior_overlap: float = 0.7  # share of an inside's points over the footprint of its walls
    below_rim: float = 0.008  # largest height of the inside above the walls
    thickest_wall: float = 0.04  # thicker is no wall, even blurred by a bad sensor
    smaller: float = 0.4  # largest attached part, as a share of the whole's pixels
    tiny: float = 0.2  # largest tab, as a share of the whole's pixels
    tab: tuple[float, float] = (0.025, 0.065)  # largest thickness and length of a tab that sticks out of a higher part
    on_top: float = 0.03  # largest depth of a cap's lower end below the top of the whole
    covered: float = 0.5  # least share of a cap's points over the whole
    cap: float = 0.045  # largest width and height of a cap
    unsupported: float = 0.02  # height above the table from which a part needs a support
    carrier_distance: float = 0.025  # height difference between a support and the part's underside
    carried: float = 0.25  # share of the part's points over its support
    handle: tuple[float, float] = (0.044, 0.12)  # largest thickness and length of a handle: other objects are wider
    alike: float = 0.65  # least Bhattacharyya coefficient of the colours of a tab or a handle and of the whole


@dataclass(frozen=True)
class OccludedPieces:
    """Pieces of an object that an occluder, or a gap in its depth, separates: pieces of the same height that form a
    rectangle, or pieces of the same colours that reach to each other. Of 25 pairs with a hidden gap and the same
    colours (synthesised and real scenes) none were two objects."""

    same_level: float = 0.005  # height difference of the tops: beyond any sensor's noise
    rectangle: float = 0.9  # share of a rectangle that the joint footprint fills
    hue: float = 0.15  # distance of the shares of red, green and blue within an object, by print or light
    brightness: float = 2.5  # largest ratio of brightness
    between: float = 0.6  # least share of the shortest way between them over occluders
    longest: float = 0.4  # largest joined object
    alike: float = 0.75  # Bhattacharyya coefficient of matching colour histograms
    lines: int = 12  # shortest lines across a gap; their medians count
    hidden: float = 0.7  # least share of a line without depth, or with a nearer surface
    nearer: float = 0.005  # m before the straight line: an occluder
    widest: float = 0.065  # m: largest gap
    steepest: float = 2.0  # m of depth per metre of gap: a steeper step is a jump to another object


@dataclass(frozen=True)
class TouchingPieces:
    """Contact of two pieces."""

    open: float = 0.4  # least share of their border without depth jump,
    shortest: int = 5  # and its least length, pixels


@dataclass(frozen=True)
class PlainColor:
    """Touching pieces of the same plain colour. Chosen on synthesised scenes, of 1,019 pairs: 72 of the same object are
    joined, and a single pair of two."""

    hue: float = 2.0  # of CIE a* and b*, both as dark as the darker piece: 1 is just visible, noise is as much again
    brightness: float = 2.0  # ratio of luminance: two sides of an object in the light of a room differ by as much;
    spread: float = 20.0  # of a* and b*: printed surfaces spread farther
    fewest: int = 20  # pixels within its border: a smaller piece has no reliable colour


@dataclass(frozen=True)
class AlikePieces:
    """Touching pieces of the same colours, plain or printed. On 33 photos 6 pairs of the same object are joined, and no
    two objects, of which the most similar have a crease of 0.23."""

    crease: float = 0.22  # largest mean bend over their border
    alike: float = 0.9  # Bhattacharyya coefficient of their colours


@dataclass(frozen=True)
class SteepPieces:
    """Pieces at a grazing angle."""

    # Tangent of the angle between view and normal, its median: of 320 segments on 33 photos 3 have more than 2.7, two
    # sides of a box and mixed depth.
    steep: float = 4.0


@dataclass(frozen=True)
class SegmentFilter:
    """Segments that are no objects, and floors of hollow objects."""

    smallest: float = 0.0004  # of the picture: least area of an object
    flattest: tuple[float, float] = (0.007, 0.012)  # least height of an object, for a good and for a bad sensor;
    deviations: float = 5.0  # in between, in standard deviations of the table's points
    alike: float = 0.93  # Bhattacharyya coefficient of the colours of noise and of the table around it
    around: int = 20  # pixels of the working size: reach of the table around a piece
    mixed: float = 0.5  # largest share of mixed depth off its edges, if it has the table's colours
    sliver: float = 0.002  # of the picture: largest skirt or sliver; a strip of more is a side of an object
    flying: float = 2.0  # its depth range over the side of a square of its area
    band: int = 2  # pixels of mixed depth at the edges of a segment, and
    inner: float = 0.38  # share of a narrow object off them: pieces of labelled objects have 0.4 at least
    border: int = 3  # pixels from the border of the view: a segment there is cut
    unmeasured: float = 0.05  # of the picture's side: widest strip along it that a registered depth leaves unmeasured
    fewest: int = 10  # pixels at the border: fewer are ignored
    clear: float = 0.05  # least height of an arm at the border above the table
    round: float = 0.02  # height range of the flat top of an object that the border cuts
    top_beside_arm: int = 90  # percentile of the heights that is the top, where the known arm's depth may be mixed in
    long: float = 0.15  # least reach of an arm along the table
    floor: float = 0.015  # height range of a hollow object's floor about the table
    floor_margin: float = 0.005  # and its distance inside the footprint


@dataclass(frozen=True)
class RoundFootprint:
    """Round objects completed by half ellipses, fitted to slices of the visible side."""

    slices: int = 6  # of an object's height
    fewest: int = 40  # points of a slice
    fewest_slices: int = 2  # that are half ellipses
    widest: float = 0.93  # of the widest slice: at least as wide slices count for the depth
    error: float = 0.06  # largest residual of the ellipse, of the half width,
    better: float = 0.5  # and of a rectangle's residual
    round: float = 0.7  # depth over width above which an ellipse is a circle
    depths: tuple[float, float] = (0.4, 1.8)  # over the width: flatter is a face, deeper is no fit
    seen: float = 0.97  # of the width: points farther out are flying pixels


@dataclass(frozen=True)
class RimFootprint:
    """The circle of a bowl's rim."""

    flat: float = 0.6  # largest height over width: higher is a cup, measured better by side and handle
    high: float = 0.012  # height of the rim's points below the top
    fewest: int = 60  # points of a circle
    rounds: int = 2  # of refitting the circle to the points near it
    near: float = 0.004  # points nearer to the circle always count
    better: float = 0.8  # residual of the circle over that of a rectangle, on average
    sectors: int = 24  # of the circle
    seen: float = 0.6  # least share of the sectors with points
    wide: float = 1.24  # radii: points beyond are a handle's
    low: float = 0.5  # of the height: lower points beyond are stray
    handle: float = 0.02  # largest share of a handle's points: with more the object is not round


@dataclass(frozen=True)
class Measuring:
    """Boxes, shapes and crops of segments."""

    largest: float = 0.5  # largest object that the arm could move
    fewest: int = 30  # points of a measured segment
    # Least measured pixels, as a share of the picture (245 of 640 x 480), and least area across the view, m^2 (a cube
    # of 3 cm shows 13 cm^2), of an object that a task may use. Of the 18 labelled photos each of the 125 right segments
    # has more; of 164 segments on 15 other photos 11 have less, of which three are objects of their own. With 490
    # pixels the bottles and cups of a desk 2.3 m away are too few.
    sure_pixels: float = 0.0008
    sure_area: float = 12e-4
    most: int = 60_000  # points in the sample of a segment: more than any in a photo of 640 x 480
    samples: int = 3000  # points from which a footprint is measured
    overhang: float = 0.12  # of the diameter: points farther beyond a round footprint contradict it
    outliers: float = 0.4  # percent of the points trimmed at each end of each axis for a footprint
    gap: float = 0.05  # along the view, to points of another surface,
    few: float = 0.1  # if these are a smaller share of the points
    workspace_center: tuple[float, float] = (0.5, 0.0)  # position of the objects' middle in a frame laid on the table
    round: RoundFootprint = RoundFootprint()
    rim: RimFootprint = RimFootprint()


@dataclass(frozen=True)
class MaskProposals:
    """Selection and joining of a model's masks."""

    alike: float = 0.7  # intersection over union of duplicates, of which the best score is kept
    standing: float = 0.5  # least share of a mask's measured pixels on the foreground: else it is table or background
    seen: float = 0.2  # and of all its pixels
    spill: int = 3  # pixels that masks may spill over the table around objects
    blur: int = 8  # pixels between a mask's edge and the edge in depth
    covered: float = 0.8  # least share of a covered part within a mask


@dataclass(frozen=True)
class EnclosedFloors:
    """Floors that are lower than the noise of a pixel."""

    wall: float = 0.02  # least measured height of enclosing walls, however thin
    floor: float = 0.0028  # least median height: cardboard is thicker; the table between objects of a heap seems up to
    # 2.7 mm high
    cut: float = 0.1  # least share of the border along raised pixels; the robot or a shadow may cut the rest
    pixels: float = 0.0004  # of the picture: least area for a reliable average
    gap: int = 5  # pixels between a floor and its walls, which shadow it
    owned: float = 0.2  # least share of the border along the segment that owns a floor


@dataclass(frozen=True)
class ColorBorders:
    """Borders of objects by colour; lengths in pixels of the working size."""

    reach: int = 24  # of pixels without depth beyond an object's convex outline, which its depth may not fill
    border: int = 2  # width of the flying-pixel band at each side of a depth discontinuity
    around: int = 6  # neighbourhood of a border pixel whose colours are compared with its colour
    color_noise: float = 0.01  # standard deviation of a colour (0..1) within a surface
    stay: float = 0.3  # advantage of a pixel's present owner
    inner: float = 0.3  # least share of an object's pixels off its border: with fewer the border stays


@dataclass(frozen=True)
class RectangleMasks:
    """The object in a rectangle. Chosen on 7 of the 13 OSD photos and 2 cluttered tables of another camera, by the
    overlap with the truth; odds are log odds of object against background, borders costs of a superpixel's side."""

    # Pieces of depth; lengths are shares of the rectangle's longer side
    around: float = 1.0  # surroundings in which a piece is measured
    within: float = 0.6  # least share of a piece inside the rectangle
    fewest: int = 20  # pixels of a piece
    least_piece: float = 0.01  # of the rectangle: less is a sliver at a border
    redrawn: float = 0.7  # fit of a known object that the rectangle is drawn around anew
    least_filled: float = 0.2  # of the rectangle: a pen across it fills more; slivers in its corners do not
    gain: float = 0.03  # least gain in fit by a further piece
    known: float = 0.1  # loss of fit of pieces that all belong to known objects
    poor: float = 0.6  # fit up to which the pieces say nothing
    good: float = 0.8  # fit from which they are trusted
    # Superpixels
    rim: float = 0.35  # surroundings that show the background's colours
    least_rim: int = 10  # pixels
    step: float = 0.055  # side, of the rectangle's mean side
    least_step: float = 4.0  # pixels: smaller ones mix colours
    words: int = 24  # clusters of colour
    slack: float = 0.025  # of a side, by which an object may leave the rectangle: people draw no better
    # Odds and costs
    color: float = 0.5  # weight of the odds of a colour
    most_color: float = 3.5  # largest odds of a colour
    unlike: float = 0.3  # least odds of a colour from which the first colours of the object are learnt
    chosen: float = 4.0  # of the pieces that fill the rectangle, at full trust
    left: float = 1.3  # against the others, at full trust
    taken: float = 6.0  # against known objects that the rectangle is filled without
    table: float = 1.2  # against what is as low as the table, at full trust
    least_table: float = 0.25  # share of it without trust: low objects are as low
    color_border: float = 4.0
    alike: float = 12.0  # Lab distance of neighbours at which the cost of a border falls to 37 %
    depth_border: float = 4.0
    least_depth: float = 0.3  # share of it without trust
    sharp: float = 4.0  # fall of the cost of a border at a jump, as an exponent
    biases: tuple[float, ...] = (0.15, 0.5, 0.85)  # to the object, each where it is lost with the one before
    rounds: int = 4  # of learning colours
    # Choice among the cuts
    enough: float = 0.8  # fit
    margin: float = 0.025  # least gain in fit by a later cut
    bold_margin: float = 0.2  # by one with less trust in depth, or without regard to known objects
    part: float = 0.1  # least area of a part, in shares of the largest: an occluded object is in parts
    smallest: int = 60  # pixels of a part


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
    alike: AlikePieces = AlikePieces()
    steep: SteepPieces = SteepPieces()
    filter: SegmentFilter = SegmentFilter()
    floors: EnclosedFloors = EnclosedFloors()
    proposals: MaskProposals = MaskProposals()
    color_borders: ColorBorders = ColorBorders()
    rectangles: RectangleMasks = RectangleMasks()

    def without_rules(self, *rules: str) -> Self:
        """A copy without some rules; raises UnknownNameError for an unknown rule."""
        for rule in rules:
            if rule not in RULES:
                raise UnknownNameError("segmentation rule", rule, RULES)
        return replace(self, rules=self.rules - frozenset(rules))
