"""Constants of shape reconstruction, by stage, with unit and motivation. Lengths are metres, angles radians, unless a
comment says otherwise."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class ShapeObservation:
    """Mask and depth of an object before its shape is reconstructed."""

    pixels: int = 320  # longer side of a crop, to which larger ones are reduced: a mesh of 2,000 faces shows no more
    margin: int = 24  # pixels around the mask
    fewest: int = 60  # pixels with depth: fewer give no shape
    points: int = 4000  # sample of the surface
    jump: float = 0.012  # least depth difference between two surfaces, also in deviations of the noise:
    jump_deviations: float = 6.0
    farthest: float = 0.25  # largest depth difference from the object's middle
    low: float = 0.003  # height, or two deviations of the noise, below which a pixel may show the support
    smallest: int = 12  # pixels: smaller pieces are stray
    hole: float = 0.08  # of the mask: larger holes are real
    apart: float = 0.03  # distance from the largest piece of another object's pieces
    smooth_deviations: float = 4.0  # of the noise: edges above this survive the smoothing
    reach_deviations: float = 1.5  # of the noise: distance of the pixels from which normals are computed
    longest_reach: int = 4  # pixels
    sunk: float = 0.002  # lowest seen point below the support
    wall_steps: int = 33  # heights at which a ray is tested for a wall: 3 mm apart on an object of 100 mm
    foot_edge: float = 1.0  # pixels of a foot beyond the mask's edge: masks end early as often as late
    shrinkage: float = 0.3  # pixels by which smoothing shrinks a carved outline: 2 % of an object of 50 pixels
    same_surface: float = 0.004  # depth difference of pixels between which depth is interpolated
    nearer: float = 0.008  # depth difference of an occluder


@dataclass(frozen=True)
class ShapeRevolution:
    """Upright axes of revolution."""

    steep: float = 0.35  # least level component of the normals that support an axis
    fewest: int = 80  # points with such normals
    slices: int = 12  # of the height, each with its radius
    rounds: int = 12  # of reweighting: the axis moves by less than 0.1 mm afterwards
    line_distance: float = 0.004  # scale of the distance between axis and normals in the robust fit
    radius_error: float = 0.003  # scale of the deviation from a slice's radius in the robust fit
    radial: float = 0.9  # cosine between a normal and the radial direction on a round surface
    out_of_round: float = 0.03  # of the radius, or two deviations of the noise
    sectors: int = 36  # of the full turn, for its covered part


@dataclass(frozen=True)
class ShapeLathe:
    """Profiles of round objects."""

    slices: int = 24  # of the height
    around: tuple[int, int] = (24, 48)  # sides
    fewest: int = 50  # steep points from which the height is measured
    fewest_points: int = 6  # of a slice
    fewest_slices: int = 5
    lowest: float = 0.01  # least height
    sideways: float = 0.35  # radial component of a wall's normal
    inner_slices: int = 3  # of the upper half with a visible inner wall: it is hollow,
    deep: float = 0.012  # if its middle lies this far below the rim
    wall: tuple[float, float] = (0.003, 0.008)  # range of wall thickness
    usual_wall: float = 0.004
    thickest: float = 0.012  # largest distance of inner and outer side of the same wall
    level: float = 0.75  # upward component of a floor's normals
    floor_share: float = 0.03  # least share of the points on a floor
    astray: float = 0.015  # distance of points from a wall from which they are outliers
    sharp: float = 0.77  # cosine of a corner's angle: sharper corners get a ring of vertices beside them,
    corner: float = 0.0015  # at this distance
    bend: float = 0.0006  # tolerance of the profile's simplification
    longest: float = 0.2  # of its length: longer pieces are divided


@dataclass(frozen=True)
class ShapeOutline:
    """Outlines of round objects in the mask."""

    step: float = 0.001  # of the tried radii: a pixel is 1 to 2 mm wide
    nearer: float = 0.008  # depth difference of an occluder
    off_center: float = 0.008  # largest offset of an axis found by depth from the middle between both sides
    fewest: int = 8  # heights
    agreed: float = 0.004  # interquartile range of that offset over the heights
    near: float = 0.005  # largest gap between the ends of depth and outline, plus two deviations of the noise


@dataclass(frozen=True)
class ShapeOpenTop:
    """Cups and open boxes fitted to the view."""

    wall: float = 0.004  # thickness of walls and floor
    least: float = 0.02  # length of a side
    levels: int = 7  # heights of a cup in its profile
    first_steps: tuple[float, ...] = (0.008, 0.004)  # of the lengths of both,
    last_steps: tuple[float, ...] = (0.002, 0.001)  # and of the better fit
    overlap: float = 0.85  # least intersection over union of silhouette and mask
    near: float = 0.6  # least share of explained depth: light goes astray in it


@dataclass(frozen=True)
class ShapeHandle:
    """Handles of mugs and jugs."""

    slender: float = 0.75  # height over width: lower objects are bowls, whose ragged masks look like handles
    fewest: int = 30  # pixels
    reach: float = 0.010  # least reach beyond the body: less is the body's edge
    longest: float = 0.06
    square: float = math.radians(60)  # from square to the view: nearer to the view the outline is degenerate
    sunk: float = 0.002  # into the body
    half_thickness: tuple[float, float] = (0.003, 0.008)
    step: float = 0.0015  # of the grid
    smoothing: int = 6  # rounds


@dataclass(frozen=True)
class ShapeMirrors:
    """Upright planes of symmetry."""

    points: int = 500  # that are mirrored,
    first: int = 4  # beginning with a sample of one in four: it excludes most planes
    angles: int = 20
    offsets: int = 19
    tolerance: float = 0.004  # on the surface, or 2.5 deviations of the noise
    tolerance_deviations: float = 2.5
    breach: float = 0.06  # largest share of the mirrored points in free space
    support: float = 0.35  # least share on the surface,
    facing: float = 0.3  # of which this share faces the camera
    breach_weight: float = 3.0  # against support
    alike: float = 0.1  # difference in score of equally good planes
    hidden_support: float = 0.1  # least support if most images are occluded,
    unbreached: float = 0.005  # with a smaller breach,
    across: float = 0.01  # cosine with the first plane: at a right angle to it
    right_angle: float = 0.17  # cosine between two planes at a right angle


@dataclass(frozen=True)
class ShapeSolid:
    """Solids carved on a grid."""

    cells: int = 44  # along the longest side: 40 lose a hundredth of F on open boxes, 48 cost a fifth more time
    finest: float = 0.0018  # edge of a cell: depth is not better
    lowest: float = 0.25  # height of the lowest layer, in cells: a floor thinner than a cell has no holes
    margin: float = 0.006  # around the hull
    hull_points: int = 1000  # sample for the hull: 3000 follow stray points, and cost a fifth more
    wall: float = 0.004  # thickness behind the seen surface
    smoothing: int = 8  # rounds
    smallest_piece: float = 0.05  # of the largest piece's volume


@dataclass(frozen=True)
class ShapeTexture:
    """The photo on the mesh."""

    inset: float = 2.0  # pixels inside the mask: nearer to its edge, pixels mix with the background
    fewest: int = 50  # such pixels
    level: float = 0.01  # height difference, or two deviations of the noise, of support pixels beside the mask,
    around: int = 15  # pixels: side of the square over which their colour is averaged
    alike: float = 12.0  # distance in CIELAB of the same colour; lightness, which shadows change, counts half
    own: float = 0.03  # largest share of the middle of the mask in that colour: with more it is the object's
    bled: tuple[float, float] = (0.25, 0.5)  # least share of the mask's edge, and most of the mask, that is support
    island: float = 0.05  # of the object's pixels: smaller remaining pieces are stray
    beside: float = 0.7  # pixels beside the mask up to which vertices are visible
    hidden: float = 0.004  # depth behind the rendered surface of a hidden vertex
    crease: float = 0.82  # cosine between a face and the mean of all faces of a vertex on a crease
    across_crease: float = 0.002  # weight of edges across creases: texture coordinates hardly spread over creases
    flat: float = 0.12  # cosine between view and surface: smaller is a grazing angle
    most_bytes: int = 45_000  # of the picture's file


@dataclass(frozen=True)
class ViewFit:
    """Boxes and turned solids fitted to mask and depth."""

    pixels: int = 80  # along the longer side, for fitting
    faces: int = 250  # of a round shape during fitting
    grid: int = 4  # cells along a side of a box's mesh
    box_steps: tuple[float, ...] = (0.008, 0.004, 0.002, 0.001)  # of a length: a pixel is 1 to 2 mm
    turned_steps: tuple[float, ...] = (0.004, 0.002, 0.001)  # its profile was measured well
    rounds: int = 4  # with each step
    thinnest: float = 0.004  # m: least extent of a box
    least: float = 0.2  # scale of a turned solid, of its measured size
    far: float = 0.02  # depth residual that costs as much as a pixel of the silhouette


@dataclass(frozen=True)
class ShapeChoice:
    """Choice of the kind of shape."""

    box_overlap: float = 0.88  # least intersection over union of the fitted box's silhouette and the mask
    box_depth: float = 0.004  # and largest depth error, 90th percentile, or in deviations of the noise:
    deviations: float = 1.5
    inset: float = 1.5  # pixels inside the mask, where depth is compared
    faces: int = 2000  # of a mesh
    handle_faces: int = 400
    round_share: float = 0.58  # least share of the points that support the axis
    round_azimuth: float = math.radians(110)
    round_overlap: float = 0.85  # least intersection over union of the turned solid's silhouette and the mask
    surely_round: float = math.radians(215)  # covered angle beyond that of boxes and flattened bottles
    explained: float = 0.75  # least share of the depth explained by the turned solid
    hollow_share: float = 0.68  # least support of the axis of a surely hollow, round object
    hollow_explained: float = 0.5  # of its depth: light goes astray in it
    hollow_overlap: float = 0.77
    explained_within: float = 0.005  # tolerance of explained depth, or three deviations of the noise
    explained_well: float = 0.85  # of the depth, if the object may also be flattened
    explained_closely: float = 0.003  # or two deviations of the noise, but at most `explained_within`


@dataclass(frozen=True)
class Colliders:
    """Approximation of a shape by few convex solids for contact."""

    foot: float = 0.004  # height of a mesh's foot, which is flattened: it would rock on a triangle
    top: float = 0.003  # depth of the flattened top: a suction cup's lip deforms by as much
    seat: float = 0.024  # least width of a top on which the cup of 20 mm seals: narrower parts above are cut off,
    highest: float = 0.85  # down to this share of the height
    bearings: int = 6  # in which the top must be as wide
    primitive: float = 0.0025  # largest mean distance of a mesh from a box or cylinder: depth is not better
    stray: float = 0.01  # share of a surface trimmed at each side
    convex: float = 0.88  # least share of its hull's volume of a convex solid
    filled: float = 0.88  # pieces are cut until their hulls have this share of solid,
    most: int = 6  # to at most this number,
    gain: float = 0.03  # or until no cut removes this share of the volume
    cuts: tuple[float, ...] = (0.25, 0.375, 0.5, 0.625, 0.75)  # positions of cuts, as shares of a piece's extent
    shortest: float = 0.01  # least extent along an axis to be cut
    cells: int = 2000  # of the grid on which volumes are counted
    points: int = 24  # along the longest extent: sampling of the surface
    thinnest: float = 0.002  # thickness of walls and pieces
    wall: float = 0.005  # of a hollow object whose walls were not measured: 3 to 8 mm is usual
    sectors: int = 12  # hulls around a ring: its mouth is 3 % narrower across their edges
    bent: float = 0.004  # bulge of a profile that is split into two rings
    rounds: int = 5  # of fitting a circle
    levels: int = 8  # heights at which the outside of a hollow object is measured whose inside was not
    outermost: float = 75.0  # percentile of the radii there: a handle is farther out


@dataclass(frozen=True)
class MeshFileFit:
    """Registration of a mesh of the user's own model to the measured points."""

    faces: int = 2000  # larger meshes are simplified, like reconstructed shapes
    texture: int = 512  # pixels along a side of its picture
    yaws: int = 24  # tried for a mesh of any yaw
    refined: int = 3  # best of them that are registered,
    scales: tuple[float, ...] = (0.92, 1.0, 1.08)  # at each scale: boxes are measured no better
    samples: int = 2000  # points of its surface
    reach: tuple[float, ...] = (0.02, 0.01, 0.005)  # correspondence distances of successive registrations
    worth: float = 0.1  # depth error that costs as much as a silhouette without overlap


@dataclass(frozen=True)
class Shapes:
    """All stages of shape reconstruction."""

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
