"""Pictures: tendons in pybullet's window, camera images without one, plots. No physics.

Owns: nothing; the parts are in visuals.py, camera.py, lens.py, window.py and figures.py. Goes with no room of
the core.
Images are (height, width, 3) uint8. matplotlib and tqdm (extra `view`) are imported only where they are used.
"""

from collections.abc import Iterable

from .camera import Camera, camera_image, hidden, render_scene
from .figures import figure, save_png
from .lens import Rendering
from .visuals import PALETTE, TAUT_COLOR, TENDON_COLOR, TUNNEL_COLOR, TendonVisual, mesh_body, tunnel_mesh
from .window import Window


def progress(iterable: Iterable, description: str = "", total: int | None = None) -> Iterable:
    """The iterable with a tqdm bar on stderr; without tqdm, the iterable itself.

    Example:
        >>> from bullet_tendon import view
        >>> [k for k in view.progress(range(3), "steps")]
        [0, 1, 2]
    """
    try:
        from tqdm import tqdm
    except ImportError:
        return iterable
    return tqdm(iterable, desc=description or None, total=total)


__all__ = [
    "PALETTE",
    "TAUT_COLOR",
    "TENDON_COLOR",
    "TUNNEL_COLOR",
    "Camera",
    "Rendering",
    "TendonVisual",
    "Window",
    "camera_image",
    "figure",
    "hidden",
    "mesh_body",
    "progress",
    "render_scene",
    "save_png",
    "tunnel_mesh",
]
