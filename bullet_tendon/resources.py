"""Where the package's own URDFs and meshes are."""

import os
from importlib.resources import files

from . import checks
from .errors import InvalidValue


def data_path(name: str) -> str:
    """Absolute path of a file in the package's `urdf` folder, for instance "knee.urdf".

    Raises InvalidType for anything but a string, InvalidValue where there is no such file.
    """
    folder = files("bullet_tendon.urdf")
    path = os.path.join(str(folder), checks.text("name", name))
    if not os.path.isfile(path):
        known = sorted(entry.name for entry in folder.iterdir() if entry.name.endswith(".urdf"))
        raise InvalidValue("name", name, "a file of the urdf folder, such as " + ", ".join(known))
    return path
