"""Loading: a body with the tunnels and tendons that its URDF names, and where the package's URDFs are.

Owns: nothing; it calls what a user could call (TendonWorld.add_obstacle, add_tunnel, add_tendon), and takes
all of it back where something is refused. Goes with no room of the core; the elements are read in
urdf_elements.
"""

import contextlib
import os
from importlib.resources import files

import numpy as np
import pybullet as p

from . import checks
from .errors import InvalidValue, UrdfError
from .material import Material
from .urdf_elements import TendonElement, UrdfElements, read_elements

_SCALING = 5  # place of globalScaling among p.loadURDF's arguments after the path


def load_urdf(world, path, args, kwargs, obstacles: bool) -> int:
    """See TendonWorld.load_urdf."""
    client = world.physicsClientId
    scaling = kwargs.get("globalScaling", args[_SCALING] if len(args) > _SCALING else 1)
    elements = read_elements(path).scaled(checks.number("globalScaling", scaling, above=0))
    materials = [_material(path, tendon) for tendon in elements.tendons]
    _check_names(world, path, elements)
    try:
        body = p.loadURDF(str(path), *args, physicsClientId=client, **kwargs)
    except p.error as problem:
        raise InvalidValue("path", path, f"a URDF that pybullet can load ({problem})") from None
    kept, tendons, tunnels = world._states.capture(), world.tendons, world.tunnels
    try:
        _equip(world, path, body, elements, materials, obstacles)
    except BaseException:  # an interrupt too
        _take_out(world, body, set(world.tendons) - set(tendons), set(world.tunnels) - set(tunnels))
        p.removeBody(body, client)
        world._states.take_back(kept)
        raise
    return body


def _take_out(world, body: int, tendons, tunnels) -> None:
    for tendon in tendons:
        world.remove_tendon(tendon)
    for tunnel in tunnels:
        world.remove_tunnel(tunnel)
    slots = world._bodies.slots_of(body)
    world._obstacles.forget(slots)
    world._bodies.forget(slots)


def link_indices(body: int, client: int) -> dict[str, int]:
    """Link index by name; -1 is the base."""
    links = {p.getBodyInfo(body, client)[0].decode(): -1}
    for joint in range(p.getNumJoints(body, client)):
        links[p.getJointInfo(body, joint, client)[12].decode()] = joint
    return links


def _equip(world, path, body, elements: UrdfElements, materials, obstacles) -> None:
    client = world.physicsClientId
    links = link_indices(body, client)
    _require_links(path, elements, links)
    if obstacles and _has_shapes(body, links, client):
        concave = {index: elements.concave[name] for name, index in links.items() if name in elements.concave}
        world._obstacles.add(body, concave=concave)
        world._placement.changed_obstacles(body)
    for t in elements.tunnels:
        with _named(path, f"<tunnel name='{t.name}'>"):
            world.add_tunnel(body, links[t.link], t.start, t.end, t.radius, t.friction, t.chamfer, t.name)
    for t, material in zip(elements.tendons, materials, strict=True):
        places = [_in_world(world, body, links, link, xyz) for link, xyz in t.points]
        with _named(path, f"<tendon name='{t.name}'>"):
            tendon = world.add_tendon(places, t.radius, material, t.particles, t.name)
        for k in t.attachments:
            link, xyz = t.points[k]
            nearest = np.argmin(np.linalg.norm(tendon.positions - places[k], axis=1))
            tendon.attach(int(nearest), body, links[link], xyz)


def _require_links(path, elements: UrdfElements, links: dict[str, int]) -> None:
    """Raise UrdfError for an element on a link that pybullet has merged into another one."""
    used = [(f"<tunnel name='{t.name}'>", t.link) for t in elements.tunnels]
    used += [(f"<tendon name='{t.name}'>", link) for t in elements.tendons for link, _ in t.points]
    for element, link in used:
        if link is not None and link not in links:
            known = ", ".join(map(repr, links))
            raise UrdfError(
                path, element, "link", link, f"a link that pybullet keeps with these flags: {known}"
            )


def _has_shapes(body: int, links: dict[str, int], client: int) -> bool:
    try:
        return any(p.getCollisionShapeData(body, index, client) for index in links.values())
    except p.error:
        allowed = "False: pybullet does not report shapes in maximal coordinates, unless obstacles is False"
        raise InvalidValue("useMaximalCoordinates", True, allowed) from None


@contextlib.contextmanager
def _named(path, element: str):
    """Turn what an element's values are refused for into an error that names file and element."""
    try:
        yield
    except InvalidValue as problem:
        raise UrdfError(path, element, problem.argument, problem.value, problem.allowed) from None


def _in_world(world, body, links, link, xyz) -> np.ndarray:
    if link is None:
        return np.asarray(xyz)
    origin, axes = world._bodies.frame(body, links[link])
    return origin + axes @ xyz


def _material(path, tendon: TendonElement) -> Material:
    where = f"<tendon name='{tendon.name}'>"
    try:
        if "name" in tendon.material:
            return Material.preset(**tendon.material)
        return Material(**tendon.material)
    except InvalidValue as problem:
        attribute = "preset" if problem.argument == "name" else problem.argument
        raise UrdfError(path, where + " <material>", attribute, problem.value, problem.allowed) from None


def _check_names(world, path, elements: UrdfElements) -> None:
    taken = {t.name for t in world.tendons}
    for t in elements.tendons:
        if t.name in taken:
            where = f"<tendon name='{t.name}'>"
            raise UrdfError(path, where, "name", t.name, "different from the world's other tendons' names")


def data_path(name: str) -> str:
    """Absolute path of a file in the package's urdf folder.

    Args:
        name: of the file, relative to the folder: "knee.urdf", "meshes/femur.obj".

    Raises:
        InvalidType: for anything but a string.
        InvalidValue: where there is no such file.

    Example:
        >>> import os
        >>> os.path.basename(bt.data_path("knee.urdf"))
        'knee.urdf'
    """
    folder = files("bullet_tendon.urdf")
    path = os.path.join(str(folder), checks.text("name", name))
    if not os.path.isfile(path):
        known = sorted(entry.name for entry in folder.iterdir() if entry.name.endswith(".urdf"))
        raise InvalidValue("name", name, "a file of the urdf folder, such as " + ", ".join(known))
    return path
