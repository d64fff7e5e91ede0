"""Times as ISO 8601 writes them, ``2011-09-26 13:02:25.964389445``, as pandas, loggers and KITTI do."""

from __future__ import annotations

import re
from datetime import datetime, timedelta, timezone

_TIME = re.compile(
    r"(?P<day>\d{4}-\d\d-\d\d)[T ](?P<clock>\d\d:\d\d:\d\d)(?P<fraction>[.,]\d+)?"
    r"\s?(?:Z|UTC|(?P<sign>[-+])(?P<hours>\d\d):?(?P<minutes>\d\d)?)?"
)


def seconds_of_iso(text: str) -> float | None:
    """Seconds since 1970 of a time in ISO 8601, of UTC where it tells no offset; None of another text.

    Times of our age are exact to 0.2 µs: that is what a float64 holds.
    """
    found = _TIME.fullmatch(text.strip())
    if found is None:
        return None
    offset = timedelta(hours=int(found["hours"] or 0), minutes=int(found["minutes"] or 0))
    try:
        moment = datetime.fromisoformat(f"{found['day']}T{found['clock']}").replace(tzinfo=timezone.utc)
        whole = (moment - offset * (-1 if found["sign"] == "-" else 1)).timestamp()
    except (ValueError, OverflowError):  # no such day or hour; the offset leads out of the years 1 to 9999
        return None
    return whole + float((found["fraction"] or ".0").replace(",", "."))
