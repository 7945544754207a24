"""Every constant of shapes, by stage, with its unit and why it has this value. Lengths are metres, angles radians,
unless a comment says otherwise."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class ShapeObservation:
    """Mask and depth of one object before its shape is reconstructed."""

    pixels: int = 320  # along the longer side: larger windows are reduced, a mesh of 2,000 faces shows no more
    margin: int = 24  # pixels around the mask: farther out nothing tells of the object
    fewest: int = 60  # pixels with depth: fewer tell of no shape
    points: int = 4000  # of the surface are looked at
    jump: float = 0.012  # depth differs by more between two surfaces, and by this many deviations of the noise
    jump_deviations: float = 6.0
    farthest: float = 0.25  # in depth from the object's middle: objects are smaller
    low: float = 0.003  # what is lower above the support, or than two deviations of the noise, may be support
    smallest: int = 12  # pixels: smaller pieces are stray
    hole: float = 0.08  # of the mask: larger holes are holes
    apart: float = 0.03  # pieces farther from the largest are another thing's
    smooth_deviations: float = 4.0  # of the noise: the smoothing keeps what differs by more
    reach_deviations: float = 1.5  # of the noise: normals are taken from pixels so far apart
    longest_reach: int = 4  # pixels
    sunk: float = 0.002  # nothing of the object is seen lower than this above its support
    wall_steps: int = 33  # heights at which a ray is asked for a wall: 3 mm apart on a thing of 100 mm
    foot_edge: float = 1.0  # pixels beyond the mask's edge a foot may lie: masks end early there as often as late
    shrinkage: float = 0.3  # pixels by which smoothing draws a carved outline in: 2 % of a thing of 50 pixels
    same_surface: float = 0.004  # depth between pixels that differ by less is interpolated
    nearer: float = 0.008  # what was measured so much nearer hides a point


@dataclass(frozen=True)
class ShapeRevolution:
    """Finding an upright axis of revolution."""

    steep: float = 0.35  # normals whose level part is shorter tell of no axis
    fewest: int = 80  # points with such normals
    slices: int = 12  # of the height, each with a radius of its own
    rounds: int = 12  # of reweighting: the axis moves by less than 0.1 mm afterwards
    line_distance: float = 0.004  # the normals' lines pass the axis within this; farther ones count little
    radius_error: float = 0.003  # what is farther off its slice's radius counts little
    radial: float = 0.9  # cosine between a normal and the direction from the axis, on a round surface
    out_of_round: float = 0.03  # of the radius, or two deviations of the noise
    sectors: int = 36  # of the full turn, in which points are counted


@dataclass(frozen=True)
class ShapeLathe:
    """The profile of a round object."""

    slices: int = 24  # of the height
    around: tuple[int, int] = (24, 48)  # sides
    fewest: int = 50  # steep points tell how high it is
    fewest_points: int = 6  # of a slice
    fewest_slices: int = 5
    lowest: float = 0.01  # it is at least so high
    sideways: float = 0.35  # share of a normal along the radius: it is of a wall
    inner_slices: int = 3  # of the upper half in which an inner wall is seen: it is hollow
    deep: float = 0.012  # and its middle lies so far below the rim
    wall: tuple[float, float] = (0.003, 0.008)  # walls are that thick
    usual_wall: float = 0.004
    thickest: float = 0.012  # what is farther inside the outer wall is not the same wall
    level: float = 0.75  # upward share of the normals of a floor
    floor_share: float = 0.03  # of the points: fewer show no floor
    astray: float = 0.015  # points farther off a wall are not its
    sharp: float = 0.77  # cosine of a corner's angle: sharper ones have a ring of vertices beside them
    corner: float = 0.0015  # so near
    bend: float = 0.0006  # profile points nearer than this to the line without them are left out
    longest: float = 0.2  # of its length: longer pieces are divided


@dataclass(frozen=True)
class ShapeOutline:
    """The mask's outline of a round object."""

    step: float = 0.001  # of the radii that are tried: a pixel is 1 to 2 mm wide
    nearer: float = 0.008  # what was measured so much nearer hides a place
    off_center: float = 0.008  # an axis found from depth stands this near to the middle between both sides
    fewest: int = 8  # heights
    agreed: float = 0.004  # half of them agree within this
    near: float = 0.005  # depth that ends nearer than this to the outline, and two deviations of the noise, reaches it


@dataclass(frozen=True)
class ShapeOpenTop:
    """Cups and open boxes fitted to what is seen of them."""

    wall: float = 0.004  # how thick walls and floor are
    least: float = 0.02  # no side is shorter
    levels: int = 7  # heights of a cup at which its walls are told
    first_steps: tuple[float, ...] = (0.008, 0.004)  # by which a length is changed, of both,
    last_steps: tuple[float, ...] = (0.002, 0.001)  # and of the better one
    overlap: float = 0.85  # silhouette with the mask
    near: float = 0.6  # of the depth is explained: light goes astray in it


@dataclass(frozen=True)
class ShapeHandle:
    """Handles of mugs and jugs."""

    slender: float = 0.75  # height over width: lower things are bowls, whose ragged masks look like handles
    fewest: int = 30  # pixels
    reach: float = 0.010  # beyond the body: what reaches less is the body's own edge
    longest: float = 0.06
    square: float = math.radians(60)  # from square to the view: nearer to the view its outline tells nothing
    sunk: float = 0.002  # into the body
    half_thickness: tuple[float, float] = (0.003, 0.008)
    step: float = 0.0015  # of the grid
    smoothing: int = 6  # rounds


@dataclass(frozen=True)
class ShapeMirrors:
    """Upright planes of symmetry."""

    points: int = 500  # are mirrored,
    first: int = 4  # one in so many of them first: most planes are out after those
    angles: int = 20
    offsets: int = 19
    tolerance: float = 0.004  # on the surface, or 2.5 deviations of the noise
    tolerance_deviations: float = 2.5
    breach: float = 0.06  # of the mirrored points may lie in space seen free
    support: float = 0.35  # of them lie on the surface,
    facing: float = 0.3  # of which more face the camera
    breach_weight: float = 3.0  # against support
    alike: float = 0.1  # planes of which that differs by less agree as well
    hidden_support: float = 0.1  # of the images where most are hidden,
    unbreached: float = 0.005  # with fewer in free space,
    across: float = 0.01  # cosine with the first plane: at a right angle to it
    right_angle: float = 0.17  # cosine between two planes at a right angle


@dataclass(frozen=True)
class ShapeSolid:
    """Solids carved on a grid."""

    cells: int = 44  # along the longest side: 40 lose a hundredth of F on open boxes, 48 cost a fifth more time
    finest: float = 0.0018  # edge of a cell: depth is not better
    lowest: float = 0.25  # of a cell above the support is the lowest layer: a floor thinner than a cell has no holes
    margin: float = 0.006  # around the hull
    hull_points: int = 3000  # of which the hull is made
    wall: float = 0.004  # behind what is seen
    smoothing: int = 8  # rounds
    smallest_piece: float = 0.05  # of the largest piece's volume


@dataclass(frozen=True)
class ShapeTexture:
    """The photo on the mesh."""

    inset: float = 2.0  # pixels inside the mask: nearer to its edge, pixels mix with what is behind
    fewest: int = 50  # such pixels
    level: float = 0.01  # what was measured beside the mask so near to the support's height, or within two deviations
    # of the noise, shows the support,
    around: int = 15  # pixels: its colour is the mean over a square of so many
    alike: float = 12.0  # in CIELAB, lightness counting half as shadows differ in it: as near is the same colour
    own: float = 0.03  # of the middle of the mask has that colour: it is the object's own
    bled: tuple[float, float] = (0.25, 0.5)  # least share of the mask's edge, and most of the mask, that is support
    island: float = 0.05  # of the object's pixels: smaller pieces of what is then left are stray
    beside: float = 0.7  # pixels beside the mask: what lies farther out is not shown
    hidden: float = 0.004  # behind what is drawn nearest
    crease: float = 0.82  # cosine between a face and the mean of all faces of a vertex on a crease
    across_crease: float = 0.002  # of the weight of other edges: places hardly spread over creases
    flat: float = 0.12  # cosine between view and surface: flatter ones are not shown
    rounds: int = 300  # of conjugate gradients at most: a tenth are usual
    settled: float = 0.1  # pixels: places are this near to the mean of their neighbours'
    most_bytes: int = 45_000  # of the picture's file


@dataclass(frozen=True)
class ViewFit:
    """Boxes and turned solids fitted to mask and depth."""

    pixels: int = 80  # along the longer side, to which a shape is fitted
    faces: int = 250  # of a round shape while it is fitted
    grid: int = 4  # cells along a side of a box's mesh
    box_steps: tuple[float, ...] = (0.008, 0.004, 0.002, 0.001)  # by which a length is changed: a pixel is 1 to 2 mm
    turned_steps: tuple[float, ...] = (0.004, 0.002, 0.001)  # its profile was measured well
    rounds: int = 4  # with each step
    thinnest: float = 0.004  # m: no side of a box comes nearer to its opposite
    least: float = 0.2  # a turned solid is no smaller, of its measured size
    far: float = 0.02  # depth that is off by more is as wrong as a pixel of the silhouette


@dataclass(frozen=True)
class ShapeChoice:
    """Which kind of shape stands for an object."""

    box_overlap: float = 0.88  # silhouette of the fitted box with the mask: it is a box
    box_depth: float = 0.004  # and off in depth by less, 90th percentile, or by this many deviations of the noise
    deviations: float = 1.5
    inset: float = 1.5  # pixels inside the mask, where depth is compared
    faces: int = 2000  # of a mesh
    handle_faces: int = 400
    round_share: float = 0.58  # of the points turn about the axis
    round_azimuth: float = math.radians(110)
    round_overlap: float = 0.85  # silhouette of the turned solid with the mask
    surely_round: float = math.radians(215)  # neither boxes nor flattened bottles are seen over so much of a turn
    explained: float = 0.75  # of the depth by the turned solid
    hollow_share: float = 0.68  # of the points turn about the axis of what is surely hollow and round
    hollow_explained: float = 0.5  # of its depth: light goes astray in it
    hollow_overlap: float = 0.77
    explained_within: float = 0.005  # or by three deviations of the noise
    explained_well: float = 0.85  # of the depth, where the object may also be flattened
    explained_closely: float = 0.003  # or by two deviations of the noise, but not more than `explained_within`


@dataclass(frozen=True)
class Colliders:
    """How few convex solids stand for a reconstructed shape in contact."""

    foot: float = 0.004  # what of a mesh is lower than this is its foot: flat, or it would rock on one triangle
    top: float = 0.003  # what is so near to its highest point is flat: a suction cup's lip gives way by as much
    seat: float = 0.024  # wide is a top on which the cup of 20 mm seals: what is narrower above it is left out,
    highest: float = 0.85  # down to this share of the height
    bearings: int = 6  # in which a top is to be so wide
    primitive: float = 0.0025  # a mesh that is off a box or cylinder by less on average is one: depth is not better
    stray: float = 0.01  # share of a surface at each side that says nothing of its extent
    convex: float = 0.88  # a solid of at least this share of its hull's volume is its hull
    filled: float = 0.88  # pieces are cut until their hulls hold this share of solid,
    most: int = 6  # there are so many,
    gain: float = 0.03  # or no cut leaves out another such share of the volume
    cuts: tuple[float, ...] = (0.25, 0.375, 0.5, 0.625, 0.75)  # where a piece may be cut, as shares of its extent
    shortest: float = 0.01  # along an axis: what is shorter is not cut across it
    cells: int = 2000  # volumes are counted on so many
    points: int = 24  # along the longest extent: as finely is the surface looked at for that
    thinnest: float = 0.002  # walls and pieces are no thinner
    wall: float = 0.005  # of a hollow thing whose walls were not measured: 3 to 8 mm is usual
    sectors: int = 12  # hulls around a ring: its mouth is 3 % narrower across their edges
    bent: float = 0.004  # a profile that bulges by more has two rings
    rounds: int = 5  # in which a circle is fitted
    levels: int = 8  # at which the outside of a hollow thing is measured whose inside was not
    outermost: float = 75.0  # percentile of the distances from its middle there: a handle is farther


@dataclass(frozen=True)
class MeshFileFit:
    """How the mesh of a model of one's own is laid onto what was measured."""

    faces: int = 2000  # of more the mesh is made simpler: as many as shapes have that are reconstructed
    texture: int = 512  # pixels along a side of its picture
    yaws: int = 24  # tried, where the mesh is turned in any way
    refined: int = 3  # of the likeliest are laid onto the points,
    scales: tuple[float, ...] = (0.92, 1.0, 1.08)  # each at these times its size: boxes are measured no better
    samples: int = 2000  # points of its surface
    reach: tuple[float, ...] = (0.02, 0.01, 0.005)  # at which they find partners, one after the other
    worth: float = 0.1  # depth that is off by this counts as much as a silhouette that is wholly off


@dataclass(frozen=True)
class Shapes:
    """Meshes of what was seen."""

    observation: ShapeObservation = ShapeObservation()
    revolution: ShapeRevolution = ShapeRevolution()
    lathe: ShapeLathe = ShapeLathe()
    outline: ShapeOutline = ShapeOutline()
    open_top: ShapeOpenTop = ShapeOpenTop()
    handle: ShapeHandle = ShapeHandle()
    mirrors: ShapeMirrors = ShapeMirrors()
    solid: ShapeSolid = ShapeSolid()
    texture: ShapeTexture = ShapeTexture()
    view_fit: ViewFit = ViewFit()
    choice: ShapeChoice = ShapeChoice()
    colliders: Colliders = Colliders()
    mesh_file: MeshFileFit = MeshFileFit()


DEFAULT = Shapes()
