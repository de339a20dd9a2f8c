"""`rover robot check`: its interface, a short drive, and the fault monitors on its bags."""

from adapters.ros.check.bag_monitors import BagError as BagError
from adapters.ros.check.bag_monitors import bag_drive as bag_drive
from adapters.ros.check.bag_monitors import check_bag as check_bag
from adapters.ros.check.check import CheckResult as CheckResult
from adapters.ros.check.check import check_robot as check_robot
from adapters.ros.check.drive import DriveError as DriveError
from adapters.ros.check.navigation import check_navigation as check_navigation
