"""The only door to OpenCV, opened when the first image is read."""

from __future__ import annotations

import os
from types import ModuleType


def load_cv2() -> ModuleType:
    """OpenCV, with its own messages off: what goes wrong is told by this package's exceptions."""
    # Read by OpenCV's decoder of videos when it first runs; -8 is FFmpeg's "quiet".
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    try:
        import cv2
    except ModuleNotFoundError as error:
        message = f"images need {error.name}: pip install 'sfmcpp[vision]'"
        raise ModuleNotFoundError(message, name=error.name) from None
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    module: ModuleType = cv2
    return module
