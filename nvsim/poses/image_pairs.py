"""Pairs of images that may show one place, for images without camera poses."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.poses.features import Features, unit_vectors

_NEXT = (1, 2, 3, 5, 8)  # distances in frames between the two images of a pair of neighbors
_WORDS, _SIZE = 64, 256  # visual words of an image descriptor, and its length
_SAMPLED, _LEARNED = 60, 30_000  # features of an image, and of all images, from which the words are learned
ALIKE = 12  # similar images that are compared with each image, in addition to its neighbors
_APART = 17  # frames of a video between two images, at least, for a pair of similar images


def neighbor_pairs(clips: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Pairs of frames near each other in time, the earlier first. `clips` (N,) is the video index of each frame."""
    count = len(clips)
    return [(i, i + k) for i in range(count) for k in _NEXT if i + k < count and clips[i] == clips[i + k]]


def similar_pairs(
    features: Sequence[Features], ordered: bool, clips: NDArray[np.int64], most: int = ALIKE
) -> list[tuple[int, int]]:
    """Pairs of similar images, the smaller index first. `clips` (N,) is the video index of each image.

    If the images are `ordered`, frames of one video that are near in time are excluded. Photos without an order get
    three times as many pairs."""
    words = image_descriptors(features)
    likeness, pairs = words @ words.T, set()
    index = np.arange(len(words))
    for i, row in enumerate(likeness):
        near = (np.abs(index - i) < _APART) & (clips == clips[i]) if ordered else index == i
        order = np.argsort(-np.where(near, -np.inf, row), kind="stable")
        for j in order[: most if ordered else 3 * most]:
            if not near[j]:
                pairs.add((min(i, int(j)), max(i, int(j))))
    return sorted(pairs)


def image_descriptors(features: Sequence[Features]) -> NDArray[np.float32]:
    """Image descriptors of shape (N, D) float32, D <= 256, unit vectors.

    The larger the dot product of two, the more likely the two images show one place. The method is VLAD (Jegou et al.
    2010) over words that are learned from these images, half-whitened."""
    rng = np.random.default_rng(0)
    sampled = [unit_vectors(f)[rng.permutation(len(f))[:_SAMPLED]] for f in features if len(f)]
    pool = np.concatenate(sampled) if sampled else np.zeros((0, 128), np.float32)
    if len(pool) < 2 * _WORDS:
        return np.zeros((len(features), 1), np.float32)
    pool = pool[rng.permutation(len(pool))[:_LEARNED]]
    cv2.setRNGSeed(0)
    stop = (cv2.TERM_CRITERIA_MAX_ITER, 12, 0)
    _, _, words = cv2.kmeans(pool, _WORDS, np.zeros((len(pool), 1), np.int32), stop, 1, cv2.KMEANS_PP_CENTERS)
    found = np.zeros((len(features), *words.shape), np.float32)
    for i, one in enumerate(features):
        if len(one):
            values = unit_vectors(one)
            nearest = (2 * values @ words.T - (words**2).sum(axis=1)).argmax(axis=1)
            np.add.at(found[i], nearest, values - words[nearest])
    found /= np.maximum(np.linalg.norm(found, axis=2, keepdims=True), 1e-9)
    flat = found.reshape(len(found), -1)
    flat = flat - flat.mean(axis=0)
    values, vectors = np.linalg.eigh(flat @ flat.T)
    largest = np.argsort(values)[::-1][: max(1, min(_SIZE, len(flat) - 1))]
    short = vectors[:, largest] * np.maximum(values[largest], 1e-9) ** 0.25
    return np.asarray(short / np.maximum(np.linalg.norm(short, axis=1, keepdims=True), 1e-9), np.float32)
