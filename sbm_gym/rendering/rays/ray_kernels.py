"""Compiled kernels around ray casting: camera rays, boxes, planes.

Every kernel works on a range [start, stop) of rays and writes only there, so that any split over threads gives the
same bytes. No kernel uses fast-math or numba's own threads: both would let the result depend on the split.

Arguments that the kernels share: ``start`` and ``stop``, the range of rays to work on; ``rays``, (n, 6) float32, ``t``,
(n,) float32, and ``triangle``, (n,) int64, as in ``SurfaceTable``; ``uv``, (n, 2) float32, barycentric coordinates of a
hit, on planes metres along the plane's axes; ``planes``, the plane geoms of the scene.
"""

from numba import njit

from sbm_gym.rendering.tables.scene_tables import PlaneTable


@njit(cache=True, nogil=True, error_model="numpy")
def camera_rays(start, stop, pixels, width, offsets, origin, pixel_to_world, rays):
    """Camera rays of some samples of each pixel.

    Args:
        start: first ray.
        stop: behind the last one.
        pixels: (k,) int64, numbers of pixels, line by line.
        width: of the picture, pixels.
        offsets: (samples, 2) float64, x and y of the samples from the pixel's centre, pixels.
        origin: (3,) float64, the camera's place in the world.
        pixel_to_world: (3, 3) float64, turns (x, y, 1) of a pixel into a world direction of z-depth one.
        rays: (k * samples, 6) float32, the samples of a pixel together; written.
    """
    samples = offsets.shape[0]
    number, sample = start // samples, start % samples
    column, row = pixels[number] % width, pixels[number] // width
    for i in range(start, stop):
        if sample == samples:
            number, sample = number + 1, 0
            column, row = pixels[number] % width, pixels[number] // width
        x, y = column + offsets[sample, 0], row + offsets[sample, 1]
        sample += 1
        for axis in range(3):
            rays[i, axis] = origin[axis]
            rays[i, 3 + axis] = pixel_to_world[axis, 0] * x + pixel_to_world[axis, 1] * y + pixel_to_world[axis, 2]


@njit(cache=True, nogil=True, error_model="numpy")
def name_geoms(start, stop, triangle, geom_of, geom):
    """Geoms of what rays hit.

    Args:
        start: first ray.
        stop: behind the last one.
        triangle: see the module.
        geom_of: (triangles,) int32, the geom of each row of the ``TriangleTable``.
        geom: (n,) int32, -1 for nothing; written.
    """
    for i in range(start, stop):
        geom[i] = geom_of[triangle[i]] if triangle[i] >= 0 else -1


@njit(cache=True, nogil=True, error_model="numpy")
def reach_boxes(start, stop, rays, far, boxes, reached):
    """Whether rays enter any of some boxes before a parameter.

    Args:
        start: first ray.
        stop: behind the last one.
        rays: see the module.
        far: (n,) float32, the parameter; rays with a negative one reach nothing.
        boxes: (boxes, 2, 3) float64, low and high corners.
        reached: (n,) bool; written.
    """
    for i in range(start, stop):
        reached[i] = False
        x, y, z = rays[i, 0], rays[i, 1], rays[i, 2]
        # Zero directions divide to infinities, which compare as they should.
        ix, iy, iz = 1.0 / rays[i, 3], 1.0 / rays[i, 4], 1.0 / rays[i, 5]
        for b in range(boxes.shape[0]):
            x0, x1 = (boxes[b, 0, 0] - x) * ix, (boxes[b, 1, 0] - x) * ix
            y0, y1 = (boxes[b, 0, 1] - y) * iy, (boxes[b, 1, 1] - y) * iy
            z0, z1 = (boxes[b, 0, 2] - z) * iz, (boxes[b, 1, 2] - z) * iz
            enter = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), 0.0))
            leave = min(min(max(x0, x1), max(y0, y1)), min(max(z0, z1), far[i]))
            if enter <= leave:
                reached[i] = True
                break


@njit(cache=True, nogil=True, error_model="numpy")
def intersect_planes(start, stop, rays, planes: PlaneTable, first_plane, t, triangle, uv):
    """Replaces hits by nearer ones with planes, seen from their front.

    Args:
        start: first ray.
        stop: behind the last one.
        rays: see the module.
        planes: see the module.
        first_plane: number that ``triangle`` gets for the first plane.
        t: see the module; lowered where a plane is nearer.
        triangle: see the module; likewise changed.
        uv: see the module; likewise changed.
    """
    for p in range(planes.origin.shape[0]):
        nx, ny, nz = planes.axes[p, 2, 0], planes.axes[p, 2, 1], planes.axes[p, 2, 2]
        for i in range(start, stop):
            slope = rays[i, 3] * nx + rays[i, 4] * ny + rays[i, 5] * nz
            if slope >= -1e-12:
                continue
            dx = planes.origin[p, 0] - rays[i, 0]
            dy = planes.origin[p, 1] - rays[i, 1]
            dz = planes.origin[p, 2] - rays[i, 2]
            hit = (dx * nx + dy * ny + dz * nz) / slope
            if hit <= 0.0 or hit >= t[i]:
                continue
            hx, hy, hz = hit * rays[i, 3] - dx, hit * rays[i, 4] - dy, hit * rays[i, 5] - dz
            u = hx * planes.axes[p, 0, 0] + hy * planes.axes[p, 0, 1] + hz * planes.axes[p, 0, 2]
            v = hx * planes.axes[p, 1, 0] + hy * planes.axes[p, 1, 1] + hz * planes.axes[p, 1, 2]
            if abs(u) <= planes.half_size[p, 0] and abs(v) <= planes.half_size[p, 1]:
                t[i] = hit
                triangle[i] = first_plane + p
                uv[i, 0] = u
                uv[i, 1] = v


@njit(cache=True, nogil=True, error_model="numpy")
def occlude_planes(start, stop, rays, planes: PlaneTable, occluded):
    """Marks shadow rays that a plane blocks, from either side.

    Args:
        start: first ray.
        stop: behind the last one.
        rays: see the module; the light is at parameter 1.
        planes: see the module.
        occluded: (n,) bool; set where a plane stands in the way.
    """
    for p in range(planes.origin.shape[0]):
        nx, ny, nz = planes.axes[p, 2, 0], planes.axes[p, 2, 1], planes.axes[p, 2, 2]
        for i in range(start, stop):
            slope = rays[i, 3] * nx + rays[i, 4] * ny + rays[i, 5] * nz
            if abs(slope) < 1e-12:
                continue
            dx = planes.origin[p, 0] - rays[i, 0]
            dy = planes.origin[p, 1] - rays[i, 1]
            dz = planes.origin[p, 2] - rays[i, 2]
            hit = (dx * nx + dy * ny + dz * nz) / slope
            if hit <= 0.0 or hit >= 1.0:
                continue
            hx, hy, hz = hit * rays[i, 3] - dx, hit * rays[i, 4] - dy, hit * rays[i, 5] - dz
            u = hx * planes.axes[p, 0, 0] + hy * planes.axes[p, 0, 1] + hz * planes.axes[p, 0, 2]
            v = hx * planes.axes[p, 1, 0] + hy * planes.axes[p, 1, 1] + hz * planes.axes[p, 1, 2]
            if abs(u) <= planes.half_size[p, 0] and abs(v) <= planes.half_size[p, 1]:
                occluded[i] = True
