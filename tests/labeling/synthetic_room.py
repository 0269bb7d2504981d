"""A furnished box room made of boxes and ellipsoids, rendered by exact ray casting in numpy: the tests' ground truth.

Independent of every renderer of the project, so that it can serve as an oracle.
"""

import functools
from dataclasses import dataclass, replace

import cv2
import numpy as np

from labeling.core.episode import Episode
from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.types import Detection, GroundTruth


@dataclass(frozen=True)
class Part:
    """One primitive: an upright box or an ellipsoid, turned about +Z."""

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    colour: tuple[float, float, float]
    yaw_rad: float = 0.0
    round: bool = False
    instance: int = 0
    """0 belongs to the room."""


def _box(x, y, z, sx, sy, sz, colour):
    return Part((x, y, z), (sx / 2, sy / 2, sz / 2), colour)


def _chair(colour):
    legs = [_box(x, y, 0.22, 0.05, 0.05, 0.44, (0.3, 0.2, 0.1)) for x in (-0.2, 0.2) for y in (-0.2, 0.2)]
    return [*legs, _box(0, 0, 0.46, 0.46, 0.46, 0.05, colour), _box(-0.21, 0, 0.72, 0.05, 0.46, 0.5, colour)]


def _table(colour):
    legs = [_box(x, y, 0.36, 0.06, 0.06, 0.72, (0.35, 0.22, 0.1)) for x in (-0.5, 0.5) for y in (-0.3, 0.3)]
    return [*legs, _box(0, 0, 0.74, 1.2, 0.8, 0.04, colour)]


def _couch(colour):
    return [
        _box(0, 0, 0.22, 0.85, 1.7, 0.44, colour),
        _box(-0.35, 0, 0.5, 0.2, 1.7, 0.6, colour),
        _box(0, -0.8, 0.35, 0.85, 0.15, 0.6, colour),
        _box(0, 0.8, 0.35, 0.85, 0.15, 0.6, colour),
    ]


def _plant(colour):
    pot = _box(0, 0, 0.15, 0.26, 0.26, 0.3, (0.6, 0.3, 0.15))
    return [pot, Part((0, 0, 0.55), (0.25, 0.25, 0.32), colour, round=True)]


def _fridge(colour):
    return [_box(0, 0, 0.85, 0.65, 0.65, 1.7, colour)]


def _tv(colour):
    return [_box(0, 0, 0.25, 0.4, 1.1, 0.5, (0.35, 0.25, 0.18)), _box(0, 0, 0.85, 0.06, 1.0, 0.6, colour)]


def _toilet(colour):
    return [
        _box(-0.22, 0, 0.45, 0.2, 0.4, 0.9, colour),
        Part((0.05, 0, 0.35), (0.28, 0.2, 0.12), colour, round=True),
        _box(0, 0, 0.15, 0.25, 0.22, 0.3, colour),
    ]


_MAKERS = {
    "chair": _chair,
    "table": _table,
    "couch": _couch,
    "plant": _plant,
    "refrigerator": _fridge,
    "tv": _tv,
    "toilet": _toilet,
}


def furnish(seed: int, num_objects: int = 8, room_m: float = 6.0) -> tuple[list[Part], list[str]]:
    """Parts of a room whose furniture stands along the walls, and the category of each instance (1, 2, ...)."""
    rng = np.random.default_rng(seed)
    parts, categories, placed = [], [], []
    names = list(_MAKERS)
    while len(categories) < num_objects:
        name = names[len(categories) % len(names)]
        colour = tuple(rng.uniform(0.1, 0.9, 3))
        for _ in range(200):
            angle = rng.uniform(0, 2 * np.pi)
            spot = np.clip(
                rng.uniform(1.6, 3.2) * np.array([np.cos(angle), np.sin(angle)]), 0.75 - room_m / 2, room_m / 2 - 0.75
            )
            if all(np.linalg.norm(spot - other) > 1.25 for other in placed):
                break
        else:
            break
        placed.append(spot)
        yaw = np.arctan2(-spot[1], -spot[0]) + rng.normal(0, 0.3)
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        for part in _MAKERS[name](colour):
            xy = turn @ np.array(part.centre[:2]) + spot
            parts.append(replace(part, centre=(*xy, part.centre[2]), yaw_rad=yaw, instance=len(categories) + 1))
        categories.append(name)
    return parts, categories


def _texture(local, seed):
    """Smooth stripes and blotches in [0.75, 1.1], fixed to the surface."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(0, 9.0, (4, 3))
    return 0.92 + 0.05 * np.sin(local @ waves.T + rng.uniform(0, 6, 4)).sum(axis=1)


def _cast(origin, rays, parts, room_m, height_m):
    """Nearest hit of every ray: hit parameter, instance and colour. Parameter = z-depth for un-normalised rays."""
    n = len(rays)
    best, instance, colour = np.full(n, np.inf), np.zeros(n, int), np.zeros((n, 3))
    half = np.array([room_m / 2, room_m / 2, height_m / 2])
    local = origin - [0, 0, height_m / 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        exits = np.where(rays > 0, (half - local) / rays, (-half - local) / rays)
    axis = np.argmin(exits, axis=1)
    best = exits[np.arange(n), axis]
    hit = origin + best[:, None] * rays
    walls = np.array([[0.75, 0.72, 0.65], [0.65, 0.7, 0.75], [0.5, 0.36, 0.24]])
    shade = np.where(axis == 2, np.where(rays[:, 2] > 0, 1.6, 1.0), np.where(rays[:, 0] > 0, 1.0, 0.9))
    colour = walls[axis] * shade[:, None] * _texture(hit * 0.6, 99)[:, None]
    for number, part in enumerate(parts):
        c, s = np.cos(part.yaw_rad), np.sin(part.yaw_rad)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        o, r = (origin - part.centre) @ turn / part.half, rays @ turn / part.half
        if part.round:
            a, b, k = (r * r).sum(1), r @ o, o @ o - 1
            root = b * b - a * k
            t = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
        else:
            # Axis by axis: of rows of three numbers the least is found slowly.
            with np.errstate(divide="ignore", invalid="ignore"):
                sides = [((1 - o[i]) / r[:, i], (-1 - o[i]) / r[:, i]) for i in range(3)]
            nears = [np.minimum(*side) for side in sides]
            t = functools.reduce(np.maximum, nears)
            far = functools.reduce(np.minimum, [np.maximum(*side) for side in sides])
            t = np.where((t < far) & (t > 0), t, np.inf)
        nearer = np.flatnonzero((t > 0.05) & (t < best))
        if not len(nearer):
            continue
        best[nearer], instance[nearer] = t[nearer], part.instance
        on = o + t[nearer, None] * r[nearer]
        if part.round:
            normal = on
        else:
            normal, rows = np.zeros((len(nearer), 3)), np.arange(len(nearer))
            face = np.stack([near[nearer] for near in nears], axis=1).argmax(axis=1)
            normal[rows, face] = -np.sign(r[nearer, face])
        world_normal = normal / np.linalg.norm(normal, axis=1, keepdims=True) @ turn.T
        light = 0.65 + 0.35 * np.clip(world_normal @ [0.4, 0.3, 0.87], -0.6, 1)
        colour[nearer] = np.array(part.colour) * (light * _texture(on * part.half * 2, number))[:, None]
    return best, instance, colour


def render(parts, camera_to_world, intrinsics, height_px, width_px, room_m=6.0, height_m=2.6):
    """Colour (uint8), z-depth (float32, metres) and instance map of one view."""
    y, x = np.mgrid[0:height_px, 0:width_px]
    rays = np.stack(
        [(x - intrinsics[0, 2]) / intrinsics[0, 0], (y - intrinsics[1, 2]) / intrinsics[1, 1], np.ones_like(x)], -1
    )
    rays = rays.reshape(-1, 3) @ camera_to_world[:3, :3].T
    depth, instance, colour = _cast(camera_to_world[:3, 3], rays, parts, room_m, height_m)
    rgb = np.clip(colour * 255, 0, 255).reshape(height_px, width_px, 3).astype(np.uint8)
    return rgb, depth.reshape(height_px, width_px).astype(np.float32), instance.reshape(height_px, width_px)


def noisy_mask(mask, rng, strength=0.08):
    """A detector's idea of a mask: the outline moved in and out by smooth noise, in proportion to its size."""
    size = np.sqrt(mask.sum())
    distance = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5) - cv2.distanceTransform(
        (~mask).astype(np.uint8), cv2.DIST_L2, 5
    )
    noise = cv2.GaussianBlur(rng.normal(size=mask.shape), (0, 0), max(1.0, 0.12 * size))
    noise = noise / max(noise.std(), 1e-9) + rng.normal(0, 0.7)
    return distance > strength * size * noise


def _blotches(shape, rng):
    """Smooth noise, uniform in [0, 1]."""
    noise = cv2.GaussianBlur(rng.normal(size=shape), (0, 0), 3) + 0.05 * rng.normal(size=shape)
    return np.argsort(np.argsort(noise, axis=None)).reshape(shape) / noise.size


def make_episode(
    seed: int,
    num_views: int = 25,
    size: tuple[int, int] = (240, 320),
    num_objects: int = 8,
    ring_m: float = 1.3,
    depth_noise: float = 0.0,
    confident_share: float = 0.35,
    wrong_class: float = 0.05,
    mask_noise: float = 1.0,
    depth_holes: float = 0.0,
    motion: dict[int, tuple[float, float]] | None = None,
    shifted: dict[int, tuple[float, float]] | None = None,
) -> Episode:
    """One episode of a synthetic room: a ring of cameras looking outwards over the furniture and inwards across it.

    ``motion`` tells how far some instances move between a view and the next, along x and y; they set out so that they
    are half-way where they stand without. ``shifted`` tells how far from there some stand still.
    """
    rng = np.random.default_rng(seed)
    height_px, width_px = size
    home, categories = furnish(seed, num_objects)
    intrinsics = intrinsics_from_fov(width_px, height_px, np.deg2rad(80))
    rgb, depth, poses, detections, truths = [], [], [], [], []
    for view in range(num_views):
        angle = 2 * np.pi * view / num_views
        eye = np.array([ring_m * np.cos(angle), ring_m * np.sin(angle), 1.5])
        aim = np.array([2.2 * np.cos(angle + np.pi), 2.2 * np.sin(angle + np.pi), 0.5 + 0.2 * np.sin(3 * angle)])
        pose = look_at(eye, aim)
        parts = [_moved(_moved(part, shifted or {}, 1), motion or {}, view - num_views / 2) for part in home]
        colour, depth_m, instance = render(parts, pose, intrinsics, height_px, width_px)
        if depth_noise:
            depth_m = (depth_m * (1 + rng.normal(0, depth_noise, depth_m.shape))).astype(np.float32)
        if depth_holes:
            depth_m = np.where(_blotches(depth_m.shape, rng) < depth_holes, 0, depth_m)
        rgb.append(colour)
        depth.append(np.round(depth_m * 1000).astype(np.uint16).astype(np.float32) / np.float32(1000))
        poses.append(pose)
        for number, category in enumerate(categories, start=1):
            modal = instance == number
            if modal.sum() < 40:
                continue
            _, _, alone = render([p for p in parts if p.instance == number], pose, intrinsics, height_px, width_px)
            truths.append(GroundTruth(view, number, category, modal, alone == number))
            whole = modal.sum() / max(1, (alone == number).sum())
            sure = rng.random() < confident_share * (0.3 + whole)
            confidence = rng.uniform(0.9, 0.99) if sure else rng.uniform(0.2, 0.89)
            mask = noisy_mask(modal, rng, mask_noise * (0.05 if sure else 0.12))
            name = str(rng.choice(categories)) if rng.random() < wrong_class else category
            if mask.sum() >= 20 and (sure or rng.random() < 0.7):
                detections.append(Detection(view, name, float(confidence), mask))
    return Episode(
        name=f"room_{seed}",
        rgb=np.stack(rgb),
        depth_m=np.stack(depth),
        intrinsics=np.repeat(intrinsics[None], num_views, 0),
        camera_to_world=np.stack(poses),
        file_names=tuple(f"rgb/{v:03d}.png" for v in range(num_views)),
        detections=tuple(detections),
        ground_truth=tuple(truths),
        categories=tuple(_MAKERS),
        metadata={"synthetic_seed": seed},
    )


def _moved(part: Part, motion: dict[int, tuple[float, float]], steps: float) -> Part:
    x, y = motion.get(part.instance, (0.0, 0.0))
    return replace(part, centre=(part.centre[0] + steps * x, part.centre[1] + steps * y, part.centre[2]))


def pick(episode: Episode, views: list[int]) -> Episode:
    """The episode with some of its views only, and the masks in them."""

    def kept(items):
        return (
            None
            if items is None
            else tuple(replace(one, view_index=views.index(one.view_index)) for one in items if one.view_index in views)
        )

    return replace(
        episode,
        rgb=episode.rgb[views],
        depth_m=episode.depth_m[views],
        intrinsics=episode.intrinsics[views],
        camera_to_world=episode.camera_to_world[views],
        file_names=tuple(f"rgb/{view:03d}.png" for view in range(len(views))),
        detections=kept(episode.detections),
        ground_truth=kept(episode.ground_truth),
    )
