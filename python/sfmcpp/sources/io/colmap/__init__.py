"""COLMAP's models: cameras, images and points3D, text or binary files in a folder, or pycolmap's objects."""

from sfmcpp.sources.io.colmap.formats import BINARY, FILE_NAMES, TEXT
from sfmcpp.sources.io.colmap.objects import from_pycolmap, to_pycolmap

__all__ = ["BINARY", "FILE_NAMES", "TEXT", "from_pycolmap", "to_pycolmap"]
