"""Every constant of perception, by stage, with its unit and why it has this value.
Functions of a stage take the part that they need; `DEFAULT` is what all of them are measured with. Lengths are metres,
angles radians, areas shares of the picture, unless a comment says otherwise."""

import math
from dataclasses import dataclass, replace
from typing import Self

from grs_agents.errors import UnknownNameError
from grs_agents.perception.segmentation import RULES


@dataclass(frozen=True)
class TableFinding:
    """Level planes by RANSAC, and which of them is the table."""

    samples: int = 12_000  # pixels: a plane of the least share still has 1,400 of them
    rounds: int = 400  # hypotheses: a plane of the least share is drawn in half of all scenes, a usual table in all
    least_share: float = 0.12  # of the measured pixels: the table holds at least this many
    lowest_tilt: float = math.radians(12)  # the camera looks down on the table by at least this angle
    occluded_depth: float = 0.1  # a table hides what is under it: points less than this under a plane speak against it
    level: float = math.radians(12)  # a calibrated table's normal is within this of the robot's z axis
    highest: float = 0.2  # a calibrated table top lies within this height of the robot frame's z = 0
    plane_distance: float = 0.25  # level planes nearer than this are one; the lowest stools are 0.26 m high
    listed_share: float = 0.05  # of the measured pixels: such a plane is listed, and the user may choose it
    object_heights: tuple[float, float] = (0.015, 0.6)  # over the noise of a depth camera, under furniture
    loaded_share: float = 0.01  # of a plane's pixels show objects on it: a 4 cm cube on a table of 1 m has 0.016
    doubtful_tilt: float = math.radians(3)  # a hand-eye calibration is better than this
    doubtful_share: float = 0.2  # tables under the densest heaps of the reference scenes hold a quarter of the pixels


@dataclass(frozen=True)
class NoiseSmoothing:
    """Depth with much noise is smoothed before all else: all other values were chosen with up to 3 mm at 1 m."""

    each: float = 0.0075  # one median over 5 x 5 pixels for so much noise at 1 m
    most: int = 4  # and no more of them: small objects are gone then


@dataclass(frozen=True)
class DepthAlignment:
    """When depth is said to be shifted against colour; pixels of the working resolution."""

    jump: float = 0.02  # share of the distance: less is a surface's slope
    fewest: int = 150  # pixels at jumps, or chance decides
    most: int = 2_000  # more agree on the same shift
    reach: int = 24  # as far off as a registration for another resolution is
    calibrated: float = 4.0  # of 18 photos none is off by more than 2.3: near sides lie inside outlines
    gain: float = 0.3  # of those photos at most 0.26


@dataclass(frozen=True)
class RobotPixels:
    """Which pixels show the robot."""

    margin: float = 0.025  # hand-eye calibrations, and the arms' models, are better than that
    rays: int = 20_000  # the arm is drawn with about so many
    over_table: float = 0.002  # what a ray meets lower is the table
    slack: float = 0.01  # rad: encoders may say so much beyond a limit


@dataclass(frozen=True)
class WorkingResolution:
    """The size at which large photos are segmented, and how their pixels choose between segments."""

    pixels: int = 640 * 480  # photos of many more are reduced: the size that all other values were chosen at
    color: float = 24.0  # of 255: a difference that counts as much as a depth off by its tolerance
    cells: float = 1.0  # a distance that counts as much


@dataclass(frozen=True)
class Foreground:
    """What stands on the table."""

    lowest: float = 0.006  # what is lower is the noise of the table
    tallest: float = 0.6  # what rises higher is not an object on it
    most_seen_through: float = 0.1  # of what lies between two pieces of plane may show something lower: one table
    lower: float = 0.05  # what is so much lower than the table top is seen beside it, not on it
    beyond_table: float = 0.15  # from its visible part, objects stand on its near part that is out of the picture


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
    tiny: float = 0.2  # of the other's pixels: a tab or a ridge has fewer
    tab: tuple[float, float] = (0.025, 0.065)  # what is thinner and shorter, and sticks out of something higher
    on_top: float = 0.03  # what begins no lower than this below the top of another may be its cap or ridge
    covered: float = 0.5  # of the points of a cap or ridge lie over what it is on
    cap: float = 0.045  # what is smaller across and lower, on top of something larger, is its cap
    ridge: float = 0.1  # along the top of something larger, as thin as a tab, and at most so long
    unsupported: float = 0.02  # what hangs higher above the table wants a support
    carrier_distance: float = 0.025  # what carries a part ends within this of the part's underside
    carried: float = 0.25  # of the part's points lie over what carries it
    handle: tuple[float, float] = (0.044, 0.12)  # what is thinner and shorter may be a handle: other objects are wider
    shortest: int = 6  # pixels: parts with a shorter border do not go over into each other


@dataclass(frozen=True)
class OccludedPieces:
    """When two pieces are one flat object that others in front of it separate."""

    level: float = 0.01  # tops of two pieces are within this height of each other
    flat: float = 0.45  # at least this share of a piece lies within `level` of its top
    hue: float = 0.05  # distance of the shares of red, green and blue: colours of one object are this near
    brightness: float = 1.6  # the brighter piece is at most this many times as bright
    same_level: float = 0.005  # where tops are this near, as no sensor's noise moves them by more,
    rectangle: float = 0.9  # and the footprint of both fills so much of its rectangle,
    printed: tuple[float, float] = (0.15, 2.5)  # colours may differ by this hue and brightness: by print or light
    between: float = 0.6  # at least this share of the shortest way between them lies on objects that hide them
    longest: float = 0.4  # a joined object is at most this long


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
    rounds: int = 5  # of fitting the circle to the points near it
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
    blur: int = 2  # pixels: a mask's edge may be so far off the edge in the depth
    covered: float = 0.8  # of a part: a mask that holds at least this much covers it


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
    filter: SegmentFilter = SegmentFilter()
    proposals: MaskProposals = MaskProposals()

    def without_rules(self, *rules: str) -> Self:
        """The same with some rules off.
        Raises UnknownNameError: there is no such rule."""
        for rule in rules:
            if rule not in RULES:
                raise UnknownNameError("segmentation rule", rule, RULES)
        return replace(self, rules=self.rules - frozenset(rules))


@dataclass(frozen=True)
class Matching:
    """Whether a named asset stands for an object."""

    # An asset less likely to be the right one than this gives way to a proxy: a wrong product costs a task more than
    # a right one that is only measured. On scenes that nothing was fitted to, 1 in 40 named above it was wrong, of
    # those named between 0.4 and it 2 in 5.
    least: float = 0.7


@dataclass(frozen=True)
class PoseCost:
    """How well an asset at a pose explains what the camera saw."""

    samples: int = 500  # of an object's points, and of the asset's surface, are compared
    farthest: float = 0.03  # what is farther off counts as this far: it belongs to another object
    free_space: float = 0.006  # a surface so far before what was measured is in free space; depth is not better
    free_space_weight: float = 0.7  # of free space that is entered, against the residual
    trimmed: float = 0.9  # the nearest of the points say how good a fit is; the rest are flying pixels


@dataclass(frozen=True)
class PoseHypotheses:
    """Poses from which a registration begins."""

    same_plane: float = math.radians(12)  # normals of one plane are within this of each other
    second_plane: float = 0.1  # of the points: a second plane holds at least this many
    oblique: float = 0.25  # a side is seen whose normal is nearer to the view than this sine
    hidden: float = 0.015  # what is seen is shorter than the asset by more than this, or longer: part of it is hidden
    level: float = math.radians(6)  # a plane that is level within this adds nothing to the measured box


@dataclass(frozen=True)
class Registration:
    """The search for the pose of an asset."""

    fewest: int = 30  # points: an object of fewer is left where its box puts it
    aligned: int = 4  # so many hypotheses are aligned; the others look worse from the start
    coarse: int = 4  # hypotheses are compared by one of so many samples
    medium: int = 2  # and poses, once they are aligned, by one of so many
    slid: int = 8  # so many hypotheses are also tried with either end of the object at either end of the asset
    apart: float = 0.02  # hypotheses that look alike and are nearer than this are one
    look_angle: float = 20.0  # degrees: those that are turned by less look alike
    steps: tuple[tuple[float, float], ...] = ((0.008, 0.16), (0.004, 0.08), (0.002, 0.04), (0.001, 0.02))
    """A pose is shifted and turned about z by so much to see whether that costs less: each half of the one before."""
    refined: int = 2  # so many of the aligned poses are refined
    partner_distance: float = 0.03  # partners of an alignment are at most so far apart
    lying: float = 0.0015  # a pose that is not upright has to fit better by so much
    tilted: float = 0.001  # and one that rests on none of its sides
    better: float = 0.0003  # a registered pose that fits no better than the box by so much is not taken
    sunk: float = 0.004  # what reaches no deeper below the table stands on it
    leaning: float = math.radians(12)  # what leans less stands straight, unless it fits better leaning
    rests: float = 0.015  # its side is no farther than this from the measured bottom
    worst: float = 0.015  # a residual above this is no fit
    entered: float = 0.004  # what enters another object no deeper touches it; poses are known no better
    entered_weight: float = 0.5  # of what it enters deeper, against the residual
    cost: PoseCost = PoseCost()
    hypotheses: PoseHypotheses = PoseHypotheses()


@dataclass(frozen=True)
class SurfaceExplanation:
    """Which points an asset explains, and what of a segment it leaves over."""

    on: float = 0.006  # a point nearer to a surface lies on it
    piece: float = 0.8  # of its points lie on the surface that a segment is a piece of
    off: float = 0.012  # points farther from a surface are not its own; sensors and poses are better than that
    explained: float = 0.5  # an asset that explains less of its segment is the wrong one: it says nothing
    shown: float = 0.35  # of its near surface at least this share is where one was measured
    in_free_space: float = 0.1  # and at most this share before it
    smallest: float = 0.0006  # of the picture: something left over covers at least so much
    joined: float = 0.3  # a segment with more than this share on other objects' surfaces is theirs and the rest


@dataclass(frozen=True)
class SizeCheck:
    """When an asset agrees with the box that was measured."""

    center: float = 0.02  # the centre may be off by so much
    size: float = 0.25  # and each extent by such a share
    # A named asset that fits the points this closely beats the measured box, which is cut off where something hides the
    # object: of 139 true assets on synthesised scenes within `near`, the box of 39 did not agree, and registered poses
    # were 2.3 mm off (ADD-S, median) where boxes were 5.0. On real photos none of the wrong ones was so close.
    certain: float = 0.7
    near: float = 0.002


@dataclass(frozen=True)
class CollisionRepair:
    """When objects that were registered into each other are registered again."""

    deep: float = 0.006  # objects that are deeper in each other are not where they were registered
    deepest: float = 0.015  # if they can be nowhere else, and are deeper, one is not what it was taken for
    worse: float = 0.004  # a pose that costs more than the first one by more than this does not show what was seen
    most: int = 8  # pairs are looked at: each costs two registrations


@dataclass(frozen=True)
class Depenetration:
    """How overlapping objects are moved apart."""

    free: float = 0.8  # of what counts as deep: what overlaps by less is apart
    steps: tuple[float, ...] = (0.002, 0.004, 0.006, 0.009, 0.013, 0.018, 0.025, 0.035)  # tried in turn: least first
    last_steps: tuple[float, ...] = (0.05, 0.07, 0.1)  # and these, once nothing else took everything apart
    # Overlaps up to each of these are left to easing. Which moves objects least hangs on the scene: they are tried in
    # turn until nothing moves too far.
    depths: tuple[float, ...] = (0.003, 0.012, 0.0015, 0.02)
    guessed: float = 4.0  # an object of unknown shape moves so many times as far: its place is known that much worse
    far: float = 0.01  # but not by more than this where something known need move less
    most: int = 12  # objects are moved


@dataclass(frozen=True)
class ColliderClearance:
    """How colliders that reach into each other are cut back."""

    deep: float = 0.0005  # what overlaps by less is apart
    rounds: int = 3  # of cuts: what is cut may still be in a third
    kept: float = 0.4  # of its volume: an object that would keep less is not cut
    thinnest: float = 0.001  # what is left of a collider is left out if it is thinner
    upright: float = 0.5  # a plane between two things that rises more steeply than by 60 degrees is made upright, so
    # that each can be lifted out beside the other
    level: float = 0.98  # one that rises by less than 11 degrees is made level
    hovers: float = 0.01  # what seems to end so little above its support stands on it: boxes are cut on a grid of 8 mm
    moved: float = 0.005  # an object that moves farther until it rests has the colliders of its box instead,
    tilted: float = math.radians(3)  # so has one that tilts by more


@dataclass(frozen=True)
class Settling:
    """How a described scene comes to rest in MuJoCo."""

    eased: float = 0.0005  # objects are eased apart until they overlap by less
    easing_steps: int = 200  # in at most so many steps
    longest: float = 2.0  # simulated seconds in which everything should come to rest
    still: float = 0.01  # m/s: what is slower rests
    rolling: float = 0.004  # arm of the rolling resistance: nothing in a photo rolls
    table_center: tuple[float, float] = (0.4, 0.0)  # the middle of the simulated table
    table_reach: float = 1.1  # only what lies within this distance of it stands on the table
    overlap: float = 0.001  # what overlaps by more at rest is moved apart again
    tries: int = 3  # so many times in all
    wedged: float = 0.003  # what overlaps by less after that is moved by little first
    fallen: float = 0.01  # what moves farther was not at rest as it is described, or not there
    near: float = 0.02  # a pixel of the twin is right within this depth
    rays: int = 20_000  # at most so many pixels are compared, evenly drawn
    picture_side: int = 1280  # pixels of the longer side of a picture of the twin: what a report shows
    depenetration: Depenetration = Depenetration()
    clearance: ColliderClearance = ColliderClearance()
    repair: CollisionRepair = CollisionRepair()


@dataclass(frozen=True)
class SupportRelations:
    """Which object lies on, in or against which."""

    gap: float = 0.006  # surfaces closer than this, beyond how densely they are sampled, touch; depth is not better
    sunk: float = 0.3  # of a container's height: what is in it begins below its rim by at least this
    inside: float = 0.7  # so much of its outline is above the container
    raised: float = 0.012  # what begins lower above the table stands on the table
    cell: float = 0.008  # of the grid on which heights are compared


@dataclass(frozen=True)
class BackgroundReconstruction:
    """What the photo shows besides the table and the objects."""

    truncation: float = 3.0  # voxels: farther behind a surface nothing is known
    most_voxels: int = 8_000_000  # of more the grid is made coarser: it holds one float and one flag each
    most_faces: int = 20_000  # of more the mesh is made coarser, for those who draw it
    flattest: float = 0.05  # metres of distance for each metre of depth: a flatter surface is not taken to be seen
    most_boxes: int = 200  # of more the cells are made larger
    thickness: float = 0.01  # a box is at least this thick
    low: tuple[float, float, float] = (-2.0, -2.0, -1.0)  # lowest corner of the space around the robot
    high: tuple[float, float, float] = (2.0, 2.0, 2.0)  # and its highest
    margin: float = 0.05  # the background keeps this far away from objects
    clear: float = 0.02  # what of it is solid, after its simplification, still keeps this far away
    edge: int = 200  # one over the share of the picture's width around an object that may mix it with what is behind
    smallest: float = 0.0004  # of the picture: a piece of the background covers at least so much


@dataclass(frozen=True)
class Scenery:
    """What is no object by where it is."""

    base: float = 0.0  # what has its middle behind this x is behind the robot's base
    beyond: float = 0.25  # what has its middle farther from the workspace than this is in no task's way
    meets: int = 8  # pixels: what is so near to the robot is beside it
    widest: int = 20  # pixels: its blurred edge is narrower
    low: float = 0.025  # m: most of its blurred edge over the table is lower
    fades: float = 0.015  # m: and most of its far third, for it fades into the table
    falls: float = 0.003  # m: by more its near third is higher than that; a pen beside it is level
    mixed: float = 0.5  # of a segment: more of it mixes robot and wall, or it is an object that the robot hides
    level: float = 0.005  # m: what mixes both has no level top, of which half is within this


@dataclass(frozen=True)
class CoverageMeasuring:
    """Which pixels rise above the table, and which of those that no object owns are listed."""

    lowest: float = 0.004  # what is lower is the table
    deviations: float = 1.5  # and what is lower than so many standard deviations of the table's points
    foot: int = 4  # pixels: a foot reaches so far from what clearly rises
    enclosed: float = 0.7  # of its border: what rises encloses a piece with more than this
    floor: float = 0.0028  # what it encloses and is higher on average is the floor of a box: cardboard is thicker, and
    # the table between things of a heap seems up to 2.7 mm high
    cut: float = 0.2  # of its border, where the robot or a shadow makes up the rest: so much rises beside a floor
    cut_floor: float = 0.004  # and it is higher on average: the table beside the robot is not
    floor_pixels: float = 0.0004  # of the picture: of less the average says nothing
    listed: float = 0.005  # of what rises: a smaller region is counted, but not listed
    most: float = 0.5  # of a region: what holds of more than this share of it is the reason
    thin: int = 5  # pixels: what is thinner is an edge
    halo: int = 10  # pixels around what is left out: its blurred edges do not count
    named: int = 3  # regions are named in a warning


@dataclass(frozen=True)
class Perception:
    """All stages, in the order in which a photo passes them."""

    noise: NoiseSmoothing = NoiseSmoothing()
    depth_alignment: DepthAlignment = DepthAlignment()
    table: TableFinding = TableFinding()
    robot: RobotPixels = RobotPixels()
    resolution: WorkingResolution = WorkingResolution()
    segmentation: Segmentation = Segmentation()
    measuring: Measuring = Measuring()
    background: BackgroundReconstruction = BackgroundReconstruction()
    matching: Matching = Matching()
    registration: Registration = Registration()
    explanation: SurfaceExplanation = SurfaceExplanation()
    size: SizeCheck = SizeCheck()
    settling: Settling = Settling()
    relations: SupportRelations = SupportRelations()
    coverage: CoverageMeasuring = CoverageMeasuring()
    scenery: Scenery = Scenery()


DEFAULT = Perception()
