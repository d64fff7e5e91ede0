"""Scenes for rendered photos, and the cameras in them.

World: metres, z up. Each function takes the number of photos and a source of randomness.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.synthetic.image_geometry import UP, looking_at
from sfmcpp.sources.synthetic.photos.faces import Face, Painter, plain_texture


@dataclass(frozen=True, eq=False)
class Place:
    """A scene of textured faces, and its cameras.

    Attributes
    ----------
    faces : list of Face
        Textured rectangles.
    cameras : (C, 3, 4) float64
        ``[R | c]``, world_from_camera.
    same_photo : bool
        Whether all photos are one and the same, noise included.
    """

    faces: list[Face]
    cameras: FloatArray
    same_photo: bool = False


def courtyard(num_images: int, rng: np.random.Generator) -> Place:
    """A walk round a house inside four walls, the house and what is behind it in view."""
    angle = 2 * np.pi * np.arange(num_images) / num_images
    ring = np.stack([8.0 * np.cos(angle), 7.0 * np.sin(angle), 1.7 + 0.4 * np.sin(3 * angle)], axis=1)
    ring += rng.normal(0, 0.15, ring.shape)
    targets = rng.normal([0, 0, 1.4], [0.8, 0.8, 0.3], (num_images, 3))
    return Place(_yard(rng), looking_at(ring, targets, UP))


def _yard(rng: np.random.Generator) -> list[Face]:
    painter = Painter(rng, 0.01)
    corners = [(-12.0, -11.0), (12.0, -11.0), (12.0, 11.0), (-12.0, 11.0)]
    faces = [Painter(rng, 0.015).ground(corners[0], corners[2])]
    for k in range(4):
        # Seen from inside, the next corner against the clock is on the left.
        faces.append(painter.wall(corners[(k + 1) % 4], corners[k], 0.0, 5.0))
    faces += painter.box((-2.6, -1.8, 0.0), (2.2, 2.0, 3.2))
    for centre in ((-4.2, 3.4), (4.4, -3.0), (3.6, 3.8), (-4.6, -3.2)):
        size = rng.uniform(0.4, 0.9, 3)
        faces += painter.box((*(centre - size[:2]), 0.0), (*(centre + size[:2]), 2 * size[2]))
    return faces


def street(num_images: int, rng: np.random.Generator) -> Place:
    """A drive past houses that do not line up, the camera turned half towards them."""
    step_m, part_m = 0.7, 12.0
    along = step_m * np.arange(num_images)
    swing = np.stack([along, 0.15 * np.sin(along / 7.0), 1.6 + 0.03 * np.sin(along)], axis=1)
    ahead = swing + np.stack(
        [np.full(num_images, 4.0), 5.0 + 0.4 * np.sin(along / 5.0), np.zeros(num_images)], 1
    )
    painter, faces = Painter(rng, 0.012), []
    for k in range(-1, int((along[-1] + 40.0) / part_m) + 1):
        begin, depth = k * part_m, rng.uniform(6.0, 9.0)
        faces.append(Painter(rng, 0.025).ground((begin, 0.5), (begin + part_m, 9.0)))
        faces += painter.box((begin, depth, 0.0), (begin + part_m - 1.5, depth + 3.0, rng.uniform(5.0, 8.0)))
        faces += painter.box((begin + 3.0, 3.6, 0.0), (begin + 5.5, 4.8, rng.uniform(0.8, 1.5)))
    return Place(faces, looking_at(swing, ahead, UP))


def drone(num_images: int, rng: np.random.Generator) -> Place:
    """Photos straight down from a grid of places 40 m above a field with houses, as a drone takes them."""
    rows = max(1, round(np.sqrt(num_images)))
    row, column = np.divmod(np.arange(num_images), -(-num_images // rows))
    column = np.where(row % 2, column.max() - column, column)
    centres = np.stack([11.0 * column, 9.0 * row, np.full(num_images, 40.0)], axis=1)
    centres += rng.normal(0, [0.8, 0.8, 1.5], centres.shape)
    below = centres * [1, 1, 0] + rng.normal(0, 1.5, centres.shape) * [1, 1, 0]
    low, high = centres[:, :2].min(axis=0) - 30, centres[:, :2].max(axis=0) + 30
    painter = Painter(rng, 0.05)
    faces = [painter.ground(low, high)]
    for corner in rng.uniform(low, high, (40, 2)):
        size = rng.uniform([3, 3, 2], [8, 8, 9])
        faces += painter.box((*corner, 0.0), (*(corner + size[:2]), size[2]))
    return Place(faces, looking_at(centres, below, np.array([0.0, 1.0, 0.0])))


def symmetric(num_images: int, rng: np.random.Generator) -> Place:
    """A walk round a tower whose four sides look the same; what is far behind it differs, but is little."""
    angle = 2 * np.pi * (np.arange(num_images) + 0.3) / num_images
    ring = np.stack([9.0 * np.cos(angle), 9.0 * np.sin(angle), np.full(num_images, 1.8)], axis=1)
    painter = Painter(rng, 0.01)
    side = painter.texture(4.0, 7.0)
    faces = painter.box((-2, -2, 0), (2, 2, 7), [side] * 4)
    faces.append(painter.ground((-60, -60), (60, 60), plain_texture(120)))
    return Place(faces + _posts(painter, rng), looking_at(ring, np.array([0.0, 0.0, 2.6]), UP))


def _posts(painter: Painter, rng: np.random.Generator) -> list[Face]:
    """Boxes of all kinds far around."""
    faces = []
    for k in range(20):
        where = 2 * np.pi * (k + rng.uniform(-0.3, 0.3)) / 20
        centre = rng.uniform(16, 22) * np.array([np.cos(where), np.sin(where)])
        half = rng.uniform(0.6, 1.4, 2)
        faces += painter.box((*(centre - half), 0.0), (*(centre + half), rng.uniform(1.5, 3.0)))
    return faces


def double(num_images: int, rng: np.random.Generator) -> Place:
    """A wall from the front and then from behind, where it looks the same; no photo of one end joins both."""
    first = np.linspace(-0.7, 0.7, num_images - num_images // 2)
    angle = np.concatenate([first, np.linspace(np.pi - 0.66, np.pi + 0.72, num_images // 2)])
    ring = np.stack([7.5 * np.sin(angle), -7.5 * np.cos(angle), np.full(num_images, 1.7)], axis=1)
    painter = Painter(rng, 0.01)
    side, ends = painter.texture(4.5, 4.0), [painter.texture(0.6, 4.0) for _ in range(2)]
    faces = painter.box((-2.25, -0.3, 0), (2.25, 0.3, 4.0), [side, ends[0], side, ends[1]])
    faces.append(painter.ground((-60, -60), (60, 60), plain_texture(120)))
    return Place(faces + _posts(painter, rng), looking_at(ring, np.array([0.0, 0.0, 1.8]), UP))


def rotation(num_images: int, rng: np.random.Generator) -> Place:
    """The camera turns on the spot."""
    centre = np.array([6.5, -5.0, 1.6])
    angle = 2.2 + 0.16 * np.arange(num_images)
    ahead = np.stack([np.cos(angle), np.sin(angle), rng.uniform(-0.05, 0.05, num_images)], axis=1)
    return Place(_yard(rng), looking_at(np.tile(centre, (num_images, 1)), centre + ahead, UP))


def planar(num_images: int, rng: np.random.Generator) -> Place:
    """One flat wall, from the left to the right."""
    side = np.linspace(-1, 1, num_images)
    centres = np.stack([4.0 * side, -5.0 - 1.0 * np.cos(2 * side), 2.0 + 0.8 * np.sin(4 * side)], axis=1)
    targets = np.stack([0.8 * side, np.zeros(num_images), np.full(num_images, 2.0)], axis=1)
    wall = Painter(rng, 0.008).wall((-7, 0), (7, 0), -3, 7)
    return Place([wall], looking_at(centres, targets, UP))


def identical(num_images: int, rng: np.random.Generator) -> Place:
    """The same photo again and again."""
    first = courtyard(1, rng)
    return Place(first.faces, np.repeat(first.cameras, num_images, axis=0), same_photo=True)


def apart(num_images: int, rng: np.random.Generator) -> Place:
    """Each photo of another wall: nothing overlaps."""
    painter = Painter(rng, 0.01)
    places = 20.0 * np.arange(num_images)
    walls = [painter.wall((x - 6, 0), (x + 6, 0), -3, 7) for x in places]
    centres = np.stack([places, np.full(num_images, -5.0), np.full(num_images, 2.0)], axis=1)
    return Place(walls, looking_at(centres, centres + np.array([0.0, 1.0, 0.0]), UP))


PLACES: dict[str, Callable[[int, np.random.Generator], Place]] = {
    "courtyard": courtyard,
    "street": street,
    "drone": drone,
    "symmetric": symmetric,
    "double": double,
    "rotation": rotation,
    "planar": planar,
    "identical": identical,
    "apart": apart,
}
