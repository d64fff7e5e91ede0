"""Batch structure from motion: from tracks to a projective world, and from there to a metric one."""

from sfmcpp.sfm.batch.projective import ProjectiveReconstruction, reconstruct_projective

__all__ = ["ProjectiveReconstruction", "reconstruct_projective"]
