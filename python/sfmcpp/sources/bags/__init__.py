"""ROS bags: what they hold, and files of it that a SLAM run reads."""

from sfmcpp.sources.bags.container import Bag, Topic, is_bag, open_bag
from sfmcpp.sources.bags.messages import ROLES
from sfmcpp.sources.bags.unpack import UnpackedBag, unpack_bag

__all__ = ["ROLES", "Bag", "Topic", "UnpackedBag", "is_bag", "open_bag", "unpack_bag"]
