"""Results of SLAM runs and reconstructions: reports, files, `evaluation`, `plotting`, `pages`."""

from sfmcpp.study.sfm_report import SfmReport
from sfmcpp.study.slam_report import SlamReport

__all__ = ["SfmReport", "SlamReport"]
