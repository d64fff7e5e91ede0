"""Literal types of the names that arguments can have, equal to the tables of the core.

Where names come from files too, arguments take any ``str`` beside these, and are checked when they are used.
"""

from typing import Literal, TypeAlias

CameraModelName: TypeAlias = Literal["calibrated", "perspective", "bal", "projective"]
ConstraintKindName: TypeAlias = Literal[
    "pose",
    "position",
    "orientation",
    "orientation-reprojections",
    "displacement-pose",
    "displacement-translation",
    "displacement-rotation",
    "displacement-rotation-log",
    "scale",
    "smoothing",
    "smoothing-reprojections",
    "focal",
    "principal-point",
]
Method: TypeAlias = Literal[
    "lm", "lm-nielsen", "dog-leg", "gauss-newton", "gradient-descent", "conjugate-gradient", "alternation"
]
LineSearch: TypeAlias = Literal["none", "g-als", "t-als", "exact", "soft", "backtracking"]
LinearSolver: TypeAlias = Literal["auto", "dense", "sparse", "iterative"]
Loss: TypeAlias = Literal["squared", "huber", "cauchy", "tukey", "geman-mcclure", "truncated", "auto"]
Gauge: TypeAlias = Literal["auto", "free", "fixed"]
Datum: TypeAlias = Literal["cameras", "all"]
