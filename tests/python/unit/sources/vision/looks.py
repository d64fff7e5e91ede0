"""Images of one-dimensional worlds, known by descriptors alone."""

from __future__ import annotations

import numpy as np

from sfmcpp.model.photos import Features


def features_of(descriptors: np.ndarray) -> Features:
    count = len(descriptors)
    unknown = np.full(count, np.nan)
    colors = np.zeros((count, 3), np.uint8)
    return Features(np.zeros((count, 2)), unknown, unknown, colors, descriptors)


def walk_round(places: int, seen: int, step: int, *, seed: int = 0, noise: float = 12.0) -> list[Features]:
    """Images of a ring of landmarks: each shows `seen` of them, `step` further than the one before.

    The next `seen / step` images have landmarks in common with an image, the nearest the most.
    """
    rng = np.random.default_rng(seed)
    strength = rng.gamma(0.4, 1.0, (places * step, 128))
    landmarks = 512 * np.sqrt(strength / strength.sum(axis=1, keepdims=True))
    images = []
    for place in range(places):
        shown = landmarks[(place * step + rng.permutation(seen)) % len(landmarks)]
        images.append(np.rint(shown + rng.normal(0, noise, shown.shape)).clip(0, 255).astype(np.uint8))
    return [features_of(image) for image in images]


def ring_distance(i: int, j: int, places: int) -> int:
    """Steps between two images of :func:`walk_round`."""
    return min((i - j) % places, (j - i) % places)
