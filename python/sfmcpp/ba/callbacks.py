"""What the answer of a caller's function means: the same in a solve and in a SLAM run."""

from __future__ import annotations

import numpy as np


def goes_on(answer: object) -> bool:
    """Whether a run goes on after this answer of a callback: only False, Python's or NumPy's, stops."""
    return not isinstance(answer, bool | np.bool_) or bool(answer)
