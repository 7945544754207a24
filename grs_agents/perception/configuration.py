"""Every constant of perception, by stage, with its unit and why it has this value.
Functions of a stage take the part that they need; `DEFAULT` is what all of them are measured with. Lengths are metres,
angles radians, areas shares of the picture, unless a comment says otherwise."""

import math
from dataclasses import dataclass, field

from grs_agents.perception.segmentation.configuration import Measuring, Segmentation


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

    # m: what is nearer to the arm is taken for it, at least and at most: hand-eye calibrations and the arms' models
    # are better than the second, but if they are 1 cm off, the first leaves pieces of the arm beside it.
    margin: tuple[float, float] = (0.015, 0.025)
    blur: float = 0.01  # m: the margin of an arm that is where it should be, as depth is mixed at its edges;
    errors: float = 1.5  # so many times the measured error in depth is added,
    percentile: int = 80  # which is this percentile: at steep sides depth is off by more
    inset: int = 9  # pixels: the error is measured where a square of so many lies on the arm
    fewest: int = 100  # such pixels: of fewer it is not known
    rays: int = 20_000  # the arm is drawn with about so many
    layer: float = 1.25  # times the depth: so much of the arm at a time
    nearest: float = 0.1  # m: the margin of what is nearer is no wider, or a lens at the arm would make it the picture
    over_table: float = 0.002  # what a ray meets lower is the table
    slack: float = 0.01  # rad: encoders may say so much beyond a limit


@dataclass(frozen=True)
class StrayLightFit:
    """How the robot's light in the depth of what is beside it is measured."""

    near: float = 40.0  # pixels from the robot, at the working size: farther its light does not count
    plane: float = 0.004  # m: what is closer to the table's plane lies in it
    lifted: float = 0.1  # m: what is higher was not lifted by light alone
    widths: tuple[float, ...] = (7.0, 10.0, 14.0, 20.0)  # pixels at the working size, of the light's spread
    shares: tuple[float, ...] = (0.002, 0.004, 0.006, 0.008, 0.011, 0.015, 0.02, 0.03, 0.04)  # of the light around
    gain: float = 0.03  # of the pixels beside the robot must come to lie in the plane, or nothing is corrected
    nearest: float = 0.2  # m: nearer no camera measures
    darkest: float = 0.02  # of 1: darker pixels return as little light as these
    most: float = 0.5  # of a pixel's light may be that of others


@dataclass(frozen=True)
class WorkingResolution:
    """The size at which large photos are segmented, and how their pixels choose between segments."""

    pixels: int = 640 * 480  # photos of many more are reduced: the size that all other values were chosen at
    color: float = 24.0  # of 255: a difference that counts as much as a depth off by its tolerance
    cells: float = 1.0  # a distance that counts as much


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
class SilhouetteCost:
    """How well an asset's silhouette agrees with an object's pixels."""

    weight: float = 0.01  # m: a silhouette that nothing agrees with costs as much as being so far off the points
    pixels: int = 100  # along the object's longer side: no more are drawn
    margin: float = 0.5  # of that side, around it: what reaches farther out is not seen to
    nearer: float = 0.008  # m: what was measured so much nearer hides the asset
    nearest: float = 0.001  # m: nothing is nearer to the camera


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
    last: int = 3  # the best of them once more, by so many of the steps, also to the silhouette
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
    silhouette: SilhouetteCost = SilhouetteCost()
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
    aside: float = 0.002  # m: one that moves less to a side only sinks


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
    robot: float = 0.5  # of its pixels: a segment of which more are the robot's is a hole in the arm's depth
    thin: int = 4  # pixels: what lies nearer to the robot,
    mostly: float = 0.98  # with more of its pixels, is its edge
    meets: int = 8  # pixels: what is so near to the robot is beside it
    widest: int = 20  # pixels: its blurred edge is narrower
    low: float = 0.025  # m: most of its blurred edge over the table is lower
    fades: float = 0.015  # m: and most of its far third, for it fades into the table
    falls: float = 0.003  # m: by more its near third is higher than that; a pen beside it is level
    ring: int = 2  # pixels around a segment are its border:
    segments: float = 0.1  # of it less is that of other segments beside a blurred edge,
    borders: float = 0.04  # and more is the table's,
    table: float = 0.008  # m: which is lower
    mixed: float = 0.65  # of a segment: more of it mixes robot and wall, or it is an object that the robot hides
    level: float = 0.005  # m: what mixes both has no level top, of which half is within this


@dataclass(frozen=True)
class CoverageMeasuring:
    """Which pixels rise above the table, and which of those that no object owns are listed."""

    lowest: float = 0.004  # what is lower is the table
    deviations: float = 1.5  # and what is lower than so many standard deviations of the table's points
    foot: int = 4  # pixels: a foot reaches so far from what clearly rises
    enclosed: float = 0.7  # of its border: what rises encloses a piece with more than this
    listed: float = 0.005  # of what rises: a smaller region is counted, but not listed
    most: float = 0.5  # of a region: what holds of more than this share of it is the reason
    thin: int = 5  # pixels: what is thinner is an edge
    halo: int = 7  # pixels around what is left out: its blurred edges do not count, but for what beside the robot,
    high: float = 0.02  # m: and not at it, is higher: of that 2 in 3 pixels show an object, of lower ones 1 in 10
    named: int = 3  # regions are named in a warning


@dataclass(frozen=True)
class Perception:
    """All stages, in the order in which a photo passes them."""

    noise: NoiseSmoothing = NoiseSmoothing()
    depth_alignment: DepthAlignment = DepthAlignment()
    table: TableFinding = TableFinding()
    robot: RobotPixels = RobotPixels()
    stray_light: StrayLightFit = StrayLightFit()
    resolution: WorkingResolution = WorkingResolution()
    segmentation: Segmentation = field(default_factory=Segmentation)
    measuring: Measuring = field(default_factory=Measuring)
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
