"""Constants of perception, by stage, with unit and motivation.

Functions of a stage take their part; published figures are measured with `DEFAULT`. Lengths are metres, angles radians,
areas shares of the picture, unless a comment says otherwise.
"""

import math
from dataclasses import dataclass, field

from grs_agents.perception.segmentation.configuration import Measuring, Segmentation


@dataclass(frozen=True)
class TableFinding:
    """Planes by RANSAC, and the choice of the table among them."""

    samples: int = 12_000  # pixels: a plane of the least share still has 1,400 of them
    rounds: int = 400  # hypotheses: a plane of the least share is drawn in half of all scenes, a usual table in all
    neighbors: int = 48  # points drawn for a hypothesis of any orientation, which its nearest three make
    least_share: float = 0.12  # of the measured pixels on the table and the objects that stand on it
    bare_share: float = 0.5  # of the measured pixels on a table on which nothing is high enough to be resolved
    occluded_depth: float = 0.1  # points less than this below a plane contradict it: a table occludes them
    level: float = math.radians(12)  # largest angle between a level plane's normal and the vertical
    highest: float = 0.2  # largest |z| of a calibrated table top in the robot frame
    plane_distance: float = 0.25  # nearer level planes are merged; the lowest stools are 0.26 m high
    listed_share: float = 0.05  # of the measured pixels on a listed plane, which the user may choose
    # Of a plane's pixels that show objects on it: a 4 cm cube on a table of 1 m has 0.016. Of all measured pixels on a
    # smaller table.
    loaded_share: float = 0.01
    upper_share: float = 1 / 3  # of the pixels of what the floor carries: objects on a table above it
    # The usual camera looks down by 45 degrees. A plane whose normal is more than 60 degrees off that is a wall in most
    # photos, or a table seen upside down.
    usual: tuple[float, float, float] = (0.0, -math.sqrt(0.5), -math.sqrt(0.5))
    usual_angle: float = math.radians(60)
    unusual_weight: float = 0.5  # of what such a plane carries, against what other planes carry
    doubtful_tilt: float = math.radians(3)  # beyond the error of a hand-eye calibration
    doubtful_share: float = 0.2  # tables under the densest heaps of the reference scenes hold a quarter of the pixels


@dataclass(frozen=True)
class CarriedObjects:
    """Clusters of points that stand on a plane."""

    points: int = 76_800  # of the grid, at most: a 4 cm cube at 1 m has 100
    jump: float = 0.01  # m, per metre of distance beyond -2: a depth jump between points of the grid
    piece: float = 0.1  # of the largest visible piece of the plane: least piece of it
    lowest: float = 0.015  # m: least height of a point over the plane, above the noise of a depth camera
    farthest: float = 3.0  # m: beyond it the depth tolerance is 3 cm, and an arm's objects are a few pixels
    resolved: float = 4.0  # least top, in depth tolerances: lower ones are waves of the depth
    fewest: int = 46  # points of a cluster or of a piece of the plane: the least segment of a photo has as many
    foot: float = 0.1  # m: largest height of the lowest points; higher ones hang, or stand on something tall
    widest: float = 0.3  # m: largest radius, of a heap; walls and furniture are larger
    ring: int = 9  # side of the square that grows a cluster to its surroundings
    free: float = 0.15  # least share of the plane in the measured surroundings


@dataclass(frozen=True)
class NoiseSmoothing:
    """Smoothing of noisy depth before all else: all other values were chosen with up to 3 mm at 1 m."""

    each: float = 0.0075  # noise at 1 m per median over 5 x 5 pixels
    most: int = 4  # medians: more remove small objects


@dataclass(frozen=True)
class DepthAlignment:
    """Shift of depth against colour; pixels of the working size."""

    jump: float = 0.02  # of the distance: less is a surface's slope
    fewest: int = 150  # pixels at jumps: fewer agree by chance
    most: int = 2_000  # more agree on the same shift
    reach: int = 24  # largest shift: that of a registration for another resolution
    calibrated: float = 4.0  # largest shift of calibrated cameras: of 18 photos at most 2.3, near sides lie inside
    gain: float = 0.3  # least gain in agreement: of those photos at most 0.26


@dataclass(frozen=True)
class RobotPixels:
    """Pixels that show the robot."""

    # m around the arm, at least and at most: hand-eye calibrations and models are better than the second; with an error
    # of 1 cm the first leaves pieces of the arm beside it.
    margin: tuple[float, float] = (0.015, 0.025)
    blur: float = 0.01  # m: margin of an exactly placed arm, for flying pixels at its edges,
    errors: float = 1.5  # plus this factor of the measured depth error,
    percentile: int = 80  # at this percentile: depth errors are larger at steep sides
    inset: int = 9  # pixels: side of the square that must lie on the arm where the error is measured
    fewest: int = 100  # such pixels: fewer give no error
    rays: int = 20_000  # with which the arm is rendered, about
    layer: float = 1.25  # ratio of far and near end of a depth layer of the arm
    nearest: float = 0.1  # m: bound on the depth of a margin in pixels, or a lens at the arm would cover the picture
    over_table: float = 0.002  # lower hits of a ray are table
    slack: float = 0.01  # rad: tolerance of encoders beyond a limit


@dataclass(frozen=True)
class StrayLightFit:
    """Stray light of the robot in the depth of its surroundings."""

    near: float = 40.0  # pixels of the working size from the robot: farther its light is negligible
    plane: float = 0.004  # m: distance of points in the table plane
    lifted: float = 0.1  # m: higher points are not lifted by light alone
    widths: tuple[float, ...] = (7.0, 10.0, 14.0, 20.0)  # pixels of the working size, of the light's spread
    shares: tuple[float, ...] = (0.002, 0.004, 0.006, 0.008, 0.011, 0.015, 0.02, 0.03, 0.04)  # of the light around
    gain: float = 0.03  # least share of the pixels beside the robot that a correction brings into the plane
    nearest: float = 0.2  # m: least distance that a camera measures
    darkest: float = 0.02  # of 1: floor of the brightness
    most: float = 0.5  # largest share of stray light in a pixel


@dataclass(frozen=True)
class WorkingResolution:
    """Working size of large photos, and the refinement of labels at full size."""

    pixels: int = 640 * 480  # larger photos are reduced: the size at which all other values were chosen
    color: float = 24.0  # of 255: a difference that costs as much as the depth tolerance
    cells: float = 1.0  # a distance that costs as much


@dataclass(frozen=True)
class Matching:
    """Acceptance of a named asset for an object."""

    # A less likely asset gives way to a proxy: a wrong product costs a task more than a right product that is only
    # measured. On scenes that nothing was fitted to, 1 in 40 named above it was wrong, of those named between 0.4 and
    # it 2 in 5.
    least: float = 0.7


@dataclass(frozen=True)
class PoseCost:
    """Cost of an asset's pose against the measured points."""

    samples: int = 500  # of an object's points, and of the asset's surface
    farthest: float = 0.03  # truncation of residuals: farther points belong to another object
    free_space: float = 0.006  # distance before the measured surface from which a surface is in free space
    free_space_weight: float = 0.7  # of free-space violation, against the residual
    trimmed: float = 0.9  # share of the nearest points that count; the rest are flying pixels


@dataclass(frozen=True)
class SilhouetteCost:
    """Cost of an asset's silhouette against an object's pixels."""

    weight: float = 0.01  # m: residual that costs as much as a silhouette without overlap
    pixels: int = 100  # along the object's longer side, for rendering
    margin: float = 0.5  # of that side, around it: the window
    nearer: float = 0.008  # m: depth difference of an occluder
    nearest: float = 0.001  # m: near plane of the camera


@dataclass(frozen=True)
class PoseHypotheses:
    """Initial poses of a registration."""

    same_plane: float = math.radians(12)  # largest angle between normals of the same plane
    second_plane: float = 0.1  # least share of the points on a second plane
    oblique: float = 0.25  # sine of the angle between view and a visible side
    hidden: float = 0.015  # difference in length from the asset of a partly hidden object
    level: float = math.radians(6)  # a plane nearer to level adds nothing to the measured box


@dataclass(frozen=True)
class Registration:
    """Search for the pose of an asset."""

    fewest: int = 30  # points: with fewer the object stays at its box
    aligned: int = 4  # best hypotheses that are aligned
    coarse: int = 4  # hypotheses are compared by every fourth sample,
    medium: int = 2  # and aligned poses by every second
    slid: int = 8  # hypotheses that are also tried with either end of the object at either end of the asset
    apart: float = 0.02  # distance of hypotheses that look alike and are merged,
    look_angle: float = 20.0  # and the angle between them, degrees
    steps: tuple[tuple[float, float], ...] = ((0.008, 0.16), (0.004, 0.08), (0.002, 0.04), (0.001, 0.02))
    """Steps of the coordinate descent over position (m) and yaw (rad), each half of the previous."""
    refined: int = 2  # best aligned poses that are refined
    last: int = 3  # steps of the final refinement of the best pose, which includes the silhouette
    partner_distance: float = 0.03  # largest correspondence distance of an alignment
    lying: float = 0.0015  # least advantage of a pose that is not upright,
    tilted: float = 0.001  # and of a pose that rests on none of its sides
    better: float = 0.0003  # least advantage of a registered pose over the box
    sunk: float = 0.004  # largest depth below the table of a standing object
    leaning: float = math.radians(12)  # smaller tilts are straightened unless they fit better
    rests: float = 0.015  # largest distance between its side and the measured bottom
    worst: float = 0.015  # largest residual of a fit
    entered: float = 0.004  # penetration of another object that counts as contact: poses are known no better
    entered_weight: float = 0.5  # of deeper penetration, against the residual
    cost: PoseCost = PoseCost()
    silhouette: SilhouetteCost = SilhouetteCost()
    hypotheses: PoseHypotheses = PoseHypotheses()


@dataclass(frozen=True)
class SurfaceExplanation:
    """Points that an asset explains, and the rest of its segment."""

    on: float = 0.006  # distance of a point on a surface
    piece: float = 0.8  # least share of the points on the surface of which a segment is a piece
    off: float = 0.012  # farther points are not of a surface; sensors and poses are better than that
    explained: float = 0.5  # least share of its segment that a right asset explains
    shown: float = 0.35  # least share of its near surface where a surface was measured,
    in_free_space: float = 0.1  # and largest share in free space
    smallest: float = 0.0006  # of the picture: least size of a remaining segment
    joined: float = 0.3  # larger share on other objects' surfaces: the segment is split between them and the rest


@dataclass(frozen=True)
class SizeCheck:
    """Agreement of an asset with the measured box."""

    center: float = 0.02  # tolerance of the centre
    size: float = 0.25  # tolerance of each extent, as a share
    # A named asset that fits the points this closely beats the measured box, which occlusion truncates: of 139 true
    # assets on synthesised scenes within `near`, the box of 39 did not agree, and registered poses were 2.3 mm off
    # (ADD-S, median) where boxes were 5.0. On real photos no wrong asset was as close.
    certain: float = 0.7
    near: float = 0.002
    # factors of a named asset that is scaled to the measured size: packages of one product differ by as much
    smallest: float = 0.5
    largest: float = 2.0


@dataclass(frozen=True)
class CollisionRepair:
    """Repeated registration of objects that overlap."""

    deep: float = 0.006  # overlap from which poses are wrong
    deepest: float = 0.015  # remaining overlap from which an asset is wrong
    worse: float = 0.004  # largest increase in cost over the first pose
    most: int = 8  # pairs: each costs two registrations


@dataclass(frozen=True)
class Depenetration:
    """Separation of overlapping objects."""

    free: float = 0.8  # of the deep overlap: less is apart
    steps: tuple[float, ...] = (0.002, 0.004, 0.006, 0.009, 0.013, 0.018, 0.025, 0.035)  # tried in turn: least first
    last_steps: tuple[float, ...] = (0.05, 0.07, 0.1)  # and these, if the others separate not everything
    # Overlaps up to each of these are left to easing. The best bound depends on the scene: they are tried in turn until
    # nothing moves too far.
    depths: tuple[float, ...] = (0.003, 0.012, 0.0015, 0.02)
    guessed: float = 4.0  # factor by which an object of unknown shape may move farther: its position is less certain,
    far: float = 0.01  # but at most this if a known object can move less
    most: int = 12  # moved objects


@dataclass(frozen=True)
class ColliderClearance:
    """Trimming of overlapping colliders."""

    deep: float = 0.0005  # smaller overlaps are contacts
    rounds: int = 3  # of cuts: a cut collider may still overlap a third
    kept: float = 0.4  # least remaining share of its volume: an object that would keep less is not cut
    thinnest: float = 0.001  # thinner remains of a collider are removed
    upright: float = 0.5  # a cut plane steeper than 60 degrees is made upright, so that each object can be lifted out
    level: float = 0.98  # a cut plane flatter than 11 degrees is made level
    hovers: float = 0.01  # gap above a support that is closed: boxes are cut on a grid of 8 mm
    moved: float = 0.005  # an object that settles farther away falls back to the colliders of its box,
    tilted: float = math.radians(3)  # as does an object that tilts by more
    aside: float = 0.002  # m: with less lateral motion it only sinks


@dataclass(frozen=True)
class Settling:
    """Rest of a described scene in MuJoCo."""

    eased: float = 0.0005  # target overlap of easing
    easing_steps: int = 200  # at most
    longest: float = 2.0  # simulated seconds until rest
    still: float = 0.01  # m/s: speed at rest
    rolling: float = 0.004  # arm of the rolling resistance: nothing in a photo rolls
    table_center: tuple[float, float] = (0.4, 0.0)  # of the simulated table
    table_reach: float = 1.1  # distance from it within which objects stand on the table
    overlap: float = 0.001  # larger overlaps at rest are separated again
    tries: int = 3  # in all
    wedged: float = 0.003  # remaining overlap up to which small separations are tried first
    fallen: float = 0.01  # larger motion: the object was not at rest as described, or absent
    near: float = 0.02  # depth tolerance of a right pixel of the twin
    rays: int = 20_000  # compared pixels at most, evenly drawn
    picture_side: int = 1280  # pixels of the longer side of a picture of the twin: the size in a report
    depenetration: Depenetration = Depenetration()
    clearance: ColliderClearance = ColliderClearance()
    repair: CollisionRepair = CollisionRepair()


@dataclass(frozen=True)
class SupportRelations:
    """Relations on, in and against between objects."""

    gap: float = 0.006  # distance of touching surfaces, beyond their sampling; depth is not better
    sunk: float = 0.3  # of a container's height: least depth of its content's lower end below the rim
    inside: float = 0.7  # least share of the content's outline above the container
    raised: float = 0.012  # lower objects stand on the table
    cell: float = 0.008  # of the grid on which heights are compared


@dataclass(frozen=True)
class BackgroundReconstruction:
    """Reconstruction of the photo besides the table and the objects."""

    truncation: float = 3.0  # voxels of the signed distance
    most_voxels: int = 8_000_000  # larger grids are coarsened: a float and a flag each
    most_faces: int = 20_000  # larger meshes are coarsened, for drawing
    flattest: float = 0.05  # metres of distance to the surface per metre of depth: bound at grazing angles
    most_boxes: int = 200  # with more the cells are enlarged
    thickness: float = 0.01  # least thickness of a box
    low: tuple[float, float, float] = (-2.0, -2.0, -1.0)  # lowest corner of the space around the robot
    high: tuple[float, float, float] = (2.0, 2.0, 2.0)  # and its highest
    margin: float = 0.05  # distance of the background from objects
    clear: float = 0.02  # distance of its solid boxes after simplification
    edge: int = 200  # reciprocal of the width of the mixed band around an object, as a share of the picture's width
    smallest: float = 0.0004  # of the picture: least piece of the background


@dataclass(frozen=True)
class SceneryFilter:
    """Segments that are no objects by their position."""

    samples: int = 2_000  # points of a region to which a flat surface is fitted
    flat: float = 0.5  # least share of a region on one plane that is a wall or furniture
    base: float = 0.0  # x of the robot's base: segments with their middle behind it are left out
    beyond: float = 0.25  # distance of a segment's middle from the workspace beyond which it is left out
    robot: float = 0.5  # of its pixels on the robot: a hole in the arm's depth
    thin: int = 4  # pixels around the robot,
    mostly: float = 0.98  # least share of a segment within them that is the robot's edge, or on a wall a piece of it
    meets: int = 8  # pixels: distance of a segment beside the robot
    widest: int = 20  # pixels: largest width of its blurred edge
    low: float = 0.025  # m: largest median height of a blurred edge over the table,
    fades: float = 0.015  # m: and of its far third, as it falls off to the table,
    falls: float = 0.003  # m: least drop between near and far third; a pen beside the robot is level
    ring: int = 2  # pixels around a segment that are its border,
    segments: float = 0.1  # largest share of other segments in the border of a blurred edge,
    borders: float = 0.04  # and least share of table,
    table: float = 0.008  # m: below which a pixel is table


@dataclass(frozen=True)
class CoverageMeasuring:
    """Raised pixels, and the listed regions without owner."""

    lowest: float = 0.004  # lower is the table
    deviations: float = 1.5  # or lower than this many standard deviations of the table's points
    foot: int = 4  # pixels: reach of a foot from clearly raised pixels
    enclosed: float = 0.7  # least share of its border along raised pixels of an enclosed piece
    listed: float = 0.005  # of the raised pixels: least size of a listed region
    most: float = 0.5  # of a region: least share of its pixels that a reason explains
    thin: int = 5  # pixels: thinner regions are edges
    halo: int = 7  # pixels: width of the blurred margin of left-out areas, which does not count
    high: float = 0.02  # m: higher pixels in the robot's margin count: 2 in 3 show an object, of lower ones 1 in 10
    named: int = 3  # regions in a warning


@dataclass(frozen=True)
class SegmentRegrouping:
    """Bounds on what a model says of the segments: its boxes are off by a tenth of an object."""

    # of the photo's longer side, between merged segments: two bands of flying pixels, of shifted depth. What an object
    # before them hides, or what has no depth, does not count.
    gap: float = 0.025
    apart: float = 0.1  # m between their boxes: what stands before an object is as wide
    margin: float = 0.15  # of a box's side: pixels so near its edge are undecided
    within: float = 0.8  # of a box's pixels in a larger box: it shows an object before that of the larger
    deep: float = 0.05  # m: depth range of a segment below which its depth counts less than its colours
    jump: float = 0.015  # of the distance, between neighbours: another surface
    rim: int = 4  # pixels around a box, at least, whose colours are those of its background
    cut: int = 256  # pixels: largest side at which an object is cut out by colour
    colors: int = 5  # of a model of colours: fewer pixels have none
    seen: float = 0.1  # of a box's pixels whose colours are not those around it: a thin object across the box
    left: float = 0.6  # of the raised pixels, of such a colour: they show the object and some table
    full: float = 0.5  # of a box's pixels, raised: an object whose colours are in part those around it


@dataclass(frozen=True)
class Perception:
    """All stages, in the order in which a photo passes them."""

    noise: NoiseSmoothing = NoiseSmoothing()
    depth_alignment: DepthAlignment = DepthAlignment()
    table: TableFinding = TableFinding()
    carried: CarriedObjects = CarriedObjects()
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
    scenery: SceneryFilter = SceneryFilter()
    regrouping: SegmentRegrouping = SegmentRegrouping()


DEFAULT = Perception()
