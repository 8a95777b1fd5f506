"""
The memory of the model: columns of its arrays.

All arrays are the caller's, float64 or int64. `cubes` and `marks` have a row for each cube and one
more for the ground, which nothing moves; `pairs` has a row for each remembered pair of neighbours
and, after `pair_capacity` of these, one for each cube and the ground. What a solution in common
works on lies in `bodies` and `blocks`. A comment "3" stands for the three columns of a vector.
"""

from __future__ import annotations

# cubes: what is remembered of a cube from step to step
FORCE = 0  # 8 corners x 3: the supporting force of the plane at each corner, N; warm start
PUSH = 24  # 8 corners x 3: the impulse of the plane at each corner in the last step, N s
STILL = 48  # for how long it has been below the sleep speeds, s
HOME = 49  # 3: where it was when the neighbours were sought, m
REACH = 52  # how far from there it may get before they must be sought again, m
# How it moves, brought up to date before each collision phase:
SPEED, RIM = 53, 54  # of its centre; of its corners on account of its spin, m/s
GONE = 55  # how far any of its points can have gone since the cube is there, m
POSE = 56  # 7
VELOCITY = 63  # 3: m/s
MATRIX = 66  # 9: the rotation matrix by rows, in the collision phase
# Of the group of an impact, by its root: energy before and after, and half the scalar product of
# the velocities before and after, by the masses, J.
ENERGY = 75  # 3
MEAN = 78  # 8: the mean upright force of the plane at each corner of late, N
CUBE_COLUMNS = 86

# marks
ASLEEP = 0
AT_REST = 1  # the last step alone with the plane changed nothing, so the next cannot either
GROUPED = 2  # is solved in common with others in this step
ISLAND = 3  # parent in the forest of touching cubes; for a sleeper the name of its island
STAMP = 4  # the collision phase for which MATRIX holds
SLOT = 5  # its row of bodies; 0 for what nothing moves
COLOURS = 6  # bits of the colours that its pairs have
ON_PLANE = 12  # has forces of the plane to be forgotten
HIT_ROOT = 7  # parent in the forest of cubes that an impact joins; -1 for those without one
CELL = 8  # 3: its cell of the grid
NEXT = 11  # the next cube of the same bucket
RESTS = 13  # of an island, by its root: whether it rests on something; -1 for one in overlap
MARK_COLUMNS = 14

# pairs
LOCAL_NORMAL = 0  # 3: unit vector from the first cube to the second, in the axes of the first
LEAST = 3  # the least gap of its points in the collision phase, m
MOST_POINTS = 8  # of a pair: as many corners has a square cut to another
PAIR_POINT = 4  # MOST_POINTS x PAIR_POINT_COLUMNS
LOCAL_A, LOCAL_B = 0, 3  # 3 each: the point on either cube in its axes, m; on the ground a corner
KEPT_N, KEPT_T = 6, 7  # impulses to start from: normal; tangential (3, world), N s of a sub-step
KEPT_MEAN = 10  # the mean normal impulse of late, N s of a sub-step
PAIR_POINT_COLUMNS = 11
BUILT = PAIR_POINT + MOST_POINTS * PAIR_POINT_COLUMNS  # 12: the relative place of the points
PAIR_COLUMNS = BUILT + 12

# due, by row of pairs: when to look at the pair again, as the sum of what its cubes have GONE, m.
# With points: when these may no longer be right; without: when the cubes may meet at last.

# ends: two lists of neighbours (first, second, row of pairs), ordered by (first, second) ...
LIST_A, LIST_B = 0, 3
FREE = 6  # ... the rows of pairs that are free ...
POINTS, AXIS, SEEN = 7, 8, 9  # ... by row of pairs: number of points, axis, collision phase ...
ACTIVE = 10  # 3: ... what touches: row of pairs, first and second cube ...
KEY = 13  # ... the colour and number of points of that ...
MEMBER = 14  # ... and the slots of all bodies that take part in an impact
END_COLUMNS = 15

# bodies: a row for each awake cube of a solution in common; row 0 is what nothing moves
V, W = 0, 3  # velocity, m/s; spin, rad/s
FASTEST = 6  # bound of the speed of any of its points, m/s
TOUCHED = 7  # whether it got an impulse in this step
SHIFT, TURN = 8, 11  # displacement, m, and turn (a rotation vector) since the collision phase
CUBE = 14  # its number
BEFORE = 16  # 6: the velocities before an impact
PUSHED = 24  # 6: the velocities that take overlap away in this sub-step
PUSHING = 30  # whether it has any
CARRIED = 31  # whether what it touches has carried it
BODY_COLUMNS = 32

# blocks: eight pairs side by side that share no body, so that each operation is done for all.
# A column is LANES numbers.
LANES = 8
N = 0 * LANES  # 3: the normal, from the first body to the second
HALF = 3 * LANES  # 3: half of how the centres have moved against each other, m
WAY = 6 * LANES  # 3: from the first centre to the second, m
MASS_A, MASS_B = 9 * LANES, 10 * LANES  # inverse, 1/kg
INERTIA_A, INERTIA_B = 11 * LANES, 12 * LANES  # inverse, 1/(kg m^2)
FRICTION = 13 * LANES
ACTED = 14 * LANES  # sum of all normal impulses seen: above zero where the pair did anything
FIRST_WAY = 15 * LANES  # 3: WAY in the collision phase, m
HITS = 18 * LANES  # how fast a point of the pair hits in this sub-step, m/s; 0 where none does
MOVED = 19 * LANES  # 3: how HALF has changed in the last sub-step, m
CLOSING = 22 * LANES  # how fast gravity makes the second body approach the first, m/s^2
POINT = 23 * LANES  # MOST_POINTS x POINT_SIZE
# of a point
ARM = 0 * LANES  # 3: from the first centre to the point that both share, collision phase, m
JN, JT = 3 * LANES, 4 * LANES  # normal impulse; tangential (3), N s of one sub-step
MASS_N, MASS_T = 7 * LANES, 8 * LANES  # effective masses, kg
CROSS = 9 * LANES  # 3: tangential velocity that a normal impulse of 1 N s gives, m/s
TARGET = 12 * LANES  # the normal velocity to reach at least, m/s
GAP, FIRST_GAP = 13 * LANES, 14 * LANES  # now; in the collision phase, m; FAR: no point
BOUNCE = 15 * LANES  # the normal velocity that an impact leaves, m/s; negative: takes no part
TOTAL = 16 * LANES  # 3: impulse on the second body in this step, N s
JP = 19 * LANES  # normal impulse that takes overlap away, N s
POINT_SIZE = 20 * LANES
BLOCK_SIZE = POINT + MOST_POINTS * POINT_SIZE
X, Y, Z = 0, LANES, 2 * LANES

# lanes: the numbers of the pairs of a block
ROW = 0  # of pairs
BODY_A, BODY_B = 1 * LANES, 2 * LANES  # slots
CUBE_A, CUBE_B = 3 * LANES, 4 * LANES
SOURCE = 5 * LANES  # for a block of an impact: block * LANES + lane of the pair
COUNT = 6 * LANES  # the most points of a pair of the block
COLOUR, LENGTH = 6 * LANES + 1, 6 * LANES + 2  # LENGTH: pairs in it
DEEP = 6 * LANES + 3  # whether any of its points overlaps by more than the slop
LANE_COLUMNS = 7 * LANES
MOST_COLOURS = 62

# work: the velocities (or displacements) of both bodies of a block, 12 columns
WORK_A, WORK_B = 0, 6 * LANES
WORK_SIZE = 12 * LANES

# counters
PAIRS, FREES, WHICH, STALE, PHASE = 0, 1, 2, 3, 4
CONTACTS, ACTIVES, ROWS_USED, REBUILDS = 5, 6, 7, 8
PARTS, SWEEPS, IMPACTS, BLOCKS, BODIES = 9, 10, 11, 12, 13
TALLY = 16  # pairs by KEY, and where their lanes begin
COUNTERS = TALLY + MOST_POINTS * MOST_COLOURS + 1

# The gap of a point that is not there, m.
FAR = 1e100

# scratch: rows to work in; see `alone` and `manifold`.
SCRATCH_ROWS, SCRATCH_COLUMNS = 64, 32
MEMORY = 63  # a row of it: the length of the last sub-step, s


def block_capacity(rows: int) -> int:
    """Return how many blocks so many rows of `pairs` can take, those of impacts included."""
    return 2 * (rows // LANES + MOST_COLOURS + 1) + 8 * MOST_COLOURS
