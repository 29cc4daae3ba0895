"""What a mechanism brings to the sweep, a block of points at a time.

:mod:`pmopt.compiler.program_text` puts a mechanism's own functions in the place of the stubs. A
piece has what it needs and no more: another norm, other samples or other checks leave the others as
they are. The rows of a block are those of :mod:`pmopt.kernels.sweep`.
"""

from pmopt.kernels.sweep import LCI, MARGIN, WEIGHT, WORK

#: Stubs: the first rows of poses and, behind them, of skeletons.
POSE = 0
SKELETON = 0
#: Stub: the coordinate along which points are placed on lines.
LINE_AXIS = 0


def unpack(constants):
    """Stub: a row of constants as a record, so that the compiler keeps them in registers."""
    raise NotImplementedError


def margin_of(pose, i, constants):
    """Stub: the margin of pose ``i`` of a block, from the mechanism's kernel."""
    raise NotImplementedError


def evaluate_block(pose, count, constants, work, margin):
    """Stub, for heavy kernels: write margins and, into ``work``, entries of a block's poses."""
    raise NotImplementedError


def index_block(pose, count, constants, work, lci):
    """Stub: write the local conditioning indices of ``count`` poses of a block, or the entries.

    Poses and indices are rows of PITCH: up to a whole vector more of each is written.
    """
    raise NotImplementedError


def condition_block(count, work, margin, lci):
    """Stub: write the indices of entries in ``work``; doubtful ones, < 0, only out of reach."""
    raise NotImplementedError


def place_on_line(pose, i, low, width, constants):
    """Stub: move pose ``i`` into the reachable part of its line, from the mechanism's ``line``.

    Returns the coordinate and the part's share of the line, 0 where nothing of it is reachable.
    """
    raise NotImplementedError


def skeleton_to(pose, i, constants, work):
    """Stub: write the skeleton of pose ``i`` of a block."""
    raise NotImplementedError


def place_to(pose, i, constants, work):
    """Stub: write the platform's position and rotation at pose ``i``; return the margin."""
    raise NotImplementedError


def facts_to(pose, i, constants, facts):
    """Stub: write what ``probe`` tells of pose ``i``."""
    raise NotImplementedError


def margins(scratch, count, constants):
    """Write the margins of a block."""
    k = unpack(constants)
    pose = scratch[POSE:]
    margin = scratch[MARGIN]
    for i in range(count):
        margin[i] = margin_of(pose, i, k)


def evaluations(scratch, count, constants):
    """Write the margins of a block and the entries of its Jacobians."""
    k = unpack(constants)
    evaluate_block(scratch[POSE:], count, k, scratch[WORK:], scratch[MARGIN])


def indices(scratch, count, constants):
    """Write the indices of a block or, for larger matrices, the entries of its Jacobians."""
    k = unpack(constants)
    index_block(scratch[POSE:], count, k, scratch[WORK:], scratch[LCI])


def conditions(scratch, count):
    """Write the indices of the Jacobians of a block."""
    condition_block(count, scratch[WORK:], scratch[MARGIN], scratch[LCI])


def lines(scratch, count, lower, width, constants):
    """Place the points of a block on lines, and write their weights."""
    k = unpack(constants)
    pose = scratch[POSE:]
    weight = scratch[WEIGHT]
    low = lower[LINE_AXIS]
    room = width[LINE_AXIS]
    for i in range(count):
        place, share = place_on_line(pose, i, low, room, k)
        pose[LINE_AXIS, i] = place
        weight[i] = share


def skeletons(scratch, count, constants):
    """Write the skeletons of a block behind it."""
    k = unpack(constants)
    pose = scratch[POSE:]
    work = scratch[SKELETON:]
    for i in range(count):
        skeleton_to(pose, i, k, work)


def placed(scratch, count, constants):
    """Write margins, and positions and rotations of the platform, of a block."""
    k = unpack(constants)
    pose = scratch[POSE:]
    work = scratch[WORK:]
    margin = scratch[MARGIN]
    for i in range(count):
        margin[i] = place_to(pose, i, k, work)


def probe(poses, constants, facts):
    """Write what the kernel and the skeleton tell of given poses, ``facts`` (f, N).

    Rows: margin, entries of the inverse Jacobian, skeleton.
    """
    k = unpack(constants)
    for i in range(poses.shape[1]):
        facts_to(poses, i, k, facts)
