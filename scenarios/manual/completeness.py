"""Sphinx extension of the manual: a warning for each public name that the reference does not have."""

import inspect

import bullet_tendon

PACKAGE = bullet_tendon.__name__
# Methods without an underscore that the package alone calls.
NOT_FOR_USERS = {
    "Material.of_ligament",
    "Material.of_tendon",
    "SolverOptions.core_arguments",
    "StepReport.add_solved_again",
    "StepReport.read",
}


def setup(app) -> dict:
    app.connect("env-check-consistency", _warn_of_missing)
    return {"parallel_read_safe": True}


def public_names() -> list[str]:
    """Of the package: classes, functions, and the methods and properties that a class defines itself."""
    names = []
    for name in bullet_tendon.__all__:
        thing = getattr(bullet_tendon, name)
        names.append(f"{PACKAGE}.{name}")
        if inspect.isclass(thing):
            members = [key for key, member in vars(thing).items() if _is_told(key, member)]
            names += [f"{PACKAGE}.{name}.{key}" for key in members if f"{name}.{key}" not in NOT_FOR_USERS]
    return names


def _is_told(key: str, member) -> bool:
    kinds = (property, classmethod, staticmethod)
    return not key.startswith("_") and (inspect.isfunction(member) or isinstance(member, kinds))


def _warn_of_missing(app, env) -> None:
    from sphinx.util import logging  # the names are listed without Sphinx as well

    documented = {entry[0] for entry in env.get_domain("py").get_objects()}
    for name in public_names():
        if name not in documented:
            logging.getLogger(__name__).warning("not in the reference: %s", name)
