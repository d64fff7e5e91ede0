"""The match graph of a COLMAP database: its keypoints and matches, verified as ours are."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.sfm.given_matches import match_graph_of_arrays, one_for_one
from sfmcpp.sfm.in_order import Progress, silent
from sfmcpp.sfm.match_graph import MatchGraph
from sfmcpp.sources.io.colmap.database import read_database


def match_graph_of_database(
    path: str | PathLike[str],
    *,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = silent,
) -> MatchGraph:
    """Make a match graph of a database of COLMAP; only its two-view geometry is computed.

    Parameters
    ----------
    path : path-like
        ``database.db``; it is not changed.
    seed : int
        Of every random sample; same seed, same result.
    threads : int, optional
        Threads at most; the result does not depend on it. Default: as many as the process may use.
    progress : callable
        As of :func:`match_graph_of_arrays`.

    Returns
    -------
    MatchGraph
        Images in the order of their names, with the keypoints that COLMAP detected and the matches that it
        has verified (all matches where it has verified none). Images of one camera share it; its focal
        length counts where the files told it, and so do their positions if they are WGS84.

    Raises
    ------
    DatasetError
        If the file is missing, damaged or no such database, or a camera model is not supported.
    KeyboardInterrupt
        If `progress` asked to stop.
    """
    found = read_database(path)
    try:
        graph = match_graph_of_arrays(
            found.keypoints,
            {pair: one_for_one(some) for pair, some in found.matches.items()},
            [photo.size for photo in found.photos],
            [photo.name for photo in found.photos],
            found.scales,
            intrinsics=found.intrinsics,
            seed=seed,
            threads=threads,
            progress=progress,
        )
    except InvalidArgument as error:
        raise DatasetError(path, str(error)) from error
    return replace(graph, photos=found.photos)
