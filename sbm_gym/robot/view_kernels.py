"""Compiled loops over the pixels of a view, and over points that it may show.

Sums go in the order of pixels, point by point and in double precision, so that every machine finds the same.

Arguments that the kernels share: ``depth_m``, (h, w), z-depth in metres, 0 = no return; ``intrinsics``, (3, 3) K in
pixels; ``camera_to_world``, (4, 4), OpenCV axes, of the view.
"""

import numpy as np
from numba import njit

MIN_DEPTH_M = 0.05
"""What is nearer to the camera does not count as seen."""


@njit(cache=True, nogil=True, error_model="numpy")
def pixel_of(x, y, z, intrinsics, camera_to_world, height_px, width_px, min_depth_m, max_depth_m):
    """Where a world point lies in a picture, hidden or not.

    Args:
        x: of the point, metres, as are y and z.
        y: see x.
        z: see x.
        intrinsics: see the module.
        camera_to_world: see the module.
        height_px: of the picture.
        width_px: of the picture.
        min_depth_m: nearer points are left out; above 0.
        max_depth_m: so are farther ones.

    Returns:
        Row and column of its pixel, and its z-depth; row -1 for points outside of the picture.
    """
    pose = camera_to_world
    # A rigid transform's inverse: transposed rotation, and what it takes the camera's place to, negated.
    shift_x = -((pose[0, 0] * pose[0, 3] + pose[1, 0] * pose[1, 3]) + pose[2, 0] * pose[2, 3])
    shift_y = -((pose[0, 1] * pose[0, 3] + pose[1, 1] * pose[1, 3]) + pose[2, 1] * pose[2, 3])
    shift_z = -((pose[0, 2] * pose[0, 3] + pose[1, 2] * pose[1, 3]) + pose[2, 2] * pose[2, 3])
    depth_m = (x * pose[0, 2] + y * pose[1, 2]) + z * pose[2, 2] + shift_z
    if not min_depth_m < depth_m < max_depth_m:
        return -1, -1, depth_m
    right_m = (x * pose[0, 0] + y * pose[1, 0]) + z * pose[2, 0] + shift_x
    down_m = (x * pose[0, 1] + y * pose[1, 1]) + z * pose[2, 1] + shift_y
    column = np.rint(right_m / depth_m * intrinsics[0, 0] + intrinsics[0, 2])
    row = np.rint(down_m / depth_m * intrinsics[1, 1] + intrinsics[1, 2])
    if not (0.0 <= column < width_px and 0.0 <= row < height_px):
        return -1, -1, depth_m
    return int(row), int(column), depth_m


@njit(cache=True, nogil=True, error_model="numpy")
def count_shown(points_m, ids, instance_map, intrinsics, camera_to_world, min_depth_m):
    """How many points of each object are in a picture, and how many of them show the object itself.

    Args:
        points_m: (objects, n, 3) float64, on the objects' surfaces.
        ids: (objects,) int32, their instance ids.
        instance_map: (h, w) int32, instance id of every pixel.
        intrinsics: see the module.
        camera_to_world: see the module.
        min_depth_m: nearer points are left out; above 0.

    Returns:
        Two arrays, (objects,) int64.
    """
    height_px, width_px = instance_map.shape
    in_picture, shown = np.zeros(len(ids), np.int64), np.zeros(len(ids), np.int64)
    for owner in range(points_m.shape[0]):
        for number in range(points_m.shape[1]):
            x, y, z = points_m[owner, number]
            row, column, _ = pixel_of(x, y, z, intrinsics, camera_to_world, height_px, width_px, min_depth_m, np.inf)
            if row >= 0:
                in_picture[owner] += 1
                shown[owner] += instance_map[row, column] == ids[owner]
    return in_picture, shown


@njit(cache=True, nogil=True, error_model="numpy")
def count_agreeing(points_m, depth_m, intrinsics, camera_to_world, behind_m, before_m):
    """How many points are in a picture at about the depth that it has there.

    Args:
        points_m: (n, 3) float64.
        depth_m: see the module.
        intrinsics: see the module.
        camera_to_world: see the module.
        behind_m: so much a point may lie behind what is seen.
        before_m: so much before it.
    """
    height_px, width_px = depth_m.shape
    count = 0
    for number in range(len(points_m)):
        x, y, z = points_m[number]
        row, column, point_m = pixel_of(x, y, z, intrinsics, camera_to_world, height_px, width_px, MIN_DEPTH_M, np.inf)
        if row >= 0:
            seen_m = depth_m[row, column]
            count += seen_m > 0.0 and -before_m < point_m - seen_m < behind_m
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def note_floor(centres_m, cells, depth_m, intrinsics, camera_to_world, max_depth_m, tolerance_m, number, seen_at):
    """Notes the cells of the floor that a view shows: where it says nothing nearer stands before their middle.

    Args:
        centres_m: (n, 2) float64, world x and y of the middles; the floor is at z = 0.
        cells: (n, 2) int64, their rows and columns.
        depth_m: see the module.
        intrinsics: see the module.
        camera_to_world: see the module.
        max_depth_m: floor so far away does not count as seen.
        tolerance_m: how much nearer the view may be than the floor, besides what floor does within a pixel.
        number: of the view.
        seen_at: (my, mx) int32, number of the latest view that shows a cell; written.
    """
    height_px, width_px = depth_m.shape
    # The floor runs away from grazing eyes: one pixel up it is so much farther.
    fall_m = intrinsics[1, 1] * camera_to_world[2, 3]
    for i in range(len(centres_m)):
        row, column, floor_m = pixel_of(
            centres_m[i, 0],
            centres_m[i, 1],
            0.0,
            intrinsics,
            camera_to_world,
            height_px,
            width_px,
            MIN_DEPTH_M,
            max_depth_m,
        )
        if row >= 0:
            seen_m = depth_m[row, column]
            if seen_m > 0.0 and floor_m - seen_m < tolerance_m + floor_m * floor_m / fall_m:
                seen_at[cells[i, 0], cells[i, 1]] = number


@njit(cache=True, nogil=True, error_model="numpy")
def note_near(centres_m, cells, x, y, radius_m, number, seen_at):
    """Notes the cells of the floor around a place.

    Args:
        centres_m: (n, 2) float64, world x and y of the cells' middles.
        cells: (n, 2) int64, their rows and columns.
        x: of the place, metres.
        y: likewise.
        radius_m: cells whose middle is nearer are noted.
        number: of the view.
        seen_at: as for ``note_floor``; written.
    """
    for i in range(len(centres_m)):
        dx, dy = centres_m[i, 0] - x, centres_m[i, 1] - y
        if np.sqrt(dx * dx + dy * dy) < radius_m:
            seen_at[cells[i, 0], cells[i, 1]] = number


@njit(cache=True, nogil=True, error_model="numpy")
def count_unseen(centres_m, cells, seen_at, x, y, yaw_rad, unit_m, rings, num_directions):
    """How many cells of the floor around a place have never been seen.

    Args:
        centres_m: (n, 2) float64, world x and y of the cells' middles.
        cells: (n, 2) int64, their rows and columns.
        seen_at: as for ``note_floor``; negative where a cell has not been seen.
        x: of the place, metres.
        y: likewise.
        yaw_rad: the middle of the first direction; the others follow counter-clockwise.
        unit_m: of the rings' distances, metres.
        rings: least and greatest distance of each ring, as tuples.
        num_directions: pieces that each ring is cut into.

    Returns:
        (rings, directions) float64.
    """
    counts = np.zeros((len(rings), num_directions))
    for i in range(len(centres_m)):
        if seen_at[cells[i, 0], cells[i, 1]] >= 0:
            continue
        dx, dy = centres_m[i, 0] - x, centres_m[i, 1] - y
        distance = np.hypot(dx, dy) / unit_m
        turn = (np.arctan2(dy, dx) - yaw_rad) / (2.0 * np.pi) + 0.5 / num_directions
        direction = min(int(turn % 1.0 * num_directions), num_directions - 1)
        for ring in range(len(rings)):
            counts[ring, direction] += rings[ring][0] <= distance < rings[ring][1]
    return counts


@njit(cache=True, nogil=True, error_model="numpy")
def world_point(row, column, depth_m, intrinsics, camera_to_world):
    """World point seen at a pixel.

    Args:
        row: of the pixel.
        column: of the pixel.
        depth_m: its z-depth, metres.
        intrinsics: see the module.
        camera_to_world: see the module.

    Returns:
        x, y and z, metres.
    """
    pose = camera_to_world
    right_m = (column - intrinsics[0, 2]) / intrinsics[0, 0] * depth_m
    down_m = (row - intrinsics[1, 2]) / intrinsics[1, 1] * depth_m
    x = (right_m * pose[0, 0] + down_m * pose[0, 1]) + depth_m * pose[0, 2] + pose[0, 3]
    y = (right_m * pose[1, 0] + down_m * pose[1, 1]) + depth_m * pose[1, 2] + pose[1, 3]
    z = (right_m * pose[2, 0] + down_m * pose[2, 1]) + depth_m * pose[2, 2] + pose[2, 3]
    return x, y, z


@njit(cache=True, nogil=True, error_model="numpy")
def fill_cells(depth_m, intrinsics, camera_to_world, origin_m, cell_m, filled):
    """Fills the cells of a grid in which surfaces are seen.

    Args:
        depth_m: see the module.
        intrinsics: see the module.
        camera_to_world: see the module.
        origin_m: (3,) float64, the grid's lower corner.
        cell_m: edge length of a cell.
        filled: (nx, ny, nz) bool; written.
    """
    height_px, width_px = depth_m.shape
    for row in range(height_px):
        for column in range(width_px):
            if not depth_m[row, column] > 0.0:
                continue
            x, y, z = world_point(row, column, np.float64(depth_m[row, column]), intrinsics, camera_to_world)
            i = np.floor((x - origin_m[0]) / cell_m)
            j = np.floor((y - origin_m[1]) / cell_m)
            k = np.floor((z - origin_m[2]) / cell_m)
            if 0.0 <= i < filled.shape[0] and 0.0 <= j < filled.shape[1] and 0.0 <= k < filled.shape[2]:
                filled[int(i), int(j), int(k)] = True


@njit(cache=True, nogil=True, error_model="numpy")
def find_inner(mask, inner):
    """Finds the pixels of a mask all of whose neighbours that lie in the picture are in it, too.

    Row by row, in loops that compilers turn into operations on many pixels at a time.

    Args:
        mask: (h, w) bool.
        inner: (h, w) bool; written.

    Returns:
        How many pixels are in the mask, and how many of them are such.
    """
    height_px, width_px = mask.shape
    upright = np.ones(width_px + 2, np.bool_)
    area = num_inner = 0
    for row in range(height_px):
        some = False
        for column in range(width_px):
            some |= mask[row, column]
        if not some:
            inner[row] = False
            continue
        above, below = max(row - 1, 0), min(row + 1, height_px - 1)
        for column in range(width_px):
            upright[column + 1] = mask[above, column] & mask[row, column] & mask[below, column]
        for column in range(width_px):
            inner[row, column] = upright[column] & upright[column + 1] & upright[column + 2]
        for column in range(width_px):
            area += mask[row, column]
        for column in range(width_px):
            num_inner += inner[row, column]
    return area, num_inner


@njit(cache=True, nogil=True, error_model="numpy")
def window_of(mask):
    """The smallest window that holds the pixels of a mask, (h, w) bool.

    Row by row, in loops that compilers turn into operations on many pixels at a time.

    Returns:
        First row, one past the last, first column, one past the last; an empty window for an empty mask.
    """
    height_px, width_px = mask.shape
    in_column = np.zeros(width_px, np.bool_)
    top, bottom = height_px, 0
    for row in range(height_px):
        some = False
        for column in range(width_px):
            some |= mask[row, column]
        if some:
            top, bottom = min(top, row), row + 1
            for column in range(width_px):
                in_column[column] |= mask[row, column]
    left, right = 0, width_px
    while left < right and not in_column[left]:
        left += 1
    while right > left and not in_column[right - 1]:
        right -= 1
    return min(top, bottom), bottom, left, right


@njit(cache=True, nogil=True, error_model="numpy")
def mask_points(mask, depth_m, intrinsics, camera_to_world, min_pixels, max_depth_m):
    """World points of a mask without its rim, where enough is left, and without outliers.

    Args:
        mask: (h, w) bool.
        depth_m: see the module.
        intrinsics: see the module.
        camera_to_world: see the module.
        min_pixels: smaller masks have no points.
        max_depth_m: pixels so far away are left out.

    Returns:
        The points, (n, 3) float64, row by row, nothing if there are less than three pixels with depth; their mean,
        (3,); and the largest of their extents along the world's axes.
    """
    top, bottom, left, right = window_of(mask)
    # Beyond the window lies no pixel of the mask, so that one pixel around it decides which of them are at its rim.
    top, bottom = max(top - 1, 0), min(bottom + 1, mask.shape[0])
    left, right = max(left - 1, 0), min(right + 1, mask.shape[1])
    part, seen_part_m = mask[top:bottom, left:right], depth_m[top:bottom, left:right]
    inner = np.empty(part.shape, np.bool_)
    area, num_inner = find_inner(part, inner)
    if area < min_pixels:
        return np.empty((0, 3)), np.zeros(3), 0.0
    chosen = inner if num_inner >= 0.3 * area else part
    across = np.empty(right - left)
    for column in range(right - left):
        across[column] = (column + left - intrinsics[0, 2]) / intrinsics[0, 0]
    # What stores into arrays might change is not read again and again.
    xx, xy, xz, x0 = camera_to_world[0]
    yx, yy, yz, y0 = camera_to_world[1]
    zx, zy, zz, z0 = camera_to_world[2]
    points_m = np.empty((area, 3))
    count = 0
    sum_x = sum_y = sum_z = 0.0
    for row in range(bottom - top):
        down = (row + top - intrinsics[1, 2]) / intrinsics[1, 1]
        for column in range(right - left):
            if not chosen[row, column]:
                continue
            seen_m = np.float64(seen_part_m[row, column])
            if seen_m > 0.0 and seen_m < max_depth_m:
                # As ``world_point``, with the divisions of a row and of a column done once.
                right_m, down_m = across[column] * seen_m, down * seen_m
                x = (right_m * xx + down_m * xy) + seen_m * xz + x0
                y = (right_m * yx + down_m * yy) + seen_m * yz + y0
                z = (right_m * zx + down_m * zy) + seen_m * zz + z0
                points_m[count, 0], points_m[count, 1], points_m[count, 2] = x, y, z
                sum_x, sum_y, sum_z = sum_x + x, sum_y + y, sum_z + z
                count += 1
    if count < 3:
        return np.empty((0, 3)), np.zeros(3), 0.0
    return _without_outliers(points_m[:count], sum_x / count, sum_y / count, sum_z / count)


@njit(cache=True, nogil=True, error_model="numpy")
def _without_outliers(points_m, mean_x, mean_y, mean_z):
    """The points at most three standard deviations from their mean along every axis, in their own memory: at least two
    thirds of them (Chebyshev). Also what ``mask_points`` returns of these.
    """
    count = len(points_m)
    # The axes side by side: one sum need not wait for another.
    x_2 = y_2 = z_2 = 0.0
    for number in range(count):
        off_x, off_y, off_z = points_m[number, 0] - mean_x, points_m[number, 1] - mean_y, points_m[number, 2] - mean_z
        x_2, y_2, z_2 = x_2 + off_x * off_x, y_2 + off_y * off_y, z_2 + off_z * off_z
    reach_x = 3.0 * np.sqrt(x_2 / count) + 1e-9
    reach_y = 3.0 * np.sqrt(y_2 / count) + 1e-9
    reach_z = 3.0 * np.sqrt(z_2 / count) + 1e-9
    num_kept = 0
    sum_x = sum_y = sum_z = 0.0
    low_x = low_y = low_z = np.inf
    high_x = high_y = high_z = -np.inf
    for number in range(count):
        x, y, z = points_m[number]
        is_near = (abs(x - mean_x) <= reach_x) & (abs(y - mean_y) <= reach_y) & (abs(z - mean_z) <= reach_z)
        if is_near:
            points_m[num_kept, 0], points_m[num_kept, 1], points_m[num_kept, 2] = x, y, z
            num_kept += 1
            sum_x, sum_y, sum_z = sum_x + x, sum_y + y, sum_z + z
            low_x, low_y, low_z = min(low_x, x), min(low_y, y), min(low_z, z)
            high_x, high_y, high_z = max(high_x, x), max(high_y, y), max(high_z, z)
    mean_m = np.array([sum_x / num_kept, sum_y / num_kept, sum_z / num_kept])
    return points_m[:num_kept], mean_m, max(high_x - low_x, high_y - low_y, high_z - low_z)


@njit(cache=True, nogil=True, error_model="numpy")
def view_bins(offsets_m, range_edges_m, elevation_edges_rad, num_azimuths):
    """The bins of views (``object_memory.ViewBins``) by where the camera is from what it looks at.

    Args:
        offsets_m: (n, 3) float64.
        range_edges_m: edges between horizontal ranges, rising, as a tuple.
        elevation_edges_rad: edges between elevations, rising, as a tuple.
        num_azimuths: sectors around what is looked at.

    Returns:
        (4, n) int64: 1 within the outermost ranges, else 0; sector; range, the nearest one beyond the outermost; and
        elevation.
    """
    found = np.empty((4, len(offsets_m)), np.int64)
    last = len(range_edges_m) - 2
    for number in range(len(offsets_m)):
        x, y, z = offsets_m[number]
        range_m = np.hypot(x, y)
        elevation_rad = np.arctan2(z, range_m)
        turns = np.arctan2(y, x) / (2.0 * np.pi) % 1.0
        ring = -1
        for edge_m in range_edges_m:
            ring += edge_m <= range_m
        layer = 0
        for edge_rad in elevation_edges_rad:
            layer += edge_rad <= elevation_rad
        found[0, number] = 0 <= ring <= last
        found[1, number] = min(int(np.floor(turns * num_azimuths)), num_azimuths - 1)
        found[2, number] = min(max(ring, 0), last)
        found[3, number] = layer
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def are_near(points_m, centre_m, reach_m, low_m, high_m, margin_m):
    """Which points are near a place, or in an upright box.

    Args:
        points_m: (n, 3) float64.
        centre_m: (3,) float64, the place.
        reach_m: so near.
        low_m: (3,) float64, a corner of the box.
        high_m: (3,) float64, the opposite one.
        margin_m: by this much the box is larger on all sides.

    Returns:
        (n,) bool.
    """
    found = np.empty(len(points_m), np.bool_)
    for number in range(len(points_m)):
        square, inside = 0.0, True
        for axis in range(3):
            at = points_m[number, axis]
            square += (at - centre_m[axis]) ** 2
            inside &= (at >= low_m[axis] - margin_m) & (at <= high_m[axis] + margin_m)
        found[number] = inside | (np.sqrt(square) <= reach_m)
    return found
