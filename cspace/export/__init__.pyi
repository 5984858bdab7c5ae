# Names for planners and the command line. Each is imported at its first use.

from ._messages import fill_joint_trajectory as fill_joint_trajectory
from ._messages import fill_path as fill_path
from ._messages import make_twists as make_twists
from ._writers import EXPORT_FORMATS as EXPORT_FORMATS
