"""What explains a bad result: a problem examined before a solve or after it, mended where that is safe."""

from sfmcpp.doctor.diagnose import diagnose
from sfmcpp.doctor.finding import SEVERITIES, Diagnosis, Finding
from sfmcpp.doctor.repair import Repair, repair

__all__ = ["SEVERITIES", "Diagnosis", "Finding", "Repair", "diagnose", "repair"]
