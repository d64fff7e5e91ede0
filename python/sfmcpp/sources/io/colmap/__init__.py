"""COLMAP's models: three files, cameras, images and points3D, as text or binary, in one folder."""

from sfmcpp.sources.io.colmap.formats import BINARY, TEXT

__all__ = ["BINARY", "TEXT"]
