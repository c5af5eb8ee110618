"""bullet_tendon: tendons for pybullet.

An implicit, nonlinear mass-spring tendon (Li, Xiong, Tan and Guo 2009) as a plug-in beside
pybullet: bones and tunnels are pybullet bodies, distances come from FCL, and the tendons' reactions
act on the bodies as wrenches. SI units, quaternions (x, y, z, w), world frame unless a name says
otherwise.
"""

from pkgutil import extend_path

# The folders `urdf` and `scenarios` and the compiled core are parts of this package that stand
# elsewhere in a checkout; an installed copy on the path completes one that was not built in place.
__path__ = extend_path(__path__, __name__)

from .anchors import Attachment, Grip, Line  # noqa: E402
from .cartilage import Cartilage, Region  # noqa: E402
from .errors import (  # noqa: E402
    AttachmentWarning,
    CannotCopy,
    CartilageWarning,
    CaseFailed,
    EquilibriumWarning,
    InertiaWarning,
    InsideWarning,
    InvalidType,
    InvalidValue,
    MissingExtra,
    ResolutionWarning,
    SlackWarning,
    SnapshotError,
    StateMismatch,
    StepFailed,
    StepWarning,
    TendonError,
    UnknownId,
    UrdfError,
)
from .fixation import Bundle, Fixation, Tensioner  # noqa: E402
from .ligament import Ligament, Wrap  # noqa: E402
from .loading import data_path  # noqa: E402
from .material import Material  # noqa: E402
from .options import SolverOptions  # noqa: E402
from .plots import plot  # noqa: E402
from .recorder import Recorder  # noqa: E402
from .recording import Recording  # noqa: E402
from .skin import Skin  # noqa: E402
from .sweeps import sweep  # noqa: E402
from .tendon import Tendon  # noqa: E402
from .tunnels import Tunnel  # noqa: E402
from .world import TendonWorld  # noqa: E402

__version__ = "0.1.0"

__all__ = [
    "Attachment",
    "AttachmentWarning",
    "Bundle",
    "CannotCopy",
    "Cartilage",
    "CartilageWarning",
    "CaseFailed",
    "EquilibriumWarning",
    "Fixation",
    "Grip",
    "InertiaWarning",
    "InsideWarning",
    "InvalidType",
    "InvalidValue",
    "Ligament",
    "Line",
    "Material",
    "MissingExtra",
    "Recorder",
    "Recording",
    "Region",
    "ResolutionWarning",
    "Skin",
    "SlackWarning",
    "SnapshotError",
    "SolverOptions",
    "StateMismatch",
    "StepFailed",
    "StepWarning",
    "Tendon",
    "TendonError",
    "TendonWorld",
    "Tensioner",
    "Tunnel",
    "UnknownId",
    "UrdfError",
    "Wrap",
    "data_path",
    "plot",
    "sweep",
]
