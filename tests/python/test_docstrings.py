"""The examples in the docstrings of public names: each name has one, and each prints what it says."""

import doctest
import inspect
import re
import warnings
from pathlib import Path

import pybullet as p
import pytest
from bullet_tendon.scenarios.manual.completeness import NOT_FOR_USERS

import bullet_tendon as bt
from bullet_tendon import reports, view

REFERENCE = Path(__file__).parents[2] / "scenarios" / "manual" / "reference.md"


def documented():
    """Classes, functions and methods behind the public names, as (name, object)."""
    things = {name: getattr(bt, name) for name in bt.__all__} | {"StepReport": reports.StepReport}
    things |= {f"view.{name}": getattr(view, name) for name in view.__all__ if callable(getattr(view, name))}
    for name, thing in things.items():
        yield name, thing
        if inspect.isclass(thing):
            for key, member in vars(thing).items():
                function = getattr(member, "__func__", member)
                if key[0] != "_" and f"{name}.{key}" not in NOT_FOR_USERS and inspect.isfunction(function):
                    yield f"{name}.{key}", function


EXAMPLES = dict(documented())


@pytest.fixture
def names(tmp_path, monkeypatch):
    """What the lines have defined after which all examples begin; the reference shows them."""
    monkeypatch.chdir(tmp_path)  # some examples write files
    beginning = re.search(r"```python\n(.*?)```", REFERENCE.read_text(encoding="utf-8"), re.DOTALL).group(1)
    defined: dict = {}
    exec(beginning, defined)
    yield defined
    p.disconnect(defined["world"].physicsClientId)


@pytest.mark.parametrize("name", EXAMPLES)
def test_example_prints_what_it_says(name, names):
    example = doctest.DocTestParser().get_doctest(inspect.getdoc(EXAMPLES[name]), names, name, None, None)
    said: list[str] = []
    with warnings.catch_warnings():  # some change the filters
        result = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example, out=said.append)
    assert result.attempted, "no example"
    assert not result.failed, "".join(said)
