"""A rank that waits for the others leaves its core to them."""

from __future__ import annotations

import time
from typing import Any

import pytest

from sfmcpp.ba import ranks as ranks_of_ba
from sfmcpp.ba.ranks import Ranks


class _OthersComeAt:
    """A communicator, and the request of its barrier, whose others come at some time of the clock."""

    def __init__(self, come_s: float) -> None:
        self.now_s, self.come_s, self.looks = 0.0, come_s, 0

    def Test(self) -> bool:  # noqa: N802
        self.looks += 1
        return self.now_s >= self.come_s

    def Ibarrier(self) -> _OthersComeAt:  # noqa: N802
        return self

    def Get_rank(self) -> int:  # noqa: N802
        return 0

    def Get_size(self) -> int:  # noqa: N802
        return 2

    def allgather(self, mine: Any) -> list[Any]:
        return [mine, mine]

    def _unused(self, *_: Any) -> Any:
        raise NotImplementedError

    Iallgather = Ialltoall = Ialltoallv = alltoall = bcast = send = recv = _unused


@pytest.mark.parametrize(("come_s", "most_looks", "most_late_s"), [(0.0005, 7, 1e-4), (2.0, 1100, 2e-3)])
def test_who_waits_for_long_looks_seldom_and_is_hardly_late(
    come_s: float, most_looks: int, most_late_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    others = _OthersComeAt(come_s)

    def sleep(nap_s: float) -> None:
        others.now_s += nap_s

    monkeypatch.setattr(ranks_of_ba, "time", type(time)("time"))
    monkeypatch.setattr(ranks_of_ba.time, "sleep", sleep, raising=False)
    monkeypatch.setattr(ranks_of_ba.time, "monotonic", lambda: others.now_s, raising=False)
    assert Ranks(others).everyones(3) == [3, 3]
    assert others.looks <= most_looks
    assert others.now_s - come_s <= most_late_s + 1e-12
