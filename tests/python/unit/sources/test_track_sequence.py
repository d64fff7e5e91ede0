"""A sequence gives each frame its tracks in order, and refuses what is no sequence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.frames import View, common
from sfmcpp.sources.frames import TrackSequence

INTRINSICS = np.array([500.0, 1.0, 320.0, 240.0, 0.0])


def arguments(**changed: Any) -> dict[str, Any]:
    """Three frames, the middle one blind, and four observations in no order."""
    good = {
        "t_s": [0.0, 0.5, 0.7],
        "frame_index": [2, 0, 0, 2],
        "track_index": [7, 5, 3, 5],
        "pixels": [[27.0, 1], [5, 2], [3, 3], [25, 4]],
        "intrinsics": INTRINSICS,
    }
    return {**good, **changed}


def test_a_view_holds_the_tracks_of_its_frame_in_order_with_their_pixels() -> None:
    sequence = TrackSequence(**arguments())
    assert (len(sequence), sequence.num_tracks) == (3, 8)
    views = [sequence.view(frame) for frame in range(3)]
    assert [view.tracks.tolist() for view in views] == [[3, 5], [], [5, 7]]
    assert [view.pixels.tolist() for view in views] == [[[3, 3], [5, 2]], [], [[25, 4], [27, 1]]]


def test_a_sequence_without_observations_has_blind_frames_only() -> None:
    sequence = TrackSequence(**arguments(frame_index=[], track_index=[], pixels=np.empty((0, 2))))
    assert (len(sequence), sequence.num_tracks) == (3, 0)
    assert len(sequence.view(1).tracks) == 0


def test_numbers_far_apart_ask_for_no_room_between_them() -> None:
    sequence = TrackSequence(**arguments(track_index=[2_000_000_000, 500_000, 3, 500_000]))
    assert sequence.num_tracks == 3
    assert [sequence.view(frame).tracks.tolist() for frame in (0, 2)] == [[0, 1], [1, 2]]


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"t_s": [0.0, 0.5, 0.5]}, r"t_s\[2\] = 0.5 s is a duplicate"),
        ({"t_s": [0.0, 0.5, 0.4]}, r"t_s\[2\] = 0.4 s is earlier"),
        ({"t_s": [[0.0, 0.5, 0.7]]}, "t_s: shape"),
        ({"t_s": [], "frame_index": [], "track_index": [], "pixels": []}, "t_s: there is no frame"),
        ({"frame_index": [3, 0, 0, 2]}, r"frame_index: must be in \[0, 3\)"),
        ({"frame_index": [2, 0, -1, 2]}, r"frame_index: must be in \[0, 3\)"),
        ({"track_index": [7, 5, -3, 5]}, "track_index: must not be negative"),
        ({"track_index": [7, 5, 5, 5]}, "track_index: a frame sees a track twice"),
        ({"track_index": [7, 5, 3]}, "track_index: 3 entries for 4 observations"),
        ({"track_index": [2**32, 5, 3, 5]}, "track_index: value 4294967296 does not fit in 32 bits"),
        ({"track_index": [7.5, 5, 3, 5]}, "track_index: float64"),
        ({"pixels": [[1.0, 2]]}, "pixels: shape"),
        ({"pixels": [[27.0, 1], [5, 2], [3, np.nan], [25, 4]]}, r"pixels\[2, 1\] = nan"),
        ({"intrinsics": [500.0, 320, 240]}, "intrinsics: shape"),
    ],
)
def test_what_is_no_sequence_is_refused(changed: dict[str, Any], told: str) -> None:
    with pytest.raises(InvalidArgument, match=told):
        TrackSequence(**arguments(**changed))


def test_common_tracks_are_found_where_each_view_has_them() -> None:
    def view(*tracks: int) -> View:
        return View(np.array(tracks, dtype=np.int32), np.zeros((len(tracks), 2)))

    in_a, in_b = common(view(1, 4, 6, 9), view(0, 4, 9, 11))
    assert (in_a.tolist(), in_b.tolist()) == ([1, 3], [1, 2])
    assert [len(found) for found in common(view(1), view(2))] == [0, 0]
