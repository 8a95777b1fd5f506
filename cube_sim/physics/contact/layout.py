"""
The memory of the model: columns of its arrays.

All arrays are the caller's, float64 or int64. `cubes` and `marks` have a row for each cube and one
more for the ground, a body that nothing moves; `pairs` has a row for each remembered pair of
neighbours and, after `pair_capacity` of these, one for each cube and the ground. A comment "3"
stands for the three columns of a vector x, y, z.
"""

from __future__ import annotations

# cubes: what is remembered of a cube from step to step ...
FORCE = 0  # 8 corners x 3: the supporting force of the plane at each corner, N; warm start
PUSH = 24  # 8 corners x 3: the impulse of the plane at each corner in the last step, N s
STILL = 48  # for how long it has been below the sleep speeds, s
HOME = 49  # 3: where it was when the neighbours were sought, m
REACH = 52  # how far from there it may get before they must be sought again, m
# ... and what a solution in common computes with: velocities, displacement and turn since the
# collision phase (a rotation vector), the rotation matrix by rows, inverse mass and inertia.
SV, SW = 53, 56
SHIFT, TURN = 59, 62
MATRIX = 65
INVERSE_MASS, INVERSE_INERTIA = 74, 75
PLACE = 76  # 3: the centre in the collision phase, m
KEPT = 79  # 6: the velocities before an impact
CUBE_COLUMNS = 86

# marks
ASLEEP = 0
AT_REST = 1  # the last step alone with the plane changed nothing, so the next cannot either
GROUPED = 2  # is solved in common with others in this step
ISLAND = 3  # parent in the forest of touching cubes; for a sleeper the name of its island
STAMP = 4  # the collision phase for which MATRIX holds
TOUCHED = 5  # got an impulse in this step
CELL = 6  # 3: its cell of the grid
NEXT = 9  # the next cube of the same bucket
MARK_COLUMNS = 10

# pairs
NORMAL = 0  # 3: unit vector from the first cube to the second, world
LOCAL_NORMAL = 3  # 3: the same in the axes of the first
BUILT = 6  # 12: relative position and axes for which the points were found
POINT = 18  # 4 points x POINT_COLUMNS
POINT_COLUMNS = 24
PAIR_COLUMNS = POINT + 4 * POINT_COLUMNS
# columns of a point
LOCAL_A, LOCAL_B = 0, 3  # 3 each: the point on either cube in its axes, m; or the corner's number
GAP = 6  # separation along the normal in the collision phase, m
ARM_A, ARM_B = 7, 10  # 3 each: from the centres to the point that both share, m, world
IMPULSE_N, IMPULSE_T = 13, 14  # normal; tangential (3, world), N s of one sub-step
MASS_N, MASS_T = 17, 18  # effective masses, kg
BOUNCE = 19  # the normal velocity that an impact is to leave, m/s; negative where there is none
TOTAL = 20  # 3: impulse on the second cube in the last step, N s
HIT = 23  # normal impulse of the impact of this sub-step, N s

# ends: two lists of neighbours (first, second, row of pairs), ordered by (first, second) ...
LIST_A, LIST_B = 0, 3
FREE = 6  # ... the rows of pairs that are free ...
POINTS, AXIS, SEEN = 7, 8, 9  # ... by row of pairs: number of points, axis, collision phase ...
ACTIVE = 10  # 3: ... and what touches: row of pairs, first and second body
HITTING = 13  # by row of pairs: whether a point of it hits in this sub-step
END_COLUMNS = 14

# counters
PAIRS, FREES, WHICH, STALE, PHASE = 0, 1, 2, 3, 4
CONTACTS, DONE, ACTIVES, ROWS_USED, REBUILDS = 5, 6, 7, 8, 9
PARTS, POINTS_NOW, GROUPS, SOLVED = 10, 11, 12, 13
COUNTERS = 16

# scratch: rows to work in; see `alone` and `manifold`.
SCRATCH_ROWS, SCRATCH_COLUMNS = 64, 32
