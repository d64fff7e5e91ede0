"""Image retrieval with a vocabulary trained on the same images.

Descriptors are assigned to the nearest of a vocabulary of words, which the set itself teaches, and images are
compared by the words they hold (Sivic and Zisserman, "Video Google: a text retrieval approach to object
matching in videos", ICCV 2003): a word counts the more the fewer images hold it, and by the root of how often
an image does, because a texture repeats one word over and over (Jégou, Douze and Schmid, "On the burstiness
of visual elements", CVPR 2009). Of the images that come out best, the largest features are matched, which
tells much better whether they have anything in common (Wu, "Towards linear-time incremental structure from
motion", 3DV 2013).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp import _core
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_count, require_seed
from sfmcpp.model.photos import Features
from sfmcpp.model.threads import on_threads
from sfmcpp.sources.vision.matching import Descriptors, match

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

IndexPair = tuple[int, int]
# Called between parts of long work, which ends by what it raises.
Heed = Callable[[], None]

# Largest features of an image whose words are taken, and of which matches are tried.
_FEATURES_IN_WORDS, _FEATURES_TRIED = 1000, 500
# Words at least and at most; features of the set by words; those that teach a word.
_WORDS = (64, 16384)
_FEATURES_PER_WORD, _TEACHERS_PER_WORD = 25, 10
# How often words are moved to the means of what is nearest to them.
_PASSES = 4
# Images that are tried for each that is wanted.
_CANDIDATES = 3
# Matches of the largest features that two images with a common part have nearly always. On 110 photos of six
# sets, 99 % of the pairs with 30 true matches have them, all with 100, and 7 % of the others.
_FEWEST_MATCHES = 3
# Images that each is paired with at least, whether or not enough is alike.
_FEWEST_NEIGHBOURS = 3
# Images whose scores are at hand at once.
_BATCH = 256


def nothing() -> None:
    """Heed nothing."""


def alike_pairs(
    features: Sequence[Features],
    neighbours: int,
    *,
    queries: Sequence[int] | None = None,
    known: Collection[IndexPair] = (),
    seed: int = 0,
    threads: int = 0,
    heed: Heed = nothing,
) -> list[IndexPair]:
    """Pair images with those that look most like them.

    The vocabulary depends on the set: with another image, pairs that hardly look alike may change.

    Parameters
    ----------
    features : sequence of Features
        Of each image.
    neighbours : int
        With how many each is paired at most; it may be chosen by more.
    queries : sequence of int, optional
        Images to find others for. Default: all.
    known : collection of (int, int)
        Pairs, the lower number first, that are not asked for.
    seed : int
        Same seed, same result.
    threads : int
        How many to use; 0: all. The result is the same.
    heed : callable
        Called between parts of the work, within seconds; what it raises ends it.

    Returns
    -------
    list of (int, int)
        Numbers of images, sorted, the lower first.

    Raises
    ------
    InvalidArgument
        If descriptors of the images are of different length.
    """
    require_count("neighbours", neighbours, 0)
    words = bags_of_words(features, seed=seed, threads=threads, heed=heed)
    asked = range(len(features)) if queries is None else queries
    ranked = _ranked_images(words, asked, _CANDIDATES * neighbours, known)
    tried = sorted({_pair(image, other) for image, others in ranked.items() for other in others})
    alike = dict(zip(tried, _common_matches(features, tried, threads, heed), strict=True))
    found: set[IndexPair] = set()
    for image, others in ranked.items():
        # Of equally many matches those first that have more words in common.
        best = sorted((_pair(image, other) for other in others), key=lambda pair: -alike[pair])[:neighbours]
        enough = sum(alike[pair] >= _FEWEST_MATCHES for pair in best)
        found.update(best[: max(enough, _FEWEST_NEIGHBOURS)])
    return sorted(found)


def bags_of_words(
    features: Sequence[Features], *, seed: int = 0, threads: int = 0, heed: Heed = nothing
) -> csr_matrix:
    """Weights of words in each image.

    Parameters
    ----------
    features : sequence of Features
        Of each image; they teach the words as well.
    seed : int
        Same seed, same result.
    threads : int
        How many to use; 0: as many as gain from it. The result is the same.
    heed : callable
        Called between parts of the work, within seconds; what it raises ends it.

    Returns
    -------
    (images, words) sparse float64
        Rows of unit length, or of zeros, the products of which say how much images are alike.

    Raises
    ------
    InvalidArgument
        If descriptors of the images are of different length.
    """
    from scipy.sparse import csr_matrix

    require_seed(seed)
    if len({of_image.descriptors.shape[1] for of_image in features if of_image.descriptors.size}) > 1:
        raise InvalidArgument("features: have descriptors of different length, must have one")
    if not any(of_image.descriptors.size for of_image in features):
        return csr_matrix((len(features), 1))
    vocabulary = _vocabulary_of(features, seed, threads, heed)
    starts, words, times = [0], [], []
    for of_image in features:
        heed()
        word, time = _words_in(of_image, vocabulary, threads)
        starts.append(starts[-1] + len(word))
        words.append(word)
        times.append(time)
    columns = np.concatenate(words)
    holders = np.bincount(columns, minlength=len(vocabulary))
    rarity = np.log((1 + len(features)) / np.maximum(holders, 1))
    data = np.sqrt(np.concatenate(times)) * rarity[columns]
    return _of_unit_rows(csr_matrix((data, columns, starts), (len(features), len(vocabulary))))


def train_vocabulary(
    descriptors: Descriptors, words: int, *, seed: int = 0, threads: int = 0, heed: Heed = nothing
) -> Descriptors:
    """Cluster descriptors by k-means.

    Parameters
    ----------
    descriptors : (n, D) uint8
        What to cluster.
    words : int
        How many clusters; fewer come back where there are fewer different descriptors.
    seed : int
        Chooses the descriptors to start from.
    threads : int
        How many to use; 0: as many as gain from it. The result is the same.
    heed : callable
        Called between parts of the work, within seconds; what it raises ends it.

    Returns
    -------
    (k, D) uint8
        Means, rounded.
    """
    from scipy.sparse import csr_matrix

    require_count("words", words)
    require_seed(seed)
    descriptors = np.ascontiguousarray(descriptors)
    order = np.random.default_rng(seed).permutation(len(descriptors))
    # Equal ones would be one word.
    _, firsts = np.unique(descriptors[order], axis=0, return_index=True)
    means = np.ascontiguousarray(descriptors[order[np.sort(firsts)[:words]]])
    values, columns = descriptors.astype(np.float64), np.arange(len(descriptors))
    for _ in range(_PASSES):
        heed()
        nearest = _core.nearest_of_first(descriptors, means, threads)[0]
        members = csr_matrix((np.ones(len(values)), (nearest, columns)), (len(means), len(values)))
        sums: FloatArray = np.asarray(members @ values)
        counts = np.bincount(nearest, minlength=len(means))
        filled = counts > 0
        means[filled] = np.rint(sums[filled] / counts[filled, None]).astype(np.uint8)
    return means


def _vocabulary_of(features: Sequence[Features], seed: int, threads: int, heed: Heed) -> Descriptors:
    """Words taught by some of the largest features of every image."""
    described = [of_image for of_image in features if of_image.descriptors.size]
    total = sum(min(len(of_image), _FEATURES_IN_WORDS) for of_image in described)
    words = int(np.clip(total // _FEATURES_PER_WORD, *_WORDS))
    share = min(1.0, words * _TEACHERS_PER_WORD / total)
    rng = np.random.default_rng(seed)
    teachers = []
    for of_image in described:
        largest = _descriptors_of_largest(of_image, _FEATURES_IN_WORDS)
        teachers.append(largest[rng.permutation(len(largest))[: int(np.ceil(share * len(largest)))]])
    return train_vocabulary(np.concatenate(teachers), words, seed=seed, threads=threads, heed=heed)


def _words_in(
    features: Features, vocabulary: Descriptors, threads: int
) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Numbers of the words in an image, ascending, and how often each is there."""
    if not features.descriptors.size:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    largest = _descriptors_of_largest(features, _FEATURES_IN_WORDS)
    return np.unique(_core.nearest_of_first(largest, vocabulary, threads)[0], return_counts=True)


def _of_unit_rows(weights: csr_matrix) -> csr_matrix:
    lengths = np.sqrt(np.asarray(weights.multiply(weights).sum(axis=1)).ravel())
    weights.data /= np.repeat(np.where(lengths > 0, lengths, 1.0), np.diff(weights.indptr))
    return weights


def _descriptors_of_largest(features: Features, count: int) -> Descriptors:
    """Descriptors of the largest features, in the order they came."""
    # Of equal and of unknown size the first, which are the strongest.
    size = np.nan_to_num(features.scales, nan=0.0)
    largest = np.sort(np.argsort(-size, kind="stable")[:count])
    return np.ascontiguousarray(features.descriptors[largest])


def _ranked_images(
    words: Any, queries: Sequence[int], count: int, known: Collection[IndexPair]
) -> dict[int, list[int]]:
    """For each query the images with the most in common, best first."""
    apart: dict[int, list[int]] = {}
    for i, j in known:
        apart.setdefault(i, []).append(j)
        apart.setdefault(j, []).append(i)
    found: dict[int, list[int]] = {}
    columns = words.T.tocsr()
    for first in range(0, len(queries), _BATCH):
        batch = list(queries[first : first + _BATCH])
        scores: FloatArray = (words[batch] @ columns).toarray()
        for image, of_image in zip(batch, scores, strict=True):
            of_image[[image, *apart.get(image, [])]] = 0.0
            order = np.argsort(-of_image, kind="stable")[:count]
            found[image] = order[of_image[order] > 0].tolist()
    return found


def _common_matches(
    features: Sequence[Features], pairs: list[IndexPair], threads: int, heed: Heed
) -> list[int]:
    """Matches of the largest features for each of the pairs."""
    wanted = sorted({image for pair in pairs for image in pair})
    largest = {image: _descriptors_of_largest(features[image], _FEATURES_TRIED) for image in wanted}

    def count(pair: IndexPair) -> int:
        return len(match(largest[pair[0]], largest[pair[1]], threads=1))

    found = []
    with closing(on_threads(count, pairs, threads or _core.usable_cores())) as counts:
        for matches in counts:
            heed()
            found.append(matches)
    return found


def _pair(image: int, other: int) -> IndexPair:
    return (image, other) if image < other else (other, image)
