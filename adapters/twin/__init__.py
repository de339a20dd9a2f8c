"""Twin of a rover on the ground: predicts where a delayed command finds it.

Inputs are the commands sent, and the stages and poses reported, each with its time. The output is
a `PredictedPose`. The twin is the executive itself on a kinematic base; it runs on the time of
its inputs and uses no network.
"""

from adapters.twin.executive_copy import ReportedPose as ReportedPose
from adapters.twin.twin import PredictedPose as PredictedPose
from adapters.twin.twin import Twin as Twin
